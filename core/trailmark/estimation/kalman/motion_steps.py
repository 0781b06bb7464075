"""What a motion says of its interval, and of a part of it."""

from __future__ import annotations

import math
from dataclasses import field

import numpy as np

from trailmark.estimates import Motion
from trailmark.estimation.symmetric import NOTHING, ZERO, Sym3, add, congruence, inverse, scaled, to_matrix
from trailmark.geometry import Pose2, Twist2
from trailmark.values import quick_dataclass

__all__ = ["MotionStep", "StatedMotion", "weakened_by"]


@quick_dataclass(frozen=True, slots=True, eq=False)
class MotionStep:
    """A motion over a piece of time, seen from its beginning.

    Attributes
    ----------
    x, y, turn : float
        Base at the end as seen from base at the beginning [m, m, rad].
    covariance : Sym3 or None
        Of (x, y, turn); None where a direction was not measured.
    information : Sym3 or None
        Its inverse, where `covariance` is None.
    twist : Twist2
        The velocity.
    matched_share : float
        Of a motion between poses on one map, the share of it that this is; 0 of any other.
    """

    x: float
    y: float
    turn: float
    covariance: Sym3 | None
    information: Sym3 | None
    twist: Twist2
    matched_share: float = 0.0
    _variances: tuple[float, float] | None = field(default=None, init=False, repr=False)
    _inverse: Sym3 | None = field(default=None, init=False, repr=False)

    def variances(self) -> tuple[float, float]:
        """Return the variances of the worse axis of the position, and of the turn; ``inf`` where there is none.

        Hypotheses, and each time that the past is redone, ask the same again.
        """
        if self._variances is None:
            object.__setattr__(self, "_variances", self._new_variances())
        assert self._variances is not None
        return self._variances

    def inverse_covariance(self) -> Sym3:
        """Return the information, whichever of the two is known; kept, too."""
        if self._inverse is None:
            known = self.information if self.covariance is None else inverse(self.covariance)
            object.__setattr__(self, "_inverse", known or ZERO)
        assert self._inverse is not None
        return self._inverse

    def _new_variances(self) -> tuple[float, float]:
        if self.covariance is not None:
            xx, _, _, yy, _, tt = self.covariance
            return max(xx, yy), tt
        xx, xy, _, yy, _, tt = self.information or ZERO
        worst = 0.5 * (xx + yy - math.hypot(xx - yy, 2.0 * xy))  # a corridor is seldom parallel to an axis of base
        return (1.0 / worst if worst > NOTHING else math.inf), (1.0 / tt if tt > NOTHING else math.inf)


