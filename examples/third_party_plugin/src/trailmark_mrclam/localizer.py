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

__all__ = ["RangeBearing", "most_likely_fix", "sighting", "squares_of_curves"]

Array = npt.NDArray[np.float64]

_MOST_STEPS = 10
_SETTLED = 1e-6  # [m, rad]
_STEP = 1e-4  # between derivatives [m, rad]
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
        self._variances = sigmas**2

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return a fix for each sighting."""
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
        found = most_likely_fix(
            belief.pose_map_base,
            belief.covariance,
            self._landmarks[landmark_id],
            seen,
            self._variances,
            self._pose_base_sensor,
        )
        if found is None:
            return Lost(stamp_s, f"on top of landmark {landmark_id}")
        pose, rows = found
        landmark = self._landmarks[landmark_id]
        curves = squares_of_curves(pose, landmark, self._pose_base_sensor, belief.covariance)
        variances = np.diag(self._variances) + curves
        information = rows.T @ np.linalg.solve(variances, rows)
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


def squares_of_curves(pose: Pose2, landmark: tuple[float, float], pose_base_sensor: Pose2, covariance: Array) -> Array:
    """Return the mean products, (2, 2), of what the derivatives of `sighting` leave out over a belief.

    ``tr(H_i P H_j P) / 2 + tr(H_i P) tr(H_j P) / 4``, with the second derivatives H as differences of the first: the
    terms of the second-order extended Kalman filter. A pose that is hardly known makes them larger than the noise.
    """
    second = np.empty((2, 3, 3))
    for column, step in enumerate(_STEP * np.eye(3)):
        ahead, behind = (Pose2.from_array(pose.array() + sign * step) for sign in (1.0, -1.0))
        ends = (sighting(end, landmark, pose_base_sensor)[1] for end in (ahead, behind))
        second[:, :, column] = np.subtract(*ends) / (2.0 * _STEP)
    curves = second @ covariance
    means = 0.5 * np.trace(curves, axis1=1, axis2=2)
    return np.asarray(0.5 * np.einsum("iab,jba->ij", curves, curves) + np.outer(means, means))


def most_likely_fix(
    believed: Pose2,
    covariance: Array,
    landmark: tuple[float, float],
    seen: Array,
    variances: Array,
    pose_base_sensor: Pose2,
) -> tuple[Pose2, Array] | None:
    """Return a pose from which a sighting is exact, to first order, and the derivatives that this holds with.

    The derivatives are those at the pose that belief and sighting together make most likely (the iterated extended
    Kalman filter): an estimator that takes the fix to the same belief arrives there.

    Parameters
    ----------
    believed, covariance : Pose2, (3, 3) float64
        The belief.
    landmark : (float, float)
        Its place in the map [m].
    seen, variances : (2,) float64
        Range and bearing, and their variances [m, rad].
    pose_base_sensor : Pose2
        The sensor's mounting.

    Returns
    -------
    (Pose2, (2, 3) float64) or None
        None on top of the landmark, where a bearing says nothing.
    """
    shift, noise = np.zeros(3), np.diag(variances)
    for _ in range(_MOST_STEPS):
        pose = Pose2(believed.x + shift[0], believed.y + shift[1], believed.theta + shift[2])
        predicted, rows = sighting(pose, landmark, pose_base_sensor)
        if predicted[0] < _NEAREST_M:
            return None
        miss = np.array([seen[0] - predicted[0], wrap_angle(float(seen[1] - predicted[1]))])
        gain = covariance @ rows.T
        before, shift = shift, gain @ np.linalg.solve(rows @ gain + noise, miss + rows @ shift)
        if np.abs(shift - before).max() < _SETTLED:
            break
    rest = rows.T @ np.linalg.solve(rows @ rows.T, miss)
    return Pose2(pose.x + rest[0], pose.y + rest[1], pose.theta + rest[2]), rows
