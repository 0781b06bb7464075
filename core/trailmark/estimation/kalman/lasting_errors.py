"""What motion is off by without averaging out: a scale of the way, a mounting askew, a scale of the turn, a yaw drift.

A localizer states the noise of its motion. Pixels that are 1 % larger than believed, or wheels, are 1 % of the way in
every step to the same side, and nobody states them; a belief that adds up stated covariances alone is surer with every
metre than it is right. So the state carries how the pose changes with each of these errors, and the published
covariance holds what they may be (as the considered parameters of Schmidt, "Application of state-space methods to
navigation problems", Advances in Control Systems 3, 1966). The filter itself goes on as if they were zero: what it
believes, and how it weighs, is as without them. How large they are is a prior, and what motions that part say of them
(`parting`).
"""

from __future__ import annotations

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

#: How the pose changes with each error: (x, y, theta) by a share of the way along it, by one aside, by a share of the
#: turn, and by a yaw rate while base moves [m, m, rad, or per second].
Columns = tuple[float, float, float, float, float, float, float, float, float, float, float, float]
UNAFFECTED: Columns = (0.0,) * 12

# Slower than this base stands: what drifts with its motion drifts no more [m/s, rad/s].
_AT_REST_MPS, _AT_REST_RADPS = 0.005, 0.005


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
    """

    along: float = 0.0
    aside: float = 0.0
    turn: float = 0.0
    drift: float = 0.0

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


def carry_columns(columns: Columns, dx: float, dy: float, turn: float, dt_s: float) -> Columns:
    """Return how the pose changes with each error after a step.

    Parameters
    ----------
    columns : tuple of 12 float
        Before it.
    dx, dy, turn : float
        The step, in axes of the map [m, m, rad].
    dt_s : float
        Its length [s].
    """
    ax, ay, at, lx, ly, lt, tx, ty, tt, rx, ry, rt = columns
    moves = dx * dx + dy * dy > (_AT_REST_MPS * dt_s) ** 2 or abs(turn) > _AT_REST_RADPS * dt_s
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
        rt + dt_s if moves else rt,
    )


def correct_columns(columns: Columns, gain: Floats) -> Columns:
    """Return how the pose changes with each error after a correction with a gain in the pose ``K H``, (3, 3)."""
    (a, b, c), (d, e, f), (g, h, i) = gain.tolist()
    ax, ay, at, lx, ly, lt, tx, ty, tt, rx, ry, rt = columns
    return (
        ax - (a * ax + b * ay + c * at),
        ay - (d * ax + e * ay + f * at),
        at - (g * ax + h * ay + i * at),
        lx - (a * lx + b * ly + c * lt),
        ly - (d * lx + e * ly + f * lt),
        lt - (g * lx + h * ly + i * lt),
        tx - (a * tx + b * ty + c * tt),
        ty - (d * tx + e * ty + f * tt),
        tt - (g * tx + h * ty + i * tt),
        rx - (a * rx + b * ry + c * rt),
        ry - (d * rx + e * ry + f * rt),
        rt - (g * rx + h * ry + i * rt),
    )


def turn_columns(columns: Columns, cos: float, sin: float) -> Columns:
    """Return how the pose changes with each error in a map whose axes are turned."""
    ax, ay, at, lx, ly, lt, tx, ty, tt, rx, ry, rt = columns
    return (
        *(cos * ax - sin * ay, sin * ax + cos * ay, at),
        *(cos * lx - sin * ly, sin * lx + cos * ly, lt),
        *(cos * tx - sin * ty, sin * tx + cos * ty, tt),
        *(cos * rx - sin * ry, sin * rx + cos * ry, rt),
    )


def lasting_covariance(columns: Columns, variances: LastingVariances) -> Floats:
    """Return what the errors that last add to the covariance of the pose, (3, 3)."""
    xx = xy = xt = yy = yt = tt = 0.0
    for k, variance in zip((0, 3, 6, 9), variances):
        if variance:
            x, y, theta = columns[k : k + 3]
            of_x, of_y = variance * x, variance * y
            xx, xy, xt = xx + of_x * x, xy + of_x * y, xt + of_x * theta
            yy, yt, tt = yy + of_y * y, yt + of_y * theta, tt + variance * theta * theta
    return np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
