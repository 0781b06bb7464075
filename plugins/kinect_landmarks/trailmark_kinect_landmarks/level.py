"""Whether the camera stays level, as ``solve: plane`` takes for granted: then landmarks keep their heights."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from trailmark.arrays import Floats

__all__ = ["LevelWatch", "tilt_rad"]

#: Level robots show 0.1 deg, 0.6 deg with the paper's angles and few landmarks.
_TILT_RAD = math.radians(1.0)
_LASTS_S = 0.4  # most of the pictures of so long, two at least: a robot nods where it drives over a sill
_LEAST_LANDMARKS = 8
_SOFT_RAD = math.radians(0.5)  # angle of elevation by which a landmark may be wrong
_PRIOR = 0.01  # of one landmark's weight: the turn about an axis that none of them shows is none
_RAISED_M = 0.05  # by which a base may stand higher than when it was taught: of its tyres, or of what it carries
_N_STEPS = 8


def tilt_rad(points_base: Floats, heights_map_m: Floats) -> float:
    """Return by how much the camera is tilted, from the heights of landmarks.

    A tilt lifts landmarks by an angle of elevation that goes with the cosine of their direction, a base that stands
    higher by one that goes with how near they are. Who does not fit hardly counts (Geman & McClure): a thing that is
    lifted tilts nothing.

    Parameters
    ----------
    points_base : (N, 3) float64
        Landmarks as they are seen from a base that is taken for level [m].
    heights_map_m : (N,) float64
        Their heights as remembered [m].

    Returns
    -------
    float
        Angle between the axis of the base that is taken for vertical and the vertical [rad].
    """
    ranges_m = np.maximum(np.linalg.norm(points_base[:, :2], axis=1), 1e-6)
    J = np.column_stack([points_base[:, :2], np.ones(len(ranges_m))]) / ranges_m[:, None]
    prior = np.diag([_PRIOR, _PRIOR, (_SOFT_RAD / _RAISED_M) ** 2])
    lifted_rad = (heights_map_m - points_base[:, 2]) / ranges_m
    tilt = np.array([float(np.median(lifted_rad)), 0.0, 0.0])
    for _ in range(_N_STEPS):
        misses = np.abs(lifted_rad - J @ tilt)
        soft = max(_SOFT_RAD, 1.5 * float(np.median(misses)))
        weights = (1.0 + (misses / soft) ** 2) ** -2.0
        tilt = np.linalg.solve((J.T * weights) @ J + prior, (J.T * weights) @ lifted_rad)
    return float(np.hypot(tilt[0], tilt[1]))


class LevelWatch:
    """Knows whether poses are solved in the plane: as it is told, until the camera is seen to tilt.

    Parameters
    ----------
    is_level : bool
        Whether the camera is told to stay level.
    notices : bool
        Whether it is believed that it tilts.
    """

    def __init__(self, is_level: bool, *, notices: bool = True) -> None:
        self.is_level = is_level
        self._notices = notices
        self._looks: deque[tuple[float, bool]] = deque()  # stamps, and whether it tilts, of the last while

    @property
    def n_dimensions(self) -> int:
        """2 in the plane, 3 in space."""
        return 2 if self.is_level else 3

    def notices_tilt(self, stamp_s: float, points_base: Floats, heights_map_m: Floats) -> bool:
        """Take landmarks of a picture (see `tilt_rad`); return whether they show for the first time that it tilts."""
        # Differs from the paper: where it takes the camera for level, it is looked whether it is.
        if not (self._notices and self.is_level) or len(points_base) < _LEAST_LANDMARKS:
            return False
        looks = self._looks
        looks.append((stamp_s, tilt_rad(points_base, heights_map_m) > _TILT_RAD))
        while len(looks) > 1 and stamp_s - looks[1][0] >= _LASTS_S:
            looks.popleft()
        n_tilted = sum(is_tilted for _, is_tilted in looks)
        self.is_level = stamp_s - looks[0][0] < _LASTS_S or n_tilted <= max(1, len(looks) // 2)
        return not self.is_level
