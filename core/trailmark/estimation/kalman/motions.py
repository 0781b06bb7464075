"""What several localizers say of the motion between any two stamps.

Their intervals are cut at each other's ends. Within a shared piece each says a step, that of its constant twist. Of two
motions of *one* localizer that overlap, the one that began first counts. `weighing` makes one step of several.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from typing import Any

from trailmark.deprecation import deprecated_name
from trailmark.estimates import Motion
from trailmark.estimation.symmetric import ZERO, Sym3, congruence, inverse, scaled
from trailmark.geometry import Pose2, Twist2
from trailmark.values import quick_dataclass

__all__ = ["MotionStep", "Motions", "StatedMotion"]


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
    """

    x: float
    y: float
    turn: float
    covariance: Sym3 | None
    information: Sym3 | None
    twist: Twist2


class StatedMotion:
    """A `Motion` with its checked information, and what it says of a part of its interval.

    Parameters
    ----------
    motion : Motion
        What was said.
    information : Sym3
        As it is believed.
    """

    __slots__ = ("_arc", "_spread", "_whole", "since_s", "stamp_s")

    def __init__(self, motion: Motion, information: Sym3) -> None:
        self.since_s, self.stamp_s = motion.since_s, motion.stamp_s
        pose, dt_s = motion.pose_since_now, motion.stamp_s - motion.since_s
        self._arc = pose.log()
        forward_m, left_m, turn_rad = self._arc
        twist = Twist2(forward_m / dt_s, left_m / dt_s, turn_rad / dt_s)
        covariance = inverse(information)
        rest = information if covariance is None else None
        self._whole = MotionStep(pose.x, pose.y, pose.theta, covariance, rest, twist)
        self._spread: Sym3 | None = None

    def between(self, since_s: float, stamp_s: float) -> MotionStep:
        """Return the step over a part of the interval.

        The error is spread evenly over the time as a small motion of all space about base at the beginning. In these
        coordinates the errors of parts just add up, so that the parts together are as uncertain as the whole.
        """
        if since_s == self.since_s and stamp_s == self.stamp_s:
            return self._whole
        dt_s = self.stamp_s - self.since_s
        begin, end = self._pose((since_s - self.since_s) / dt_s), self._pose((stamp_s - self.since_s) / dt_s)
        fraction = (stamp_s - since_s) / dt_s
        step, whole = begin.between(end), self._whole
        if whole.covariance is None:
            information = scaled(whole.information or ZERO, 1.0 / fraction)  # to the first order of the turn
            return MotionStep(step.x, step.y, step.theta, None, information, whole.twist)
        if self._spread is None:
            self._spread = congruence(whole.covariance, 1.0, 0.0, whole.y, -whole.x)
        cos, sin = math.cos(begin.theta), math.sin(begin.theta)
        lever_x, lever_y = cos * -end.y + sin * end.x, sin * end.y + cos * end.x
        covariance = congruence(scaled(self._spread, fraction), cos, -sin, lever_x, lever_y)
        return MotionStep(step.x, step.y, step.theta, covariance, None, whole.twist)

    def _pose(self, fraction: float) -> Pose2:
        forward_m, left_m, turn_rad = self._arc
        return Pose2.exp(fraction * forward_m, fraction * left_m, fraction * turn_rad)


class _StampedMotions:
    """The motions of one localizer, by their beginnings."""

    __slots__ = ("longest_s", "motions", "sinces")

    def __init__(self) -> None:
        self.sinces: list[float] = []
        self.motions: list[StatedMotion] = []
        self.longest_s = 0.0

    def add(self, motion: StatedMotion) -> bool:
        index = bisect_right(self.sinces, motion.since_s)
        before = index
        while before and self.sinces[before - 1] == motion.since_s:
            before -= 1
            if self.motions[before].stamp_s == motion.stamp_s:
                return False
            if self.motions[before].stamp_s > motion.stamp_s:
                index = before  # of one beginning, the one that ends first stands first
        self.sinces.insert(index, motion.since_s)
        self.motions.insert(index, motion)
        self.longest_s = max(self.longest_s, motion.stamp_s - motion.since_s)
        return True

    def covering(self, since_s: float, stamp_s: float) -> StatedMotion | None:
        """Return the motion that covers an interval; of several the one that began first."""
        last = bisect_right(self.sinces, since_s)
        first = last
        while first and self.sinces[first - 1] >= stamp_s - self.longest_s:
            first -= 1
        first = max(0, first - 1)  # rounding of the longest
        for index in range(first, last):
            if self.motions[index].stamp_s >= stamp_s:
                return self.motions[index]
        return None

    def ends_between(self, since_s: float, stamp_s: float) -> list[float]:
        """Return the beginnings and ends that lie strictly inside an interval."""
        last = bisect_left(self.sinces, stamp_s)
        index, found = last, []
        earliest_s = since_s - self.longest_s
        while index and self.sinces[index - 1] >= earliest_s:
            index -= 1
            if since_s < self.sinces[index]:  # and it lies before `stamp_s`
                found.append(self.sinces[index])
            if since_s < self.motions[index].stamp_s < stamp_s:
                found.append(self.motions[index].stamp_s)
        return found

    def forget(self, horizon_s: float) -> None:
        """Drop the motions at the beginning that end before a stamp."""
        n_old = 0
        while n_old < len(self.motions) and self.motions[n_old].stamp_s < horizon_s:
            n_old += 1
        del self.sinces[:n_old], self.motions[:n_old]


class Motions:
    """All motions of a window of time.

    Attributes
    ----------
    n_added : int
        Grows with every motion: what was predicted with fewer is out of date.
    """

    def __init__(self) -> None:
        self.n_added = 0
        self._tracks: dict[str, _StampedMotions] = {}

    def add(self, source: str, motion: StatedMotion) -> bool:
        """Keep a motion; False if this localizer has told of the same interval already."""
        self.n_added += 1
        track = self._tracks.get(source)
        if track is None:
            # In the order of names: the sum of several steps is then the same, to the last bit, whoever came first.
            self._tracks = dict(sorted((self._tracks | {source: (track := _StampedMotions())}).items()))
        return track.add(motion)

    def cuts(self, since_s: float, stamp_s: float) -> list[float]:
        """Return the stamps strictly inside an interval at which a motion begins or ends, in order."""
        found = [at for track in self._tracks.values() for at in track.ends_between(since_s, stamp_s)]
        return sorted(set(found)) if found else found

    def steps(self, since_s: float, stamp_s: float) -> list[tuple[str, MotionStep]]:
        """Return what each localizer says of an interval without cuts; empty: nobody measured it."""
        steps = []
        for source, track in self._tracks.items():
            motion = track.covering(since_s, stamp_s)
            if motion is not None:
                steps.append((source, motion.between(since_s, stamp_s)))
        return steps

    def forget(self, horizon_s: float) -> None:
        """Drop what lies before a stamp."""
        for track in self._tracks.values():
            track.forget(horizon_s)


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {"Step": MotionStep})
