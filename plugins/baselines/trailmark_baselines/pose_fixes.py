"""Absolute poses from elsewhere as fixes: motion capture, a satellite receiver, another program."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Belief, Estimate, Fix, Lost
from trailmark.frames import Frame, Record
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, Session
from trailmark_baselines.config import PoseFixesConfig

__all__ = ["PoseFixes"]

# Of correlations; below it one number is said to follow from the others.
_LEAST_EIGENVALUE = 1e-9


class PoseFixes(Localizer):
    """Gives the readings of a sensor of kind ``pose`` as fixes, with the sensor's covariance or the config's."""

    config: PoseFixesConfig

    def start(self, session: Session) -> None:
        """Read the sensor's mounting."""
        self._pose_sensor_base = session.sensors[self.config.poses].pose_base_sensor.planar().inverse()

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return the pose of base, with no information on what the sensor does not know."""
        if not isinstance(frame.payload, Record):
            return ()
        arrays = frame.payload.arrays
        covariance = self._covariance(arrays["covariance"])
        if np.isnan(covariance).any():
            return (Lost(frame.stamp_s, "the reading does not say how exact it is; set sigma and sigma_deg"),)
        x, y, theta = (float(value) for value in arrays["pose"])
        knows_heading = math.isfinite(covariance[2, 2])
        if not knows_heading:
            if belief.pose_map_base is None and self._pose_sensor_base != Pose2():
                return (Lost(frame.stamp_s, "the heading is not known, and the sensor does not sit at base"),)
            theta = 0.0 if belief.pose_map_base is None else belief.pose_map_base.theta
        information = _information(covariance, knows_heading)
        if information is None:
            return (Lost(frame.stamp_s, "the covariance of the reading is none: it is not positive definite"),)
        return (Fix(frame.stamp_s, Pose2(x, y, theta) @ self._pose_sensor_base, information),)

    def _covariance(self, told: Floats) -> Floats:
        """Return the covariance of a reading: its own, or the config's where there is none or where that is larger."""
        covariance: Floats = np.array(told, float)
        sigmas = (self.config.sigma, self.config.sigma, self.config.sigma_deg)
        for index, sigma in enumerate(sigmas):
            if sigma is None:
                continue
            variance = (math.radians(sigma) if index == 2 else sigma) ** 2
            if math.isnan(covariance[index, index]):
                covariance[index, :] = covariance[:, index] = 0.0
                covariance[index, index] = variance
            elif math.isfinite(covariance[index, index]):
                covariance[index, index] = max(variance, covariance[index, index])
        return covariance


def _information(covariance: Floats, knows_heading: bool) -> Floats | None:
    """Return the inverse of what is known of a covariance; None where that is none."""
    information: Floats = np.zeros((3, 3))
    size = 3 if knows_heading else 2
    known = covariance[:size, :size]
    if not (np.isfinite(known).all() and np.diag(known).min() > 0.0):
        return None
    sigmas = np.sqrt(np.diag(known))
    if np.linalg.eigvalsh(known / np.outer(sigmas, sigmas))[0] <= _LEAST_EIGENVALUE:  # whatever the units are
        return None
    information[:size, :size] = np.linalg.inv(known)
    return information
