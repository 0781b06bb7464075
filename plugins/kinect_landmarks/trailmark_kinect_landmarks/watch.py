"""Watches the depth of a camera for errors that no residual shows, and warns the user once, with the remedy."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence

import numpy as np

from trailmark.arrays import Depth, Grey8
from trailmark_kinect_landmarks.registration import RegistrationCheck
from trailmark_kinect_landmarks.systematic import Rates, depth_share

__all__ = ["DepthWatch", "complaint_about_depths", "complaint_about_way"]

logger = logging.getLogger(__name__)

_STEADY_RADPS = math.radians(8.0)
#: Half of what a room shows a camera lies between these [m].
_NEAREST_MEDIAN_M, _FARTHEST_MEDIAN_M = 0.4, 6.0
#: A camera that sees so near sees further than a step as well, and none of them sees as far as the last [m].
_NEAREST_M, _LEAST_FAR_M, _FARTHEST_M = 0.35, 1.3, 12.0
_EVERY, _N_PICTURES = 3, 10  # pictures between two that are looked at, and of these so many decide
_COMPARED_M = 0.3  # way over which the own and the others' are compared
_RATIO = 2.0


class DepthWatch:
    """Looks at depth and way in the first pictures.

    Parameters
    ----------
    name : str
        Of the localizer, for messages.
    sensor : str
        Of the camera, for messages.
    """

    def __init__(self, name: str, sensor: str) -> None:
        self._name, self._sensor = name, sensor
        self.registration = RegistrationCheck()
        self._depths_m: list[tuple[float, float, float]] = []
        self._n_pictures = 0
        self._way_from: tuple[tuple[float, float], tuple[float, float]] | None = None
        self._has_compared = False

    @property
    def share(self) -> float:
        """Share of the way by which depth may be wrong, by what is known of it."""
        return depth_share(self.registration.state)

    def look_at_depths(self, depth_m: Depth) -> None:
        """Take the depth of any picture: where no depth can be right, there is no pose either."""
        self._n_pictures += 1
        if len(self._depths_m) >= _N_PICTURES or self._n_pictures % _EVERY:
            return
        known = depth_m[::8, ::8]
        known = known[np.isfinite(known) & (known > 0.0)]
        if len(known):
            near_m, median_m, far_m = np.percentile(known, (5.0, 50.0, 95.0)).tolist()
            self._depths_m.append((near_m, median_m, far_m))
        else:
            self._depths_m.append((math.nan, math.nan, math.nan))
        if len(self._depths_m) == _N_PICTURES:
            complaint = complaint_about_depths(self._depths_m)
            if complaint:
                logger.warning("%s: %s (sensor %r)", self._name, complaint, self._sensor)

    def look(self, stamp_s: float, grey: Grey8, depth_m: Depth, rates: Rates | None) -> bool:
        """Take a picture of which a pose is known; return True when its depth has just been found to lie elsewhere."""
        is_steady = rates is not None and rates.spin_radps < _STEADY_RADPS
        if not self.registration.look(stamp_s, grey, depth_m, is_steady):
            return False
        found = self.registration.found
        assert found is not None
        logger.warning(
            "%s: depth of %r does not lie on its colour: its edges lie at %.3f times their place, (%.0f, %.0f) px off."
            " Depth is moved there, and what was seen before is taken for %.0f %% unsure. Measure it with 'trailmark"
            " calibrate rgbd', or let the camera's driver register depth to colour",
            self._name, self._sensor, found.scale, found.right_px, found.down_px,
            100.0 * found.share((grey.shape[1], grey.shape[0])),
        )  # fmt: skip
        return True

    def compare_ways(self, own_xy_m: tuple[float, float], others_xy_m: tuple[float, float]) -> None:
        """Compare where this localizer and the motions of others have come to; say so once where they contradict."""
        if self._has_compared:
            return
        if self._way_from is None:
            self._way_from = own_xy_m, others_xy_m
            return
        own_m, others_m = (math.dist(now, then) for now, then in zip((own_xy_m, others_xy_m), self._way_from))
        if max(own_m, others_m) < _COMPARED_M:
            return
        if others_m < 1e-6:  # nothing else tells a way
            return
        self._has_compared = True
        complaint = complaint_about_way(own_m, others_m)
        if complaint:
            logger.warning("%s: %s (sensor %r)", self._name, complaint, self._sensor)


def complaint_about_depths(depths_m: Sequence[tuple[float, float, float]]) -> str | None:
    """Return what is implausible about the depths of pictures, with the remedy; None where nothing is.

    Parameters
    ----------
    depths_m : sequence of (float, float, float)
        Of each picture, what a twentieth, half and all but a twentieth of the depths are nearer than; NaN without [m].
    """
    known = [depth for depth in depths_m if math.isfinite(depth[1])]
    if not known:
        return "no depth at all: is this the depth of that camera, and in metres?"
    near_m, median_m, far_m = (float(depth) for depth in np.median(known, axis=0))
    is_near = median_m < _NEAREST_MEDIAN_M or (near_m < _NEAREST_M and far_m < _LEAST_FAR_M)
    if not is_near and median_m <= _FARTHEST_MEDIAN_M and far_m <= _FARTHEST_M:
        return None
    return (
        f"half of all depths are beyond {median_m:.3g} m, and nine tenths from {near_m:.3g} to {far_m:.3g} m,"
        f" implausibly {'near' if is_near else 'far'} for an RGB-D camera: look at the source's 'depth_factor'"
        " (5000 per metre in TUM recordings, 1000 for depth in millimetres, 1 for metres)"
    )


def complaint_about_way(own_m: float, others_m: float) -> str | None:
    """Return what is said where the own way and that of other motions contradict; None where they do not."""
    if 1.0 / _RATIO <= own_m / others_m <= _RATIO:
        return None
    return (
        f"it has come {own_m:.3g} m, other motions say {others_m:.3g} m, {own_m / others_m:.3g} times: look at the"
        " source's 'depth_factor', or at the scale of the odometry"
    )