class StatedMotion:
    """A `Motion` with its checked information, and what it says of a part of its interval.

    Parameters
    ----------
    motion : Motion
        What was said.
    information : Sym3
        As it is believed.

    Attributes
    ----------
    since_s, stamp_s : float
        Its interval [s].
    pose : Pose2
        Base at the end as seen from the beginning.
    origin : Motion
        What was told: of its parts, too.
    """

    __slots__ = ("_arc", "_parts", "_spread", "_whole", "origin", "pose", "since_s", "stamp_s")

    def __init__(self, motion: Motion, information: Sym3) -> None:
        self.since_s, self.stamp_s = motion.since_s, motion.stamp_s
        self.pose, dt_s = motion.pose_since_now, motion.stamp_s - motion.since_s
        self.origin = motion
        pose = self.pose
        self._arc = pose.log()
        forward_m, left_m, turn_rad = self._arc
        twist = Twist2(forward_m / dt_s, left_m / dt_s, turn_rad / dt_s)
        covariance = inverse(information)
        rest = information if covariance is None else None
        matched_share = 1.0 if motion.is_matched else 0.0
        self._whole = MotionStep(pose.x, pose.y, pose.theta, covariance, rest, twist, matched_share)
        self._spread: Sym3 | None = None
        self._parts: dict[tuple[float, float], MotionStep] = {}

    def between(self, since_s: float, stamp_s: float) -> MotionStep:
        """Return the step over a part of the interval.

        The error is spread evenly over the time as a small motion of all space about base at the beginning. In these
        coordinates the errors of parts just add up, so that the parts together are as uncertain as the whole.
        """
        if since_s == self.since_s and stamp_s == self.stamp_s:
            return self._whole
        part = self._parts.get((since_s, stamp_s))
        if part is None:  # each hypothesis, and each time that the past is redone, asks for the same parts
            part = self._parts[since_s, stamp_s] = self._step_between(since_s, stamp_s)
        return part

    def _step_between(self, since_s: float, stamp_s: float) -> MotionStep:
        dt_s = self.stamp_s - self.since_s
        begin, end = self._pose((since_s - self.since_s) / dt_s), self._pose((stamp_s - self.since_s) / dt_s)
        fraction = (stamp_s - since_s) / dt_s
        step, whole = begin.between(end), self._whole
        matched_share = fraction * whole.matched_share
        if whole.covariance is None:
            information = scaled(whole.information or ZERO, 1.0 / fraction)  # to the first order of the turn
            return MotionStep(step.x, step.y, step.theta, None, information, whole.twist, matched_share)
        if self._spread is None:
            self._spread = congruence(whole.covariance, 1.0, 0.0, whole.y, -whole.x)
        cos, sin = math.cos(begin.theta), math.sin(begin.theta)
        lever_x, lever_y = cos * -end.y + sin * end.x, sin * end.y + cos * end.x
        covariance = congruence(scaled(self._spread, fraction), cos, -sin, lever_x, lever_y)
        return MotionStep(step.x, step.y, step.theta, covariance, None, whole.twist, matched_share)

    def _pose(self, fraction: float) -> Pose2:
        forward_m, left_m, turn_rad = self._arc
        return Pose2.exp(fraction * forward_m, fraction * left_m, fraction * turn_rad)

    @property
    def is_whole(self) -> bool:
        """Whether it measures the way in each direction, and the turn."""
        return self._whole.covariance is not None

    @property
    def twist(self) -> Twist2:
        """The mean velocity of all that was told."""
        return self._whole.twist

    def rest_behind(self, way: Pose2, uneven: Sym3, since_s: float) -> StatedMotion:
        """Return what it adds to motions that reach from its beginning to a stamp.

        Parameters
        ----------
        way : Pose2
            Base at that stamp as seen from the beginning, as those motions have it.
        uneven : Sym3
            Covariance of `way` on top of what they say, where a motion had to be cut.
        since_s : float
            The stamp [s].
        """
        even = self.between(since_s, self.stamp_s)
        pose, covariance, information = way.between(self.pose), even.covariance, even.information
        if covariance is not None:
            covariance = add(covariance, uneven)
        elif uneven[0] > 0.0:
            information = weakened_by(information or ZERO, uneven)
        step = MotionStep(pose.x, pose.y, pose.theta, covariance, information, even.twist)
        return self._part(since_s, self.stamp_s, step)

    def until(self, stamp_s: float) -> StatedMotion:
        """Return its beginning, until a stamp."""
        return (
            self if stamp_s == self.stamp_s else self._part(self.since_s, stamp_s, self.between(self.since_s, stamp_s))
        )

    def less_certain(self, factor: float) -> StatedMotion:
        """Return the same with covariances that are larger by a factor."""
        whole = self._whole
        covariance = None if whole.covariance is None else scaled(whole.covariance, factor)
        information = None if whole.information is None else scaled(whole.information, 1.0 / factor)
        step = MotionStep(whole.x, whole.y, whole.turn, covariance, information, whole.twist, whole.matched_share)
        return self._part(self.since_s, self.stamp_s, step)

    def _part(self, since_s: float, stamp_s: float, step: MotionStep) -> StatedMotion:
        part = StatedMotion.__new__(StatedMotion)
        part.since_s, part.stamp_s, part.origin = since_s, stamp_s, self.origin
        part.pose = Pose2(step.x, step.y, step.turn)
        part._arc, part._whole, part._spread = part.pose.log(), step, None
        part._parts = {}
        return part


def weakened_by(information: Sym3, noise: Sym3) -> Sym3:
    """Return information with noise on top, of directions that were not measured, too: ``(1 + I N)^-1 I``."""
    matrix = to_matrix(information)
    weakened = np.linalg.solve(np.eye(3) + matrix @ to_matrix(noise), matrix)
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = (0.5 * (weakened + weakened.T)).tolist()
    return xx, xy, xt, yy, yt, tt
