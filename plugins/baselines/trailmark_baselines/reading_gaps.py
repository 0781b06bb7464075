"""Times without a reading of wheels, and whether the step across one holds what was driven meanwhile.

Wheels of which messages were lost count on, and the next reading holds the whole way. Wheels that were off, or were
started anew, go on from where their pose had been, or from anywhere: then the way of the gap is missing, and nothing in
the reading says so. What tells them apart is how the robot drove: a step as long as if it had gone on was counted.
Behind any other it may have stopped, or turned, or the way is missing: the step is then as uncertain as both are apart.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from trailmark.geometry import Twist2, wrap_angle

__all__ = ["Components", "ReadingGaps"]

# A time is a gap from so many usual ones on, if it is longer than a robot takes to change its speed [s]; readings come
# seldom where a usual one is this share of the longest that is none, or more.
_PERIODS, _SHORT_S, _SELDOM = 4.0, 0.25, 0.8
# By this share of a new interval the usual one grows or falls, less where readings come several at once; and a speed is
# that of so long [s].
_GROWS, _FALLS, _SMOOTHED_S = 0.2, 0.05, 0.3
# A robot that goes on covers this share of the way at its speed or more, and no more than this.
_LEAST, _MOST = 0.5, 1.5
# As fast as it ever was, and a little faster; a way or a turn that is nothing much [m, rad].
_FASTER, _LITTLE_M, _LITTLE_RAD = 1.2, 0.05, math.radians(15.0)
# What stands may drive next, but has to begin: the fastest way is 3.3 standard deviations [m/s, rad/s].
_AT_REST_MPS, _AT_REST_RADPS, _COVERED = 0.02, 0.05, 0.3
# No step that is so many times faster than any before is driven.
_IMPOSSIBLE = 3.0
# Of a robot that nobody watched: as the estimators take it [m/s, rad/s].
_UNSEEN_MPS, _UNSEEN_RADPS = 0.5, math.radians(30.0)


class Components(NamedTuple):
    """What a step, its velocity or its variances are forward, to the left and of the turn."""

    along: float
    across: float
    turn: float


_NOTHING = Components(0.0, 0.0, 0.0)


class ReadingGaps:
    """Knows how often readings come and how fast the robot drives, and judges a step by it.

    Parameters
    ----------
    max_gap_s : float
        A time without a reading is a gap if it is longer, unless readings come that seldom [s].
    """

    __slots__ = ("_begun", "_begun_s", "_body", "_fastest_mps", "_fastest_radps", "_max_gap_s", "_usual_s")

    def __init__(self, max_gap_s: float) -> None:
        self._max_gap_s = max_gap_s
        self._usual_s = math.inf
        self._fastest_mps = self._fastest_radps = 0.0
        self._body: Components | None = None  # its velocity
        self._begun, self._begun_s = _NOTHING, 0.0  # steps since it is not known

    def is_gap(self, dt_s: float) -> bool:
        """Return whether readings so far apart have a gap between them."""
        comes_seldom = _SELDOM * self._max_gap_s < self._usual_s < math.inf
        return dt_s > max(_PERIODS * self._usual_s, _SHORT_S) or (dt_s > self._max_gap_s and not comes_seldom)

    def is_impossible(self, way_m: float, dt_s: float) -> bool:
        """Return whether a step is faster than anything that this robot was seen to do."""
        knows_speed = self._body is not None or self._fastest_mps > 0.0
        return knows_speed and way_m > _IMPOSSIBLE * self._fastest_mps * dt_s + _LITTLE_M

    def may_be_driven(self, arc: Components, after: Twist2 | None, dt_s: float) -> bool:
        """Return whether a step across a gap is no longer than this robot, as it was seen, drives in that time."""
        is_seen = self._body is not None or self._fastest_mps > 0.0
        return is_seen and math.hypot(arc.along, arc.across) <= self._farthest_m(after, dt_s)

    def why_doubtful(self, arc: Components, after: Twist2 | None, dt_s: float) -> str:
        """Return in words how a step across a gap is not what a robot going on would have driven; empty: it is.

        Either it did not go on, or the pose misses the way.

        Parameters
        ----------
        arc : Components
            Logarithm of the step [m, m, rad].
        after : Twist2 or None
            The speed that the reading behind the gap tells.
        dt_s : float
            Length of the gap [s].
        """
        if self._body is None:
            return "and nothing says how fast the robot was"
        vx, vy, yaw = _mean_velocity(self._body, after)
        speed_mps, way_m, turn_rad = math.hypot(vx, vy), math.hypot(arc.along, arc.across), abs(arc.turn)
        expected_m, expected_rad = speed_mps * dt_s, abs(yaw) * dt_s
        told_deg, expected_deg = math.degrees(arc.turn), math.degrees(yaw * dt_s)
        if expected_m > _LITTLE_M:
            ahead_m = (arc.along * vx + arc.across * vy) / speed_mps
            if ahead_m < _LEAST * expected_m:
                return f"its pose goes on {ahead_m:.2g} m ahead, where the robot would have driven {expected_m:.2g}"
        elif expected_rad > _LITTLE_RAD and arc.turn * yaw < _LEAST * expected_rad * abs(yaw):
            return f"its heading goes on by {told_deg:.2g} deg, where the robot would have turned by {expected_deg:.2g}"
        elif dt_s > self._max_gap_s and max(way_m, _LITTLE_M * turn_rad / _LITTLE_RAD) <= _LITTLE_M:
            return "and whether it drove meanwhile its pose does not say"
        if way_m > self._farthest_m(after, dt_s):
            return f"its pose goes on {way_m:.2g} m away, where the robot would have driven {expected_m:.2g}"
        if turn_rad > max(_MOST * expected_rad, _FASTER * self._fastest_radps * dt_s) + _LITTLE_RAD:
            return f"its heading goes on by {told_deg:.2g} deg, which is faster than it ever turned"
        return ""

    def variances_of_doubt(self, arc: Components, after: Twist2 | None, dt_s: float) -> Components:
        """Return the variances of a step that holds its way or misses it: both are within one standard deviation.

        At least as that of a robot that nobody watched, and in each direction: it may have turned.

        Parameters
        ----------
        arc : Components
            Logarithm of the step [m, m, rad].
        after : Twist2 or None
            The speed that the reading behind the gap tells: it may have been that all the while.
        dt_s : float
            Length of the gap [s].
        """
        body = self._body or Components(self._fastest_mps, 0.0, 0.0)
        ahead_m2, left_m2, turn_rad2 = _squared_apart(arc, body, dt_s)
        if after is not None:
            told = Components(after.forward_mps, after.left_mps, after.yaw_radps)
            ahead_m2, left_m2, turn_rad2 = map(max, (ahead_m2, left_m2, turn_rad2), _squared_apart(arc, told, dt_s))
        unseen_mps = max(_UNSEEN_MPS, _COVERED * self._fastest_mps)
        unseen_radps = max(_UNSEEN_RADPS, _COVERED * self._fastest_radps)
        way_m2 = max(ahead_m2 + left_m2, (unseen_mps * dt_s) ** 2)
        return Components(way_m2, way_m2, max(turn_rad2, min(unseen_radps * dt_s, math.pi) ** 2))

    def _farthest_m(self, after: Twist2 | None, dt_s: float) -> float:
        body = _mean_velocity(self._body or _NOTHING, after)
        return max(_MOST * math.hypot(body.along, body.across), _FASTER * self._fastest_mps) * dt_s + _LITTLE_M

    def variances(self, arc: Components, dt_s: float, before: Twist2 | None, late: Components) -> Components:
        """Return the variances that a gap, or a usual time that is as long, adds to a step that holds its way.

        It may be short of a part: it is as uncertain as it differs from going on. Who stood may have driven meanwhile,
        and of whom nobody knows the speed, as the estimators take it.

        Parameters
        ----------
        arc : Components
            Logarithm of the step [m, m, rad].
        dt_s : float
            Length of the gap [s].
        before : Twist2 or None
            The speed that the reading before the gap tells: commands that have just changed.
        late : Components
            The variances that it has already [m^2, m^2, rad^2].
        """
        body = self._body
        if body is None:
            turn_rad = min(_UNSEEN_RADPS * dt_s, math.pi)
            return Components((_UNSEEN_MPS * dt_s) ** 2, (_UNSEEN_MPS * dt_s) ** 2, turn_rad * turn_rad)
        unseen_m2 = unseen_rad2 = 0.0
        if math.hypot(body.along, body.across) < _AT_REST_MPS and abs(body.turn) < _AT_REST_RADPS:
            unseen_m2 = (_COVERED * self._fastest_mps * dt_s) ** 2
            unseen_rad2 = (_COVERED * self._fastest_radps * dt_s) ** 2
        ahead_m2, left_m2, turn_rad2 = _squared_apart(arc, body, dt_s)
        if before is not None:
            told = Components(before.forward_mps, before.left_mps, before.yaw_radps)
            ahead_m2, left_m2, turn_rad2 = map(min, (ahead_m2, left_m2, turn_rad2), _squared_apart(arc, told, dt_s))
        return Components(
            max(ahead_m2 - late.along, unseen_m2),
            max(left_m2 - late.across, unseen_m2),
            max(turn_rad2 - late.turn, unseen_rad2),
        )

    def note_interval(self, dt_s: float) -> None:
        """Take note of when a reading came, believed or not: the pace may have changed for good."""
        usual_s = self._usual_s
        if usual_s == math.inf:
            self._usual_s = dt_s
        else:
            share = _GROWS if dt_s > usual_s else _FALLS
            self._usual_s = usual_s + share * (min(dt_s, _PERIODS * usual_s) - usual_s)

    def note_step(self, arc: Components, dt_s: float) -> None:
        """Take note of a step that was believed: a speed is that of a while, as readings held back come all at once."""
        before = self._body
        if before is None:
            self._begun = Components(*(one + other for one, other in zip(self._begun, arc)))
            self._begun_s += dt_s
            if self._begun_s < _SMOOTHED_S:
                return
            self._body = body = Components(*(part / self._begun_s for part in self._begun))
        else:
            per_s = 1.0 / (dt_s + _SMOOTHED_S)
            self._body = body = Components(*(v + per_s * (step - v * dt_s) for v, step in zip(before, arc)))
        self._fastest_mps = max(self._fastest_mps, math.hypot(body.along, body.across))
        self._fastest_radps = max(self._fastest_radps, abs(body.turn))

    def forget_speed(self) -> None:
        """Begin anew behind a gap or a restart; how fast the robot can be is still known."""
        self._body, self._begun, self._begun_s = None, _NOTHING, 0.0


def _mean_velocity(body: Components, after: Twist2 | None) -> Components:
    """Return the velocity before a gap, or its mean with what is told behind it: it may have changed meanwhile."""
    if after is None:
        return body
    told = after.forward_mps, after.left_mps, after.yaw_radps
    return Components(*((one + other) / 2.0 for one, other in zip(body, told)))


def _squared_apart(arc: Components, velocity: Components, dt_s: float) -> Components:
    """Return the squares of what a step differs by from going on at a velocity [m^2, m^2, rad^2]."""
    ahead_m, left_m = arc.along - velocity.along * dt_s, arc.across - velocity.across * dt_s
    turn_rad = wrap_angle(arc.turn - velocity.turn * dt_s)
    return Components(ahead_m * ahead_m, left_m * left_m, turn_rad * turn_rad)
