"""One pose of the window, what measured it, and what is left of it when it leaves."""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.chain import OdomState
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.symmetric import ZERO, Sym3, congruence, to_matrix
from trailmark.geometry import Pose2, wrap_angle
from trailmark.values import quick_dataclass

__all__ = ["Absolute", "KeyPose", "PredictedPose", "WindowVerdict", "carried_prior", "moved_poses", "nis_of"]


@quick_dataclass(frozen=True, slots=True, eq=False)
class PredictedPose:
    """Where base is at a stamp.

    Attributes
    ----------
    pose : Pose2
        Base in the map.
    covariance : Sym3
        Of its x, y and theta.
    odometry : OdomState
        Where motion alone has carried base.
    """

    pose: Pose2
    covariance: Sym3
    odometry: OdomState


@quick_dataclass(frozen=True, slots=True)
class WindowVerdict:
    """What became of an absolute estimate.

    Attributes
    ----------
    is_accepted : bool
        Whether the poses agree with it.
    nis : float
        Normalised innovation squared against all that was known before it.
    dof : int
        Its rank.
    """

    is_accepted: bool
    nis: float
    dof: int


class Absolute:
    """An absolute estimate, and its weight of now."""

    __slots__ = ("information", "limit", "measurement", "weight")

    def __init__(self, measurement: Measurement, limit: float, weight: float) -> None:
        self.measurement = measurement
        self.information = measurement.root.T @ measurement.root
        self.limit = limit
        self.weight = weight


class KeyPose:
    """An instant of the window: where motion alone carried base, the motion from the last one, what measured it."""

    __slots__ = ("absolutes", "motion", "motion_covariance", "motion_information", "odometry", "stamp_s")

    def __init__(self, stamp_s: float, odometry: OdomState) -> None:
        self.stamp_s = stamp_s
        self.odometry = odometry
        self.absolutes: list[Absolute] = []
        self.motion = Pose2()
        self.motion_covariance = ZERO
        self.motion_information: Floats = np.eye(3)


def carried_prior(prior: tuple[Floats, Floats], pose: Floats, first: KeyPose, second: KeyPose) -> tuple[Floats, Floats]:
    """Return what is known of a pose by all that is known of the one before it.

    Parameters
    ----------
    prior : (3,), (3, 3) float64
        Mean and information of the one before, without its own absolute estimates.
    pose : (3,) float64
        That one, smoothed: derivatives are taken there.
    first, second : KeyPose
        What measured it, and the motion to the next.

    Returns
    -------
    (3,), (3, 3) float64
        Mean and information of the next pose.
    """
    mean, information = prior[0], prior[1].copy()
    gradient = information @ _difference(pose, mean)
    for one in first.absolutes:
        innovation, jacobian = one.measurement.innovation(pose)
        information += one.weight * jacobian.T @ jacobian
        gradient -= one.weight * jacobian.T @ innovation
    covariance = np.linalg.inv(information)
    x, y, theta = (pose - covariance @ gradient).tolist()
    after = Pose2(x, y, theta) @ second.motion
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = cos * second.motion.x - sin * second.motion.y, sin * second.motion.x + cos * second.motion.y
    carry = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
    moved = carry @ covariance @ carry.T + to_matrix(congruence(second.motion_covariance, cos, sin, 0.0, 0.0))
    return after.array(), np.asarray(np.linalg.inv((moved + moved.T) / 2.0))


def nis_of(measurement: Measurement, predicted: PredictedPose) -> tuple[float, int]:
    """Return the normalised innovation squared of a measurement, and its rank."""
    innovation, jacobian = measurement.innovation(predicted.pose.array())
    spread = jacobian @ to_matrix(predicted.covariance) @ jacobian.T + np.eye(len(innovation))
    return float(innovation @ np.linalg.solve(spread, innovation)), len(innovation)


def _difference(pose: Floats, other: Floats) -> Floats:
    away = pose - other
    away[2] = wrap_angle(float(away[2]))
    return away


def moved_poses(poses: Floats, before: Floats, after: Floats) -> Floats:
    """Return the poses moved as the first of them was."""
    shift = Pose2(*after.tolist()) @ Pose2(*before.tolist()).inverse()
    return np.array([(shift @ Pose2(*pose)).array() for pose in poses.tolist()])
