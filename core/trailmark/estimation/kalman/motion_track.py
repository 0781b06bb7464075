"""The motions of one localizer, each counted for what it adds: no time counts twice.

A key-frame odometry may tell of 0 to 2 s and then of 1 to 3 s. What such a motion adds is where base is at its end, as
seen from where the motions before have it at its beginning. So what both cover is counted once, and the poses at the
ends are those that were told.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right

from trailmark.estimation.kalman.motion_steps import StatedMotion
from trailmark.estimation.overlaps import LONG_OVERLAP, unevenness
from trailmark.estimation.symmetric import ZERO, Sym3
from trailmark.geometry import Pose2

__all__ = ["MotionTrack"]

# Stamps this close are one instant: they went through decimals on their way.
_SAME_INSTANT_S = 1e-6
# A motion of which less is new waits for one of which more is: until then it is the newest, and may be replaced.
_NEW_ENOUGH = 0.5


class MotionTrack:
    """The motions of one localizer, by their beginnings, and what each adds.

    Parameters
    ----------
    drift : Sym3
        Covariance of a step of 1 s that nobody measured: by how much the velocities within a motion differ.

    Attributes
    ----------
    pieces : list of StatedMotion
        What counts, in the order of time, without overlap.
    n_overlaps : int
        Motions that began well before another one ended.
    overlapped_s : float
        End of the last such motion; ``-inf`` if there is none [s].
    """

    __slots__ = ("_drift", "_motions", "_pieces_since", "_sinces", "n_overlaps", "overlapped_s", "pieces")

    def __init__(self, drift: Sym3) -> None:
        self._drift = drift
        self._sinces: list[float] = []
        self._motions: list[StatedMotion] = []
        self._pieces_since: list[float] = []
        self.pieces: list[StatedMotion] = []
        self.n_overlaps = 0
        self.overlapped_s = -math.inf

    def add(self, motion: StatedMotion) -> bool:
        """Keep a motion; False if the same interval has been told already."""
        sinces = self._sinces
        if self._is_next(motion):
            self._insert(len(sinces), motion)
            self._append(motion)
            return True
        index = bisect_right(sinces, motion.since_s)
        before = index
        while before and sinces[before - 1] == motion.since_s:
            before -= 1
            if self._motions[before].stamp_s == motion.stamp_s:
                return False
            if self._motions[before].stamp_s > motion.stamp_s:
                index = before  # of one beginning, the one that ends first stands first
        self._note_overlap(motion, index)
        self._insert(index, motion)
        self._rebuild(motion.since_s)
        return True

    def changed_by(self, motion: StatedMotion) -> float:
        """Return since when the pieces may change if a motion is added; ``-inf`` if they are found anew [s]."""
        return motion.since_s if self._is_next(motion) else -math.inf

    def _is_next(self, motion: StatedMotion) -> bool:
        """Return whether a motion begins where all that was told before has ended, or is the first."""
        sinces, pieces = self._sinces, self.pieces
        # `forget` may leave a motion of which nothing counts: then there are no pieces.
        return not sinces or bool(
            pieces and motion.since_s > sinces[-1] and motion.since_s >= pieces[-1].stamp_s - _SAME_INSTANT_S
        )

    def uses(self, motion: StatedMotion) -> bool:
        """Return whether a motion counts, at least for a part of its time."""
        index = bisect_left(self._pieces_since, motion.stamp_s)
        while index and self.pieces[index - 1].stamp_s > motion.since_s:
            index -= 1
            if self.pieces[index].origin is motion.origin:
                return True
        return False

    def covering(self, since_s: float, stamp_s: float) -> StatedMotion | None:
        """Return the piece that covers an interval without cuts."""
        last = bisect_right(self._pieces_since, since_s) - 1
        for index in (last - 1, last):  # where two meet within rounding, the one that began first
            if index >= 0 and self.pieces[index].stamp_s >= stamp_s:
                return self.pieces[index]
        return None

    def begins(self, since_s: float, stamp_s: float) -> bool:
        """Return whether the piece that covers an interval without cuts begins with it."""
        piece = self.covering(since_s, stamp_s)
        return piece is not None and piece.since_s > since_s - _SAME_INSTANT_S

    def cuts(self, since_s: float, stamp_s: float) -> list[float]:
        """Return the beginnings and ends of pieces that lie strictly inside an interval."""
        found: list[float] = []
        index = bisect_left(self._pieces_since, stamp_s)
        while index:
            index -= 1
            piece = self.pieces[index]
            if since_s < piece.since_s:  # and it lies before `stamp_s`
                found.append(piece.since_s)
            if since_s < piece.stamp_s < stamp_s:
                found.append(piece.stamp_s)
            elif piece.stamp_s <= since_s:
                break
        return found

    def forget(self, horizon_s: float) -> None:
        """Drop the motions at the beginning that end before a stamp."""
        n_old = n_done = 0
        while n_old < len(self._motions) and self._motions[n_old].stamp_s < horizon_s:
            n_old += 1
        while n_done < len(self.pieces) and self.pieces[n_done].stamp_s < horizon_s:
            n_done += 1
        del self._sinces[:n_old], self._motions[:n_old]
        del self._pieces_since[:n_done], self.pieces[:n_done]

    def _insert(self, index: int, motion: StatedMotion) -> None:
        self._sinces.insert(index, motion.since_s)
        self._motions.insert(index, motion)

    def _append(self, piece: StatedMotion) -> None:
        self._pieces_since.append(piece.since_s)
        self.pieces.append(piece)

    def _note_overlap(self, motion: StatedMotion, index: int) -> None:
        """Take note of a motion that has much of its time in common with the one before or after it."""
        beside = [*self._motions[max(index - 1, 0) : index], *self._motions[index : index + 1]]
        common_s = max(
            (min(motion.stamp_s, other.stamp_s) - max(motion.since_s, other.since_s) for other in beside), default=0.0
        )
        if common_s > LONG_OVERLAP * (motion.stamp_s - motion.since_s):
            self.n_overlaps += 1
            self.overlapped_s = max(self.overlapped_s, motion.stamp_s)

    def _rebuild(self, since_s: float) -> None:
        """Find anew what counts, of the motions that began at a stamp or later.

        The result depends on what was told alone, not on the order in which it came.
        """
        while self.pieces and self.pieces[-1].origin.stamp_s > since_s + _SAME_INSTANT_S:
            self.pieces.pop()
            self._pieces_since.pop()
        end_s, index = -math.inf, 0
        if self.pieces:
            end_s, origin = self.pieces[-1].stamp_s, self.pieces[-1].origin
            index = bisect_left(self._sinces, origin.since_s)
            while self._motions[index].origin is not origin:
                index += 1
            index += 1
        waiting: StatedMotion | None = None
        for motion in self._motions[index:]:
            if motion.stamp_s <= end_s + _SAME_INSTANT_S:
                continue
            if motion.since_s >= end_s - _SAME_INSTANT_S:
                if waiting is not None:
                    self._append_rest(waiting, end_s, min(waiting.stamp_s, motion.since_s))
                self._append(motion)
            elif motion.stamp_s - end_s >= _NEW_ENOUGH * (motion.stamp_s - motion.since_s):
                self._append_rest(motion, end_s, motion.stamp_s)
            else:
                if waiting is None or motion.stamp_s > waiting.stamp_s:
                    waiting = motion
                continue
            waiting, end_s = None, motion.stamp_s
        if waiting is not None:
            self._append_rest(waiting, end_s, waiting.stamp_s)

    def _append_rest(self, motion: StatedMotion, end_s: float, until_s: float) -> None:
        """Add what a motion says of the time after another one's end."""
        if until_s <= end_s + _SAME_INSTANT_S:
            return
        rest = motion.rest_behind(*self._way_since(motion, end_s), end_s)
        share = (motion.stamp_s - end_s) / (motion.stamp_s - motion.since_s)
        if share < _NEW_ENOUGH:  # two errors, of its own end and of the end before, for little time
            rest = rest.less_certain((2.0 - share) / share)
        self._append(rest.until(until_s))

    def _way_since(self, motion: StatedMotion, end_s: float) -> tuple[Pose2, Sym3]:
        """Return the way from a motion's beginning to the end of the pieces, and how uncertain a cut makes it."""
        since_s = motion.since_s
        index = bisect_right(self._pieces_since, since_s + _SAME_INSTANT_S) - 1
        if index < 0:  # what was before is forgotten: the motion itself says it
            return self._part_way(motion, motion, since_s, end_s)
        piece, uneven = self.pieces[index], ZERO
        way = piece.pose
        if since_s >= piece.stamp_s:
            way = Pose2()
        elif since_s > piece.since_s + _SAME_INSTANT_S:
            way, uneven = self._part_way(piece, motion, since_s, piece.stamp_s)
        for later in self.pieces[index + 1 :]:
            way = way @ later.pose
        return way, uneven

    def _part_way(self, cut: StatedMotion, after: StatedMotion, since_s: float, stamp_s: float) -> tuple[Pose2, Sym3]:
        """Return the way over a part of a motion that begins or ends with it, and how uncertain the cut makes it."""
        step, part_s = cut.between(since_s, stamp_s), stamp_s - since_s
        rest_s = cut.stamp_s - cut.since_s - part_s
        uneven = unevenness(part_s, rest_s, twist=step.twist, next_twist=after.twist, drift=self._drift)
        return Pose2(step.x, step.y, step.turn), uneven
