"""What localizers say of the same motion, two by two: differences, and the covariances that both state for them.

Motion is compared with motion over windows of a second; absolute estimates with each other along the motion between
them, over a short way, where the noise of single estimates shows, and over a long one, where an error shows that is
constant in place.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Iterator
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from trailmark.arrays import Floats
from trailmark.deprecation import deprecated_name
from trailmark.estimation.symmetric import Sym3, congruence, subtract
from trailmark.geometry import wrap_angle

__all__ = ["BESIDE_S", "FixRow", "FixTrack", "RecentMotions", "Residual", "fix_residual", "motion_residual"]

#: How long what was said is kept [s].
KEPT_S = 14.0
_SAME_STAMP_S = 1e-6
# Below this information nothing was measured.
_LEAST_INFORMATION = 1e-9
# An eigenvalue below this share of the largest, units scaled away, is a direction that was not measured.
_LEAST_SHARE = 1e-9
#: Column of a motion's table after what was told of it; the inverse of its information follows.
_SHARE = 11
# Variance of what was not measured [m^2].
_UNMEASURED_M2 = 1e12


#: Stamps are moved by so much to either side, to see what a delay changes [s].
BESIDE_S = 0.2


#: Stamp, x, y, theta of an absolute pose, and its covariance.
FixRow = tuple[float, float, float, float, Sym3]
#: x, y and heading or turn [m, m, rad].
PoseRow = tuple[float, float, float]


class Residual(NamedTuple):
    """A difference of what localizers say, which is zero but for their errors.

    Attributes
    ----------
    value : (d,) float64
        The difference: x, y, heading; or the heading alone [m, m, rad].
    covariances : (m, d, d) float64
        The share of each of m localizers in its covariance, as they state it.
    since_s, stamp_s : float
        The time that it is about [s].
    by_delay : (d,) float64 or None
        By how much it changes for each second by which the stamps of both poses are late; None of motions [m/s, rad/s].
    by_scale : (d,) float64 or None
        By how much it changes with the share by which the motion tells too long a way; None of motions [m].
    """

    value: Floats
    covariances: Floats
    since_s: float
    stamp_s: float
    by_delay: Floats | None = None
    by_scale: Floats | None = None


class RecentMotions:
    """The motions of one localizer of late, and sums of them that tell what it says between any two stamps."""

    def __init__(self) -> None:
        self._rows: deque[tuple[float, ...]] = deque()
        self._chain: _Chain | None = None
        #: The rows of the last chain with what takes long to compute of each, and how many rows have come since.
        self._table = np.empty((0, 0))
        self._n_new = 0

    def add(self, row: tuple[float, ...]) -> None:
        """Add a motion: since, stamp, x, y, turn and its information as six numbers, in the order of `Sym3`."""
        rows = self._rows
        if rows and row[0] < rows[-1][1] - _SAME_STAMP_S:
            return
        self._chain = None
        self._n_new += 1
        rows.append(row)
        while rows[0][1] < row[1] - KEPT_S:
            rows.popleft()

    def clear(self) -> None:
        """Forget all."""
        self._rows.clear()
        self._chain, self._n_new = None, 0

    def chain(self) -> _Chain | None:
        """Return the motions since the last gap as one chain; None where there are too few."""
        if self._chain is None and len(self._rows) > 1:
            n_known = max(0, len(self._rows) - self._n_new)
            if self._n_new or n_known != len(self._table):
                fresh = _with_covariances(np.array([*islice(self._rows, n_known, None)]))
                known = self._table[len(self._table) - n_known :] if n_known else fresh[:0]
                self._table, self._n_new = np.concatenate([known, fresh]), 0
            self._chain = _Chain(self._table)
        return self._chain

    @property
    def mean_interval_s(self) -> float:
        """Mean time between its stamps [s]."""
        rows = self._rows
        return (rows[-1][1] - rows[0][0]) / len(rows) if rows else math.inf


class FixTrack:
    """The whole absolute poses of one localizer of late."""

    def __init__(self) -> None:
        self.rows: deque[FixRow] = deque()

    def add(self, row: FixRow) -> None:
        """Add a pose."""
        rows = self.rows
        if rows and row[0] <= rows[-1][0]:
            return
        rows.append(row)
        while rows[0][0] < row[0] - KEPT_S:
            rows.popleft()

    def clear(self) -> None:
        """Forget all."""
        self.rows.clear()


class _Chain:
    """Motions end to end, in axes fixed to where they begin.

    With ``J(v)`` the effect of a turn about base on a point at v, the error of the pose at b relative to that at a is
    ``J(p_b)`` times a sum over the motions between, so differences of sums tell its covariance.
    """

    def __init__(self, rows: Floats) -> None:
        apart_s: Floats = rows[1:, 0] - rows[:-1, 1]
        gaps = np.flatnonzero(np.abs(apart_s) > _SAME_STAMP_S)
        rows = rows[gaps[-1] + 1 :] if len(gaps) else rows
        n = len(rows)
        # of numbers in lists the search and the arithmetic take a tenth of the time
        self.stamps_s: list[float] = [float(rows[0, 0]), *rows[:, 1].tolist()]
        headings = np.append(0.0, np.cumsum(rows[:, 4]))
        cos, sin = np.cos(headings[:-1]), np.sin(headings[:-1])
        poses = np.zeros((n + 1, 3))
        poses[1:, 0] = np.cumsum(cos * rows[:, 2] - sin * rows[:, 3])
        poses[1:, 1] = np.cumsum(sin * rows[:, 2] + cos * rows[:, 3])
        poses[:, 2] = headings
        heading_information = rows[:, 10]
        self.knows_place = bool((rows[:, _SHARE] > _LEAST_SHARE).all())
        alone = (rows[:, [7, 9]] == 0.0).all(axis=1)
        self.knows_heading = bool(((heading_information > _LEAST_INFORMATION) & alone).all()) or self.knows_place
        if self.knows_place:
            covariance = rows[:, _SHARE + 1 :].reshape(n, 3, 3)
        else:
            covariance = np.zeros((n, 3, 3))
            covariance[:, [0, 1], [0, 1]] = _UNMEASURED_M2
            covariance[:, 2, 2] = 1.0 / np.maximum(heading_information, _LEAST_INFORMATION)
        moved = np.zeros((n, 3, 3))  # turned, and moved to where the chain begins
        moved[:, 0, 0] = moved[:, 1, 1] = cos
        moved[:, 0, 1], moved[:, 1, 0], moved[:, 2, 2] = -sin, sin, 1.0
        moved[:, 0, 2], moved[:, 1, 2] = poses[1:, 1], -poses[1:, 0]
        self._poses: list[PoseRow] = [(x, y, heading) for x, y, heading in poses.tolist()]
        self._sums = np.zeros((n + 1, 3, 3))
        np.cumsum(moved @ covariance @ moved.transpose(0, 2, 1), axis=0, out=self._sums[1:])

    def covers(self, since_s: float, stamp_s: float) -> bool:
        """Return whether it says something of all of an interval."""
        return self.stamps_s[0] - _SAME_STAMP_S <= since_s and stamp_s <= self.stamps_s[-1] + _SAME_STAMP_S

    def between(self, since_s: float, stamp_s: float) -> tuple[PoseRow, Sym3]:
        """Return the pose at one stamp seen from base at another, and its covariance in these axes."""
        before, after = self._motion_at(since_s), self._motion_at(stamp_s)
        begin, end = self._pose_at(*before), self._pose_at(*after)
        cos, sin = math.cos(begin[2]), math.sin(begin[2])
        lever_x, lever_y = sin * end[0] - cos * end[1], cos * end[0] + sin * end[1]
        spread = congruence(subtract(self._sum_at(*after), self._sum_at(*before)), cos, -sin, lever_x, lever_y)
        return _seen_from(begin, end), spread

    def step(self, since_s: float, stamp_s: float) -> PoseRow:
        """Return the pose at one stamp seen from base at another."""
        return _seen_from(self._pose_at(*self._motion_at(since_s)), self._pose_at(*self._motion_at(stamp_s)))

    def _motion_at(self, stamp_s: float) -> tuple[int, float]:
        """Return the motion during which a stamp is, and how much of it is over."""
        stamps_s = self.stamps_s
        index = min(max(bisect_left(stamps_s, stamp_s), 1), len(stamps_s) - 1)
        before_s, after_s = stamps_s[index - 1], stamps_s[index]
        return index, min(max((stamp_s - before_s) / (after_s - before_s), 0.0), 1.0)

    def _pose_at(self, index: int, share: float) -> PoseRow:
        (x, y, heading), (end_x, end_y, end_heading) = self._poses[index - 1], self._poses[index]
        rest = 1.0 - share
        return rest * x + share * end_x, rest * y + share * end_y, rest * heading + share * end_heading

    def _sum_at(self, index: int, share: float) -> Sym3:
        total = (1.0 - share) * self._sums[index - 1] + share * self._sums[index]
        xx, xy, xt, _, yy, yt, _, _, tt = total.ravel().tolist()
        return xx, xy, xt, yy, yt, tt


def _seen_from(begin: PoseRow, end: PoseRow) -> PoseRow:
    """Return one pose in the axes of another."""
    cos, sin = math.cos(begin[2]), math.sin(begin[2])
    dx, dy = end[0] - begin[0], end[1] - begin[1]
    return cos * dx + sin * dy, cos * dy - sin * dx, end[2] - begin[2]


def motion_residual(a: RecentMotions, b: RecentMotions, since_s: float, stamp_s: float) -> Residual | None:
    """Return what two localizers' motions differ by over an interval; None where one says nothing of it."""
    first, second = a.chain(), b.chain()
    if first is None or second is None or not (first.covers(since_s, stamp_s) and second.covers(since_s, stamp_s)):
        return None
    (x, y, turn), own = first.between(since_s, stamp_s)
    (other_x, other_y, other_turn), others = second.between(since_s, stamp_s)
    away = np.array([x - other_x, y - other_y, wrap_angle(turn - other_turn)])
    both = _matrices([own, others])
    if first.knows_place and second.knows_place:
        return Residual(away, both, since_s, stamp_s)
    if first.knows_heading and second.knows_heading:
        return Residual(away[2:], both[:, 2:, 2:], since_s, stamp_s)
    return None


