"""Which number of the state is what: the pose first, then what the chosen models add."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.geometry import wrap_angle

__all__ = ["CommonError", "Layout"]


@dataclass(frozen=True, slots=True)
class CommonError:
    """An error that all motions of a localizer have in common, as a number of the state.

    Attributes
    ----------
    kind : {"gyro_bias", "scale"}
        A constant yaw rate [rad/s], or a share by which the way is too long.
    index : int
        Its place in the state.
    sigma : float
        What is known of it before anything is heard.
    walk : float
        Variance by which it changes in a second.
    """

    kind: str
    index: int
    sigma: float
    walk: float = 0.0


@dataclass(frozen=True, slots=True)
class Layout:
    """The numbers of the state.

    Attributes
    ----------
    n : int
        How many there are: x, y, theta; with the model `velocity` forward, left and yaw rate; and common errors.
    has_velocity : bool
        Whether numbers 3 to 5 are the velocity of base.
    velocity_sigmas : (float, float, float)
        Of the velocity of a robot of which nothing is known [m/s, m/s, rad/s].
    common : mapping of str to CommonError
        CommonError errors, by localizer.
    """

    n: int = 3
    has_velocity: bool = False
    velocity_sigmas: tuple[float, float, float] = (0.0, 0.0, 0.0)
    common: dict[str, CommonError] = field(default_factory=dict)

    @classmethod
    def of(cls, config: KalmanConfig) -> Layout:
        """Return the layout that a config asks for."""
        has_velocity = config.model == "velocity"
        n = 6 if has_velocity else 3
        sigmas = {"gyro_bias": math.radians(config.gyro_bias_sigma_deg_per_s), "scale": config.scale_sigma}
        common = {}
        for source, own in sorted(config.sources.items()):
            if own.errors != "independent":
                sigma = sigmas[own.errors]
                is_bias = own.errors == "gyro_bias"
                walk = math.radians(config.gyro_bias_walk_deg_per_s) ** 2 if is_bias else sigma**2 / config.wander_s
                common[source] = CommonError(own.errors, n, sigma, walk)
                n += 1
        drift = (config.drift_sigma_mps, config.drift_sigma_mps, math.radians(config.drift_sigma_deg_per_s))
        return cls(n, has_velocity, drift, common)

    def initial_state(self, pose: Floats, covariance: Floats) -> tuple[Floats, Floats]:
        """Return a state that begins at a pose, (3,) and (3, 3); of the rest nothing is known yet."""
        if self.n == 3:
            return pose, covariance
        x, whole = np.zeros(self.n), np.zeros((self.n, self.n))
        x[:3], whole[:3, :3] = pose, covariance
        if self.has_velocity:
            whole[range(3, 6), range(3, 6)] = np.square(self.velocity_sigmas)
        for common in self.common.values():
            whole[common.index, common.index] = common.sigma**2
        return x, whole

    def with_pose(self, x: Floats, covariance: Floats, pose: Floats, pose_covariance: Floats) -> tuple[Floats, Floats]:
        """Return a state with another pose; what else is known of base stays, and depends on the pose no more."""
        moved, whole = x.copy(), covariance.copy()
        moved[:3] = pose[0], pose[1], wrap_angle(float(pose[2]))
        whole[:3, :], whole[:, :3] = 0.0, 0.0
        whole[:3, :3] = pose_covariance
        return moved, whole
