"""How localizers of one run differ from each other, without any truth: whether they agree within what they state.

It stands beside the reports and not in `evaluation`: nothing that a run or a cell of a bench measures depends on it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.errors import DataError
from trailmark.evaluation.chaining import chain_windows, chained_motion, covariances_of, windows
from trailmark.evaluation.estimates_table import EstimateTable
from trailmark.geometry import Pose2, Trajectory, wrap_angle, wrap_angles

__all__ = ["Difference", "localizer_differences"]

#: Motion is compared over windows of this length, and between two estimates farther apart none is interpolated [s].
_WINDOW_S = 1.0
_SAME_INSTANT_S = 1e-6
#: Fewer pairs say nothing, as of `measured_noise`.
_FEWEST = 10
# A direction with a larger variance was not measured: `covariances_of` makes it 1e6 [m^2, rad^2].
_UNMEASURED = 1e3
# What is farther is no place [m]; an eigenvalue below this share of the largest is rounding.
_NO_PLACE_M, _ROUNDING = 1e9, 1e-6


@dataclass(frozen=True, slots=True)
class Difference:
    """What one localizer says less what another does, of the same instants.

    Attributes
    ----------
    one, other : str
        The localizers.
    kind : str
        ``motion`` (over a second, as seen from its beginning), ``fix`` or ``pathoffset``.
    n : int
        Pairs that were compared.
    mean, rms, largest : (3,) float64
        Of x, y and heading, or station, lateral and heading; NaN where one of the two measures it by itself fewer than
        ten times: the fix of one landmark knows nothing about the circle on which it lies [m, m, rad].
    nees_per_dof : float
        Squared differences in units of what both state together, a number that both measure: 1 where they differ as
        they say.
    """

    one: str
    other: str
    kind: str
    n: int
    mean: Floats
    rms: Floats
    largest: Floats
    nees_per_dof: float

    def document(self) -> dict[str, Any]:
        """Return it as plain data, with headings in degrees; what was not measured is None."""
        numbers = {
            f"{what}_{unit}": [_plain(value) for value in (np.degrees(triple[2:]) if unit == "deg" else triple[:2])]
            for what, triple in (("mean", self.mean), ("rms", self.rms), ("largest", self.largest))
            for unit in ("m", "deg")
        }
        about = {"one": self.one, "other": self.other, "kind": self.kind, "n": self.n}
        return {**about, **numbers, "nees_per_dof": _plain(self.nees_per_dof)}


def localizer_differences(estimates: EstimateTable, reference: str | None = None) -> list[Difference]:
    """Return how each two localizers differ that say the same kind of thing at the same time.

    Poses and path offsets are compared where the one spoke that speaks more seldom, with the other's interpolated along
    an arc between two that are at most a second apart; of several at one instant the first counts. A path that closes
    is not compared where its station begins anew. Motions are chained to windows of a second, or of what a longer one
    covers; motions that overlap are not.

    Parameters
    ----------
    estimates : EstimateTable
        Of a run.
    reference : str, optional
        Only pairs with this localizer: what the others say less what it says.

    Returns
    -------
    list of Difference
        Without pairs of which fewer than ten estimates could be compared, in no number.

    Raises
    ------
    DataError
        If the reference said nothing.
    """
    sources = estimates.sources()
    if reference is not None and reference not in sources:
        raise DataError(f"no localizer {reference!r} said anything; there are {', '.join(sources) or 'none'}")
    pairs = [(one, reference) for one in sources if one != reference] if reference else combinations(sources, 2)
    found = []
    for one, other in pairs:
        for kind in ("motion", "fix", "pathoffset"):
            rows = [_usable(estimates.of(name), kind) for name in (one, other)]
            told = list(_motions(*rows) if kind == "motion" else _singles(*rows))
            if len(told) >= _FEWEST:
                difference = _difference(one, other, kind, told)
                found += [difference] if np.isfinite(difference.rms).any() else []
    return found


def _usable(rows: EstimateTable, kind: str) -> EstimateTable:
    """Return what a localizer said of a kind, in the order of its stamps, one for each."""
    kept = rows.where((rows.kind == kind) & (rows.outcome != "refused"))
    is_usable = (np.abs(kept.numbers) < _NO_PLACE_M).all(axis=1) & np.isfinite(kept.stamp_s)
    is_usable &= np.isfinite(kept.information).all(axis=(1, 2))
    is_usable[is_usable] = _is_information(kept.information[is_usable])
    if kind == "motion":
        is_usable &= kept.stamp_s > kept.since_s
    kept = kept.where(is_usable)
    return kept.where(np.unique(kept.stamp_s, return_index=True)[1])


def _is_information(matrices: Floats) -> Bools:
    """Return which matrices say something, and no less than nothing of any direction."""
    values = np.linalg.eigvalsh(matrices)
    return np.asarray((values[:, -1] > 0.0) & (values[:, 0] >= -_ROUNDING * values[:, -1]))


def _seldom_first(one: EstimateTable, other: EstimateTable) -> tuple[EstimateTable, EstimateTable, float]:
    """Return first who speaks more seldom, and the sign that turns first less second into one less other."""
    intervals_s = [float(np.median(np.diff(rows.stamp_s))) if len(rows) > 1 else math.inf for rows in (one, other)]
    return (one, other, 1.0) if intervals_s[0] >= intervals_s[1] else (other, one, -1.0)


def _singles(one: EstimateTable, other: EstimateTable) -> Iterator[tuple[Floats, Floats]]:
    """Yield differences and their covariances where the one spoke that speaks more seldom."""
    if not len(one) or not len(other):
        return
    sparse, dense, sign = _seldom_first(one, other)
    is_offset = bool(sparse.kind[0] == "pathoffset")
    # A station that jumps by most of the way that there is has begun anew.
    longest_m = 0.5 * float(np.ptp(dense.numbers[:, 0])) if is_offset else 0.0
    spreads = covariances_of(sparse.information), covariances_of(dense.information)
    for row, stamp_s in enumerate(sparse.stamp_s.tolist()):
        around = _around(dense.stamp_s, stamp_s)
        if around is None:
            continue
        first, last, share = around
        step = dense.numbers[last] - dense.numbers[first]
        if is_offset:
            expected = dense.numbers[first] + share * np.array([step[0], step[1], wrap_angle(float(step[2]))])
        else:
            expected = _on_arc(dense.numbers[first], dense.numbers[last], share)
        value = sparse.numbers[row] - expected
        value[2] = wrap_angle(float(value[2]))
        if longest_m and max(abs(float(step[0])), abs(float(value[0]))) > longest_m:
            continue
        covariance = (1.0 - share) ** 2 * spreads[1][first] + share * share * spreads[1][last]
        yield sign * value, spreads[0][row] + covariance


def _around(stamps_s: Floats, stamp_s: float) -> tuple[int, int, float] | None:
    """Return the rows before and after a time, and how far between them it is; None across a gap."""
    end = int(np.searchsorted(stamps_s, stamp_s))
    for row in (end - 1, end):
        if 0 <= row < len(stamps_s) and abs(stamps_s[row] - stamp_s) <= _SAME_INSTANT_S:
            return row, row, 0.0
    if not 0 < end < len(stamps_s) or stamps_s[end] - stamps_s[end - 1] > _WINDOW_S + _SAME_INSTANT_S:
        return None
    return end - 1, end, float((stamp_s - stamps_s[end - 1]) / (stamps_s[end] - stamps_s[end - 1]))


def _on_arc(first: Floats, last: Floats, share: float) -> Floats:
    """Return the pose between two, x, y and heading, on the arc that a robot drives from one to the other."""
    before = Pose2.from_array(first)
    forward_m, left_m, turn_rad = before.between(Pose2.from_array(last)).log()
    return (before @ Pose2.exp(share * forward_m, share * left_m, share * turn_rad)).array()


def _motions(one: EstimateTable, other: EstimateTable) -> Iterator[tuple[Floats, Floats]]:
    """Yield differences of motion over windows of a second, and their covariances."""
    if not len(one) or not len(other):
        return
    sparse, dense, sign = _seldom_first(one, other)
    pieces = list(windows(sparse.since_s, sparse.stamp_s, sparse.stamp_s - sparse.since_s, _WINDOW_S))
    spread, spread_dense = covariances_of(sparse.information), covariances_of(dense.information)
    ways = list(_ways(dense))
    begins_s = np.array([way.stamps_s[0] for way in ways])
    for value, covariance, first, last in zip(*chain_windows(sparse.numbers, spread, pieces)):
        begin_s, end_s = float(sparse.since_s[first]), float(sparse.stamp_s[last])
        way = ways[max(0, int(np.searchsorted(begins_s, begin_s + _SAME_INSTANT_S)) - 1)]
        if not _covers(way, begin_s, end_s):
            continue
        (_, since), (_, now) = way.at(np.clip([begin_s, end_s], way.stamps_s[0], way.stamps_s[-1]))
        inside = slice(
            int(np.searchsorted(dense.stamp_s, begin_s + _SAME_INSTANT_S)),
            int(np.searchsorted(dense.since_s, end_s - _SAME_INSTANT_S)),
        )
        since_s, stamp_s = dense.since_s[inside], dense.stamp_s[inside]
        share = ((np.minimum(stamp_s, end_s) - np.maximum(since_s, begin_s)) / (stamp_s - since_s))[:, None, None]
        # A part of a motion is interpolated, and with it its error.
        of_dense = chained_motion(dense.numbers[inside], share * share * spread_dense[inside])[1]
        difference = value - since.between(now).array()
        difference[2] = wrap_angle(float(difference[2]))
        yield sign * difference, covariance + of_dense


def _covers(way: Trajectory, begin_s: float, end_s: float) -> bool:
    return bool(way.stamps_s[0] <= begin_s + _SAME_INSTANT_S and end_s - _SAME_INSTANT_S <= way.stamps_s[-1])


def _ways(rows: EstimateTable) -> Iterator[Trajectory]:
    """Yield motions that follow each other without a gap as ways, each from where it begins."""
    gaps = np.flatnonzero(np.abs(rows.since_s[1:] - rows.stamp_s[:-1]) > _SAME_INSTANT_S) + 1
    for part in np.split(np.arange(len(rows)), gaps):
        steps = rows.numbers[part]
        headings = np.concatenate([[0.0], np.cumsum(steps[:, 2])])
        cos, sin = np.cos(headings[:-1]), np.sin(headings[:-1])
        moves = np.stack([cos * steps[:, 0] - sin * steps[:, 1], sin * steps[:, 0] + cos * steps[:, 1]], axis=1)
        places = np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])
        stamps_s = np.concatenate([rows.since_s[part[:1]], rows.stamp_s[part]])
        yield Trajectory(stamps_s, np.column_stack([places, wrap_angles(headings)]))


def _difference(one: str, other: str, kind: str, told: list[tuple[Floats, Floats]]) -> Difference:
    values, covariances = (np.array(items) for items in zip(*told, strict=True))
    is_measured = np.diagonal(covariances, axis1=1, axis2=2) < _UNMEASURED
    is_measured &= is_measured.sum(axis=0) >= _FEWEST
    dof = int((np.linalg.eigvalsh(covariances) < _UNMEASURED).sum()) if is_measured.any() else 0
    squares = float(np.einsum("ni,ni->", values, np.linalg.solve(covariances, values[:, :, None])[:, :, 0]))
    mean, rms, largest = (
        np.array([of(column[known]) if known.any() else math.nan for column, known in zip(values.T, is_measured.T)])
        for of in (_mean, _rms, _largest)
    )
    return Difference(one, other, kind, len(told), mean, rms, largest, squares / dof if dof else math.nan)


def _mean(values: Floats) -> float:
    return float(values.mean())


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values * values)))


def _largest(values: Floats) -> float:
    return float(np.abs(values).max())


def _plain(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