def fix_residual(
    earlier: FixRow,
    later: FixRow,
    motion: RecentMotions,
) -> Residual | None:
    """Return by how much two poses differ from the motion between them; None where that is not known.

    The covariances are those of the earlier, of the later, and of the motion.
    """
    chain = motion.chain()
    if chain is None or not chain.knows_place or not chain.covers(earlier[0], later[0]):
        return None
    step, spread = chain.between(earlier[0], later[0])
    cos, sin = math.cos(earlier[3]), math.sin(earlier[3])
    kept, of_turn = _rotation_of_noisy(min(earlier[4][5], math.pi**2))
    moved_x, moved_y = _turned(step, kept * cos, kept * sin)
    away_x, away_y = later[1] - earlier[1] - moved_x, later[2] - earlier[2] - moved_y
    away = np.array([away_x, away_y, wrap_angle(later[3] - earlier[3] - step[2])])
    begun = congruence(earlier[4], 1.0, 0.0, -moved_y, moved_x)
    shares = _matrices([begun, later[4], congruence(spread, cos, sin, 0.0, 0.0)])
    shares[0, :2, :2] += of_turn * np.outer((moved_x, moved_y), (moved_x, moved_y))
    before, after = (chain.step(earlier[0] - dt_s, later[0] - dt_s) for dt_s in (BESIDE_S, -BESIDE_S))
    slope = [(b - a) / (2.0 * BESIDE_S) for a, b in zip(before, after)]
    by_delay = np.array([*_turned((slope[0], slope[1], 0.0), cos, sin), slope[2]])
    by_scale = np.array([-moved_x, -moved_y, 0.0])
    return Residual(away, shares, earlier[0], later[0], by_delay, by_scale)


