"""A landmark at a known place, seen at a range and a bearing, as a fix of rank two."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from trailmark.errors import ConfigError
from trailmark.estimates import Belief, Estimate, Fix, Lost
from trailmark.frames import Arrays, Frame, Record
from trailmark.geometry import Pose2, wrap_angle
from trailmark.interfaces import Localizer, Session
from trailmark_mrclam.config import RangeBearingConfig

__all__ = ["RangeBearing", "exact_pose", "sighting"]

Array = npt.NDArray[np.float64]

_MOST_STEPS = 20
_EXACT = 1e-9  # [m, rad]
_NEAREST_M = 0.05  # closer than this a bearing says nothing


class RangeBearing(Localizer):
    """Says a `Fix` for each landmark that it knows; along the circle about the landmark it has no information."""

    config: RangeBearingConfig

    def start(self, session: Session) -> None:
        """Look up where the landmarks stand.

        Raises
        ------
        ConfigError
            If the sensor's calibration does not say.
        """
        info = session.sensors[self.config.sightings]
        calibration = info.calibration
        if not isinstance(calibration, Arrays) or not {"ids", "positions_map"} <= set(calibration.arrays):
            raise ConfigError(f"sensor {info.name!r}: its calibration must give 'ids' and 'positions_map' of landmarks")
        ids, positions = calibration.arrays["ids"].tolist(), calibration.arrays["positions_map"]
        self._landmarks = {landmark_id: (float(x), float(y)) for landmark_id, (x, y) in zip(ids, positions)}
        self._pose_base_sensor = info.pose_base_sensor.planar()
        sigmas = np.array([self.config.range_sigma_m, math.radians(self.config.bearing_sigma_deg)])
        self._weights = sigmas**-2

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return a fix for each sighting, the pose near the belief from which it would be exact."""
        if not isinstance(frame.payload, Record):
            return ()
        if belief.pose_map_base is None or belief.covariance is None:
            return (Lost(frame.stamp_s, "one landmark says two numbers of three, and nothing is believed yet"),)
        seen = frame.payload.arrays
        return [
            self._estimate(frame.stamp_s, belief, landmark_id, np.array([range_m, bearing_rad]))
            for landmark_id, range_m, bearing_rad in zip(seen["ids"].tolist(), seen["ranges_m"], seen["bearings_rad"])
            if landmark_id in self._landmarks
        ]

    def _estimate(self, stamp_s: float, belief: Belief, landmark_id: int, seen: Array) -> Estimate:
        assert belief.pose_map_base is not None
        assert belief.covariance is not None
        landmark = self._landmarks[landmark_id]
        pose = exact_pose(belief.pose_map_base, belief.covariance, landmark, seen, self._pose_base_sensor)
        if pose is None:
            return Lost(stamp_s, f"no pose near the belief sees landmark {landmark_id} so")
        _, rows = sighting(pose, landmark, self._pose_base_sensor)
        information = (rows.T * self._weights) @ rows
        return Fix(stamp_s, pose, (information + information.T) / 2.0, {"landmark": float(landmark_id)})


def sighting(pose: Pose2, landmark: tuple[float, float], pose_base_sensor: Pose2) -> tuple[Array, Array]:
    """Return range and bearing of a landmark as seen from a pose, (2,), and their derivatives, (2, 3) [m, rad]."""
    sensor = pose @ pose_base_sensor
    dx, dy = landmark[0] - sensor.x, landmark[1] - sensor.y
    range_m = max(math.hypot(dx, dy), 1e-9)
    cos, sin = dx / range_m, dy / range_m
    lever_x, lever_y = pose.y - sensor.y, sensor.x - pose.x  # how the sensor moves when base turns
    rows = [
        [-cos, -sin, -cos * lever_x - sin * lever_y],
        [sin / range_m, -cos / range_m, (sin * lever_x - cos * lever_y) / range_m - 1.0],
    ]
    return np.array([range_m, wrap_angle(math.atan2(dy, dx) - sensor.theta)]), np.array(rows)


def exact_pose(
    believed: Pose2, covariance: Array, landmark: tuple[float, float], seen: Array, pose_base_sensor: Pose2
) -> Pose2 | None:
    """Return a pose from which a sighting would be exact, near a belief in the metric of its covariance.

    Newton's steps, each the shortest that makes the linearised sighting exact; None if they do not converge.

    Parameters
    ----------
    believed, covariance : Pose2, (3, 3) float64
        The belief.
    landmark : (float, float)
        Its place in the map [m].
    seen : (2,) float64
        Range and bearing [m, rad].
    pose_base_sensor : Pose2
        The sensor's mounting.
    """
    shift = np.zeros(3)
    for _ in range(_MOST_STEPS):
        pose = Pose2(believed.x + shift[0], believed.y + shift[1], believed.theta + shift[2])
        predicted, rows = sighting(pose, landmark, pose_base_sensor)
        miss = np.array([seen[0] - predicted[0], wrap_angle(float(seen[1] - predicted[1]))])
        if predicted[0] < _NEAREST_M:
            return None
        if np.abs(miss).max() < _EXACT:
            return pose
        gain = covariance @ rows.T
        try:
            shift = shift + gain @ np.linalg.solve(rows @ gain, miss)
        except np.linalg.LinAlgError:
            return None
    return None
