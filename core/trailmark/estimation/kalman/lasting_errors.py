"""What motion is off by without averaging out: shares of the way and of the turn, and velocities that are not there.

A localizer states the noise of its motion. Pixels that are 1 % larger than believed, or wheels, are 1 % of the way in
every step to the same side, and nobody states them; a belief that adds up stated covariances alone is surer with every
metre than it is right. So the state carries how the pose changes with each of these errors, and the published
covariance holds what they may be (as the considered parameters of Schmidt, "Application of state-space methods to
navigation problems", Advances in Control Systems 3, 1966). The filter itself goes on as if they were zero: what it
believes, and how it weighs, is as without them. How large they are is a prior, and what motions that part say of them
(`parting`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from operator import add
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman_config import KalmanConfig

if TYPE_CHECKING:
    from trailmark.estimation.kalman.diagnosis import MotionSum

__all__ = [
    "NO_ERRORS",
    "UNAFFECTED",
    "Columns",
    "LastingPrior",
    "LastingVariances",
    "carry_columns",
    "correct_columns",
    "lasting_covariance",
    "turn_columns",
]

#: How the pose changes with each error, three numbers (x, y, theta) for each in the order of `LastingVariances`
#: [m, m, rad, or per metre or radian a second].
Columns = tuple[float, ...]
UNAFFECTED: Columns = (0.0,) * 18

# Slower than this base stands: what drifts with its motion drifts no more [m/s, rad/s].
_AT_REST_MPS, _AT_REST_RADPS = 0.005, 0.005
# From this variance of a heading on an arc is no straight line [rad^2].
_MUCH_RAD2 = 1e-3


class LastingVariances(NamedTuple):
    """Variances of the errors that last.

    Attributes
    ----------
    along, aside : float
        Shares of the way, along it and to its left.
    turn : float
        Share of the turn.
    drift : float
        Of a yaw rate while base moves [rad^2/s^2].
    ahead, left : float
        Of a velocity in the direction of the heading, and to its left, while base moves: it stays as it is when the
        robot turns back, and a share of the way does not [m^2/s^2].
    """

    along: float = 0.0
    aside: float = 0.0
    turn: float = 0.0
    drift: float = 0.0
    ahead: float = 0.0
    left: float = 0.0

    def plus(self, others: LastingVariances) -> LastingVariances:
        """Return the sums."""
        return LastingVariances(*map(add, self, others)) if any(others) else self


NO_ERRORS = LastingVariances()


class LastingPrior(NamedTuple):
    """What is known of these errors before motions say anything of them.

    Attributes
    ----------
    variance : float
        Of a share of the way or of the turn.
    scaled : frozenset of str
        Localizers whose scale is estimated: theirs is no error that lasts.
    """

    variance: float
    scaled: frozenset[str]

    @classmethod
    def of(cls, config: KalmanConfig) -> LastingPrior:
        """Return what a config says."""
        scaled = frozenset(source for source, own in config.sources.items() if own.errors == "scale")
        return cls(config.calibration_sigma**2, scaled)

    def with_parting(self, parting: LastingVariances, sums: Mapping[str, MotionSum]) -> LastingVariances:
        """Return the variances of all that is known.

        Parameters
        ----------
        parting : LastingVariances
            What motions that part say.
        sums : mapping of str to MotionSum
            Of every localizer that gives motion: the scale of one of them is not that of the others.
        """
        is_estimated = bool(self.scaled) and all(
            source in self.scaled for source, one in sums.items() if one.position_m2 > 0.0
        )
        return parting.plus(LastingVariances(along=0.0 if is_estimated else self.variance, turn=self.variance))


def carry_columns(
    columns: Columns, way: tuple[float, float], heading: tuple[float, float], turn: float, dt_s: float
) -> Columns:
    """Return how the pose changes with each error after a step.

    Parameters
    ----------
    columns : tuple of 18 float
        Before it.
    way : (float, float)
        The step, in axes of the map [m].
    heading : (float, float)
        Cosine and sine of the heading.
    turn : float
        The turn of the step [rad].
    dt_s : float
        Its length [s].
    """
    ax, ay, at, lx, ly, lt, tx, ty, tt, rx, ry, rt, fx, fy, ft, sx, sy, st = columns
    dx, dy = way
    moves = dx * dx + dy * dy > (_AT_REST_MPS * dt_s) ** 2 or abs(turn) > _AT_REST_RADPS * dt_s
    moved_s = dt_s if moves else 0.0
    ahead_x, ahead_y = moved_s * heading[0], moved_s * heading[1]
    return (
        ax + dx - dy * at,
        ay + dy + dx * at,
        at,
        lx - dy - dy * lt,
        ly + dx + dx * lt,
        lt,
        tx - dy * tt,
        ty + dx * tt,
        tt + turn,
        rx - dy * rt,
        ry + dx * rt,
        rt + moved_s,
        fx + ahead_x - dy * ft,
        fy + ahead_y + dx * ft,
        ft,
        sx - ahead_y - dy * st,
        sy + ahead_x + dx * st,
        st,
    )


def correct_columns(columns: Columns, gain: Floats) -> Columns:
    """Return how the pose changes with each error after a correction with a gain in the pose ``K H``, (3, 3)."""
    before = np.array(columns).reshape(-1, 3)
    return tuple((before - before.dot(gain.T)).ravel().tolist())


def turn_columns(columns: Columns, cos: float, sin: float) -> Columns:
    """Return how the pose changes with each error in a map whose axes are turned."""
    turning = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return tuple((np.array(columns).reshape(-1, 3) @ turning.T).ravel().tolist())


def lasting_covariance(columns: Columns, variances: LastingVariances) -> Floats:
    """Return what the errors that last add to the covariance of the pose, (3, 3).

    A heading that is wrong by much moves base on an arc: what that is off the tangent is added.
    """
    xx = xy = xt = yy = yt = tt = 0.0
    for k, variance in zip(range(0, 18, 3), variances):
        if variance:
            x, y, theta = columns[k : k + 3]
            of_x, of_y = variance * x, variance * y
            xx, xy, xt = xx + of_x * x, xy + of_x * y, xt + of_x * theta
            turn2 = variance * theta * theta
            yy, yt, tt = yy + of_y * y, yt + of_y * theta, tt + turn2
            if turn2 > _MUCH_RAD2:
                # the lever is (y, -x) / theta; the mean square of 1 - cos of a normal angle
                off = (1.5 - 2.0 * math.exp(-0.5 * turn2) + 0.5 * math.exp(-2.0 * turn2)) / turn2
                xx, xy, yy = xx + off * of_y * y, xy - off * of_x * y, yy + off * of_x * x
    return np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
