"""Times without a reading of wheels, and whether the step across one holds what was driven meanwhile.

Wheels of which messages were lost count on, and the next reading holds the whole way. Wheels that were off, or were
started anew, go on from where their pose had been, or from anywhere: then the way of the gap is missing, and nothing in
the reading says so. What tells them apart is how the robot drove: a step as long as if it had gone on was counted.
"""

from __future__ import annotations

import math

from trailmark.geometry import Twist2, wrap_angle

__all__ = ["ReadingGaps"]

# A time is a gap from so many usual ones on, if it is longer than a robot takes to change its speed [s].
_PERIODS, _SHORT_S = 4.0, 0.25
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

_Three = tuple[float, float, float]


class ReadingGaps:
    """Knows how often readings come and how fast the robot drives, and judges a step by it.

    Parameters
    ----------
    max_gap_s : float
        A time without a reading is a gap if it is longer, however seldom readings come [s].
    """

    __slots__ = ("_body", "_fastest_mps", "_fastest_radps", "_max_gap_s", "_usual_s")

    def __init__(self, max_gap_s: float) -> None:
        self._max_gap_s = max_gap_s
        self._usual_s = math.inf
        self._fastest_mps = self._fastest_radps = 0.0
        self._body: _Three | None = None  # its velocity, forward, to the left and of the turn

    def is_gap(self, dt_s: float) -> bool:
        """Return whether readings so far apart have a gap between them."""
        return dt_s > self._max_gap_s or dt_s > max(_PERIODS * self._usual_s, _SHORT_S)

    def is_impossible(self, way_m: float, dt_s: float) -> bool:
        """Return whether a step is faster than anything that this robot was seen to do."""
        return self._body is not None and way_m > _IMPOSSIBLE * self._fastest_mps * dt_s + _LITTLE_M

    def why_unknown(self, arc: _Three, after: Twist2 | None, dt_s: float) -> str:
        """Return in words why a step across a gap does not say what was driven in it; empty: it does.

        Parameters
        ----------
        arc : (float, float, float)
            Logarithm of the step: forward, to the left and turn [m, m, rad].
        after : Twist2 or None
            The speed that the reading behind the gap tells.
        dt_s : float
            Length of the gap [s].
        """
        body = self._body
        if body is None:
            return "and nothing says how fast the robot was"
        vx, vy, yaw = body
        if after is not None:  # it may have changed its speed meanwhile
            vx, vy, yaw = (vx + after.forward_mps) / 2.0, (vy + after.left_mps) / 2.0, (yaw + after.yaw_radps) / 2.0
        speed_mps, way_m, turn_rad = math.hypot(vx, vy), math.hypot(arc[0], arc[1]), abs(arc[2])
        expected_m, expected_rad = speed_mps * dt_s, abs(yaw) * dt_s
        if expected_m > _LITTLE_M:
            ahead_m = (arc[0] * vx + arc[1] * vy) / speed_mps
            if ahead_m < _LEAST * expected_m:
                return f"its pose goes on {ahead_m:.2g} m ahead, where the robot would have driven {expected_m:.2g}"
        elif expected_rad > _LITTLE_RAD and arc[2] * yaw < _LEAST * expected_rad * abs(yaw):
            told_deg, expected_deg = math.degrees(arc[2]), math.degrees(yaw * dt_s)
            return f"its heading goes on by {told_deg:.2g} deg, where the robot would have turned by {expected_deg:.2g}"
        elif dt_s > self._max_gap_s and max(way_m, _LITTLE_M * turn_rad / _LITTLE_RAD) <= _LITTLE_M:
            return "and whether it drove meanwhile its pose does not say"
        if way_m > max(_MOST * expected_m, _FASTER * self._fastest_mps * dt_s) + _LITTLE_M:
            return f"its pose goes on {way_m:.2g} m away, where the robot would have driven {expected_m:.2g}"
        if turn_rad > max(_MOST * expected_rad, _FASTER * self._fastest_radps * dt_s) + _LITTLE_RAD:
            return f"its heading goes on by {math.degrees(arc[2]):.2g} deg, which is faster than it ever turned"
        return ""

    def variances(self, arc: _Three, dt_s: float, before: Twist2 | None, late: _Three) -> _Three:
        """Return the variances along, across and of the turn that a gap adds to a step that holds its way.

        It may be short of a part: it is as uncertain as it differs from going on. Who stood may have driven meanwhile.

        Parameters
        ----------
        arc : (float, float, float)
            Logarithm of the step: forward, to the left and turn [m, m, rad].
        dt_s : float
            Length of the gap [s].
        before : Twist2 or None
            The speed that the reading before the gap tells: commands that have just changed.
        late : (float, float, float)
            The variances that it has already [m^2, m^2, rad^2].
        """
        body = self._body
        if body is None:
            return 0.0, 0.0, 0.0
        unseen_m2 = unseen_rad2 = 0.0
        if math.hypot(body[0], body[1]) < _AT_REST_MPS and abs(body[2]) < _AT_REST_RADPS:
            unseen_m2 = (_COVERED * self._fastest_mps * dt_s) ** 2
            unseen_rad2 = (_COVERED * self._fastest_radps * dt_s) ** 2
        ahead_m2, left_m2, turn_rad2 = _squared_apart(arc, body, dt_s)
        if before is not None:
            told = before.forward_mps, before.left_mps, before.yaw_radps
            ahead_m2, left_m2, turn_rad2 = map(min, (ahead_m2, left_m2, turn_rad2), _squared_apart(arc, told, dt_s))
        return (
            max(ahead_m2 - late[0], unseen_m2),
            max(left_m2 - late[1], unseen_m2),
            max(turn_rad2 - late[2], unseen_rad2),
        )

    def note_interval(self, dt_s: float) -> None:
        """Take note of when a reading came, believed or not: the pace may have changed for good."""
        usual_s = self._usual_s
        if usual_s == math.inf:
            self._usual_s = dt_s
        else:
            share = _GROWS if dt_s > usual_s else _FALLS
            self._usual_s = usual_s + share * (min(dt_s, _PERIODS * usual_s) - usual_s)

    def note_step(self, arc: _Three, dt_s: float) -> None:
        """Take note of a step that was believed."""
        per_s, before = 1.0 / max(dt_s, 1e-9), self._body
        vx, vy, yaw = per_s * arc[0], per_s * arc[1], per_s * arc[2]
        if before is not None:
            share = dt_s / (dt_s + _SMOOTHED_S)
            vx = before[0] + share * (vx - before[0])
            vy = before[1] + share * (vy - before[1])
            yaw = before[2] + share * (yaw - before[2])
        self._body = vx, vy, yaw
        self._fastest_mps = max(self._fastest_mps, math.hypot(vx, vy))
        self._fastest_radps = max(self._fastest_radps, abs(yaw))

    def forget_speed(self) -> None:
        """Begin anew behind a gap or a restart; how fast the robot can be is still known."""
        self._body = None


def _squared_apart(arc: _Three, velocity: _Three, dt_s: float) -> _Three:
    """Return the squares of what a step differs by from going on at a velocity [m^2, m^2, rad^2]."""
    ahead_m, left_m = arc[0] - velocity[0] * dt_s, arc[1] - velocity[1] * dt_s
    turn_rad = wrap_angle(arc[2] - velocity[2] * dt_s)
    return ahead_m * ahead_m, left_m * left_m, turn_rad * turn_rad
