"""What refused absolute poses say of the way to them: by how much motion would be off, were they right.

A whole pose that does not fit the belief after a way without others is off, or the motion is: by a share of the way or
of the turn, or by a yaw rate. The errors of this kind that are the least unusual and explain it go on to grow with the
way. One refused pose may be an outlier: it makes the belief wide. A second that fits if motion errs as the first said
is used, and motion is not thought better of until poses fit without.
"""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.innovation import nis_of
from trailmark.estimation.kalman.lasting_errors import NO_ERRORS, Columns, LastingVariances, lasting_covariance
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.kalman.state import FilterState, Gaussian, RejectedMeasurement
from trailmark.geometry import Pose2

__all__ = ["added_errors", "difference_grown", "errors_said_by", "less_when_unneeded", "reason_of_way_errors"]

# How large such errors are, one standard deviation: shares of the way along and aside, of the turn, and a yaw rate of
# half a degree a second [rad/s].
_USUAL = np.array([0.05, 0.02, 0.05, math.radians(0.5)])
# None is larger than so many of these.
_MOST = 3.0
# An error that would have been seen: so many variances of an absolute estimate. Each that fits without leaves so much
# of the variance, and less than such a share of the usual one is forgotten.
_SHOWS, _LEFT, _FORGOTTEN = 9.0, 0.5, 4e-4


def difference_grown(gaussian: Gaussian, pose_odom_base: Pose2, last: RejectedMeasurement) -> Floats:
    """Return by how much the belief is off now, (3,), if a whole pose that it contradicted was right.

    Parameters
    ----------
    gaussian : Gaussian
        The belief now.
    pose_odom_base : Pose2
        Where motion has carried base.
    last : RejectedMeasurement
        The pose.
    """
    here = Pose2(*gaussian.x[:3].tolist())
    then = here @ pose_odom_base.between(last.pose_odom_base)
    errors, away = _explained(gaussian, then, last)
    begun, now = _matrix(last.lasting), _matrix(gaussian.lasting)
    return np.asarray(_carried(away - begun @ errors, then, here) + now @ errors)


def errors_said_by(
    state: FilterState, measurement: Measurement, last: RejectedMeasurement, limit: float
) -> LastingVariances:
    """Return the squares of the errors of motion that explain one refused whole pose, if another says so, too.

    Parameters
    ----------
    state : FilterState
        Before the other, with a known pose.
    measurement : Measurement
        The other.
    last : RejectedMeasurement
        The one.
    limit : float
        NIS up to which something fits.

    Returns
    -------
    LastingVariances
        None where such errors are too unusual, or where the other says the same offset again, as one that matches a
        wrong place does: what motion is off by grows.
    """
    gaussian = state.gaussian
    assert gaussian is not None
    here = Pose2(*gaussian.x[:3].tolist())
    then = here @ state.odometry.pose_odom_base.between(last.pose_odom_base)
    errors, away = _explained(gaussian, then, last)
    then_y, then_jacobian = last.measurement.innovation(then.array())
    usual = LastingVariances(*(_USUAL * _USUAL).tolist())
    spread = gaussian.covariance[:3, :3] + lasting_covariance(last.lasting, usual)
    innovation, jacobian = measurement.innovation(gaussian.x)
    # the same offset, or that of a map: of two that err
    same = [innovation - jacobian[:, :3] @ one for one in (away, _carried(away, then, here))]
    if (
        nis_of(then_y, then_jacobian[:, :3], spread) > limit
        or min(float(one @ one) for one in same) <= 2.0 * limit
        or (np.abs(errors) > _MOST * _USUAL).any()
    ):
        return NO_ERRORS
    return LastingVariances(*(errors * errors).tolist())


def less_when_unneeded(
    state: FilterState, measurement: Measurement, known: LastingVariances, limit: float
) -> LastingVariances:
    """Return what is left of the errors that refused poses have said, after an absolute estimate.

    Parameters
    ----------
    state : FilterState
        Before it.
    measurement : Measurement
        The absolute estimate.
    known : LastingVariances
        What is known of motion without them.
    limit : float
        NIS up to which it fits.
    """
    said, gaussian = state.diagnosis.way_errors, state.gaussian
    assert gaussian is not None
    innovation, jacobian = measurement.innovation(gaussian.x)
    covariance = gaussian.covariance.copy()
    covariance[:3, :3] += lasting_covariance(gaussian.lasting, known)
    would_show = jacobian[:, :3] @ lasting_covariance(gaussian.lasting, said) @ jacobian[:, :3].T
    if would_show.diagonal().max() < _SHOWS or nis_of(innovation, jacobian, covariance) > limit:
        return said
    least = (_FORGOTTEN * _USUAL * _USUAL).tolist()
    return LastingVariances(*(_LEFT * one if _LEFT * one > few else 0.0 for one, few in zip(said, least)))


def added_errors(known: LastingVariances, said: LastingVariances) -> LastingVariances:
    """Return the squares of the errors that refused poses have said, with those of one more; they stay plausible."""
    most = (_MOST * _MOST * _USUAL * _USUAL).tolist()
    return LastingVariances(*(min(one, limit) for one, limit in zip(known.plus(said), most)))


def reason_of_way_errors(said: LastingVariances) -> str:
    """Return in words what refused poses have said of motion."""
    along, aside, turn, drift = (math.sqrt(one) for one in said[: len(_USUAL)])
    return (
        f"absolute poses say that motion is off by {100.0 * along:.1f} % of the way, {100.0 * aside:.1f} % aside,"
        f" {100.0 * turn:.1f} % of the turn or {math.degrees(drift):.2f} deg/s: the belief is so much less certain"
    )


def _explained(gaussian: Gaussian, then: Pose2, last: RejectedMeasurement) -> tuple[Floats, Floats]:
    """Return the errors of motion that explain a refused pose best, (4,), and by how much it is off, (3,)."""
    innovation, jacobian = last.measurement.innovation(then.array())
    by_error = jacobian[:, :3] @ (_matrix(last.lasting) * _USUAL)
    spread = jacobian[:, :3] @ gaussian.covariance[:3, :3] @ jacobian[:, :3].T + np.eye(len(innovation))
    errors = _USUAL * (by_error.T @ np.linalg.solve(by_error @ by_error.T + spread, innovation))
    return np.asarray(errors), np.asarray(np.linalg.solve(jacobian[:, :3], innovation))


def _carried(away: Floats, then: Pose2, here: Pose2) -> Floats:
    """Return by how much a pose is off here, (3,), that was off by so much before and has moved on rightly."""
    x, y, turn = away.tolist()
    return np.array([x - (here.y - then.y) * turn, y + (here.x - then.x) * turn, turn])


def _matrix(columns: Columns) -> Floats:
    """Return how the pose changes with each error of `_USUAL`, (3, 4)."""
    return np.array(columns[: 3 * len(_USUAL)]).reshape(-1, 3).T
