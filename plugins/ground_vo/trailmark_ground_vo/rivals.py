"""Whether another motion explains two pictures better than the one that was found.

Reference pixels are the steepest ones. Marks on the lens can be steeper than all the ground, hold the search, and say
that the content stands still. Most pixels of the picture lie off the marks, though: the median of all differences is
small where the ground has moved to, and large where the marks say. How large depends on the ground, so neither noise
nor a wrong motion elsewhere tells what is too large; what another motion leaves does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import product

from trailmark.arrays import Grey16
from trailmark_ground_vo.audit import MotionAudit
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.tracker import TrackedMotion
from trailmark_ground_vo.witness import ShiftVote

__all__ = ["RivalSearch", "least_spread", "stands_still"]

#: Spread of a rival over that of what was found, from which on neither wins, and where a content that stands still, as
#: marks do, has one that moves. Of right motions on pavers, wood_floor and tiles_1k under seven conditions the best
#: rival left 0.92 and more; of those that marks held, 0.12 to 0.2 where the ground was found.
_MOST_SHARE, _MOST_SHARE_STILL = 0.7, 0.85

#: A content that moves less stands still [px].
_STILL_PX = 1.0

#: What a rival says otherwise: own standard deviations of what was found, and more than the descent may be off.
_SIGMAS, _LEAST_PX, _LEAST_RAD = 5.0, 0.9, math.radians(0.25)

#: Steps of the descent, the long ones first [px], [rad], and how often each is tried at most.
_STEPS = ((8.0, math.radians(1.0)), (4.0, math.radians(0.5)), (2.0, math.radians(0.25)), (1.0, math.radians(0.12)))
_MOST_ROUNDS = 6

#: Shifts that phase correlation finds likely, marks and ground among them.
_N_PEAKS = 3


def stands_still(motion: ImageMotion) -> bool:
    """Return whether a content stands still, as what is fixed to the lens does."""
    return math.hypot(motion.u, motion.v) < _STILL_PX


def least_spread(spread_of: Callable[[ImageMotion], float], starts: Sequence[ImageMotion]) -> tuple[ImageMotion, float]:
    """Return the motion around any of the starts that leaves the least spread, to about a pixel, and that spread.

    Parameters
    ----------
    spread_of : callable
        Spread of the differences that a motion leaves.
    starts : sequence of ImageMotion
        At least one; the descent goes on from the best of them.
    """
    best = min(starts, key=spread_of)
    least = spread_of(best)
    for px, rad in _STEPS:
        for _ in range(_MOST_ROUNDS):
            around = [
                ImageMotion(best.u + a * px, best.v + b * px, best.turn_rad + c * rad)
                for a, b, c in product((-1, 0, 1), repeat=3)
                if abs(a) + abs(b) + abs(c) == 1
            ]
            spread, nearest = min(((spread_of(motion), n) for n, motion in enumerate(around)), key=lambda pair: pair[0])
            if spread >= least:
                break
            best, least = around[nearest], spread
    return best, least


class RivalSearch:
    """Looks for a motion that fits better than one that was found.

    Parameters
    ----------
    audit : MotionAudit
        Tells what a motion leaves.
    """

    def __init__(self, audit: MotionAudit) -> None:
        self._audit = audit
        self._last: ImageMotion | None = None

    def better(self, before: Grey16, now: Grey16, found: TrackedMotion, vote: ShiftVote | None) -> ImageMotion | None:
        """Return a motion of the content that fits far better, and is beyond what was claimed; None if there is none.

        Parameters
        ----------
        before, now : (H, W) uint16
            Smoothed pictures (see `filters.smooth`).
        found : TrackedMotion
            What another motion has to beat.
        vote : ShiftVote or None
            Of phase correlation, whose peaks are tried.
        """
        starts = [found.motion] if self._last is None else [found.motion, self._last]
        if vote is not None:
            starts += [ImageMotion(u, v, found.motion.turn_rad) for u, v in vote.peaks(_N_PEAKS)]

        def spread_of(motion: ImageMotion) -> float:
            return self._audit.spread(before, now, motion)

        motion, least = least_spread(spread_of, starts)
        most = (_MOST_SHARE_STILL if stands_still(found.motion) else _MOST_SHARE) * spread_of(found.motion)
        self._last = motion if least < most and _is_beyond(motion, found) else None
        return self._last


def _is_beyond(rival: ImageMotion, found: TrackedMotion) -> bool:
    """Return whether a rival is farther away than what was found claims to be wrong."""
    apart = rival.array() - found.motion.array()
    is_far = math.hypot(apart[0], apart[1]) > _LEAST_PX or abs(apart[2]) > _LEAST_RAD
    return bool(is_far and apart @ found.information @ apart > _SIGMAS**2)