def _turned(step: PoseRow, cos: float, sin: float) -> tuple[float, float]:
    return cos * step[0] - sin * step[1], sin * step[0] + cos * step[1]


def _rotation_of_noisy(heading_rad2: float) -> tuple[float, float]:
    """Return what a way shrinks to in the mean that is laid along a noisy heading, and what that adds along the way.

    The end of a way of unit length, turned by a normal angle, is on an arc, not on its tangent: for a heading of
    0.6 rad its distance varies by 0.2 in the direction that a linearisation takes for certain.
    """
    mean = math.exp(-0.5 * heading_rad2)
    return mean, 0.5 * ((1.0 - mean * mean) / mean) ** 2


def stamps_apart(chain: _Chain, since_s: float, least_s: float) -> Iterator[tuple[float, float]]:
    """Yield intervals of at least a length between stamps of a chain, end to end, from a stamp on."""
    begin_s = None
    for stamp_s in chain.stamps_s:
        if stamp_s < since_s - _SAME_STAMP_S:
            continue
        if begin_s is None:
            begin_s = stamp_s
        elif stamp_s - begin_s >= least_s - _SAME_STAMP_S:
            yield begin_s, stamp_s
            begin_s = stamp_s


def _matrices(found: list[Sym3]) -> Floats:
    """Return symmetric matrices as (N, 3, 3)."""
    return np.array([[[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]] for xx, xy, xt, yy, yt, tt in found])


def _with_covariances(rows: Floats) -> Floats:
    """Return rows of motions with `_smallest_share` of their information, and its inverse where there is one."""
    n = len(rows)
    information = rows[:, [5, 6, 7, 6, 8, 9, 7, 9, 10]].reshape(n, 3, 3)
    share = _smallest_share(information)
    covariance = np.zeros((n, 3, 3))
    knows_place = share > _LEAST_SHARE
    covariance[knows_place] = _inverse_of_each(information[knows_place])
    return np.column_stack([rows, share, covariance.reshape(n, 9)])


def _smallest_share(information: Floats) -> Floats:
    """Return the smallest eigenvalue of each matrix (N, 3, 3), units scaled away, as a share of the largest."""
    roots = np.sqrt(np.maximum(np.diagonal(information, axis1=1, axis2=2), 1e-300))
    values = np.linalg.eigvalsh(information / (roots[:, :, None] * roots[:, None, :]))
    return np.asarray(values[:, 0] / values[:, 2])


def _inverse_of_each(information: Floats) -> Floats:
    """Return the inverses of matrices (N, 3, 3), whatever the units of their rows."""
    roots = np.sqrt(np.diagonal(information, axis1=1, axis2=2))
    scales = 1.0 / (roots[:, :, None] * roots[:, None, :])
    return np.asarray(np.linalg.inv(information * scales) * scales)


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {"MotionTrack": RecentMotions})
