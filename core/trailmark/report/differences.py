"""How localizers of one run differ from each other, without any truth: whether they agree within what they state."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import DataError
from trailmark.evaluation.chaining import chain_windows, chained_motion, covariances_of, windows
from trailmark.evaluation.estimates_table import EstimateTable
from trailmark.geometry import Trajectory, wrap_angle, wrap_angles

__all__ = ["Difference", "localizer_differences"]

#: Motion is compared over windows of this length, and between two estimates farther apart none is interpolated [s].
_WINDOW_S = 1.0
_SAME_INSTANT_S = 1e-6
#: Fewer pairs say nothing, as of `measured_noise`.
_FEWEST = 10
# A direction with a larger variance was not measured: `covariances_of` makes it 1e6 [m^2, rad^2].
_UNMEASURED = 1e3


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
        Of x, y and heading, or station, lateral and heading; NaN where one of the two does not measure it by itself:
        the fix of one landmark knows nothing about the circle on which it lies [m, m, rad].
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

    Poses and path offsets are compared where the rarer of the two spoke, with the other's interpolated between two that
    are at most a second apart; of several at one instant the first counts. Motions are chained to windows of a second,
    or of what a longer one covers.

    Parameters
    ----------
    estimates : EstimateTable
        Of a run.
    reference : str, optional
        Only pairs with this localizer: what the others say less what it says.

    Returns
    -------
    list of Difference
        Without pairs of which fewer than ten estimates could be compared.

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
                found.append(_difference(one, other, kind, told))
    return found


def _usable(rows: EstimateTable, kind: str) -> EstimateTable:
    """Return what a localizer said of a kind, in the order of its stamps, one for each."""
    is_finite = np.isfinite(rows.numbers).all(axis=1) & np.isfinite(rows.information).all(axis=(1, 2))
    is_usable = (rows.kind == kind) & (rows.outcome != "refused") & is_finite & np.isfinite(rows.stamp_s)
    if kind == "motion":
        is_usable &= rows.stamp_s > rows.since_s
    kept = rows.where(is_usable)
    return kept.where(np.unique(kept.stamp_s, return_index=True)[1])


def _singles(one: EstimateTable, other: EstimateTable) -> Iterator[tuple[Floats, Floats]]:
    """Yield differences and their covariances where the rarer of the two spoke."""
    sparse, dense, sign = (one, other, 1.0) if len(one) <= len(other) else (other, one, -1.0)
    if not len(sparse):
        return
    spreads = covariances_of(sparse.information), covariances_of(dense.information)
    for row, stamp_s in enumerate(sparse.stamp_s.tolist()):
        found = _at(dense, stamp_s)
        if found is not None:
            value, nearest = sparse.numbers[row] - found[0], found[1]
            value[2] = wrap_angle(float(value[2]))
            yield sign * value, spreads[0][row] + spreads[1][nearest]


def _at(rows: EstimateTable, stamp_s: float) -> tuple[Floats, int] | None:
    """Return what a localizer said at a time, interpolated, and the row nearest to it; None across a gap."""
    end = int(np.searchsorted(rows.stamp_s, stamp_s))
    for row in (end - 1, end):
        if 0 <= row < len(rows) and abs(rows.stamp_s[row] - stamp_s) <= _SAME_INSTANT_S:
            return rows.numbers[row], row
    if not 0 < end < len(rows) or rows.stamp_s[end] - rows.stamp_s[end - 1] > _WINDOW_S + _SAME_INSTANT_S:
        return None
    share = (stamp_s - rows.stamp_s[end - 1]) / (rows.stamp_s[end] - rows.stamp_s[end - 1])
    step = rows.numbers[end] - rows.numbers[end - 1]
    step[2] = wrap_angle(float(step[2]))
    return rows.numbers[end - 1] + share * step, end if share > 0.5 else end - 1


def _motions(one: EstimateTable, other: EstimateTable) -> Iterator[tuple[Floats, Floats]]:
    """Yield differences of motion over windows of a second, and their covariances."""
    sparse, dense, sign = (one, other, 1.0) if len(one) <= len(other) else (other, one, -1.0)
    if not len(sparse):
        return
    pieces = list(windows(sparse.since_s, sparse.stamp_s, sparse.stamp_s - sparse.since_s, _WINDOW_S))
    spread, spread_dense = covariances_of(sparse.information), covariances_of(dense.information)
    ways = list(_ways(dense))
    for value, covariance, first, last in zip(*chain_windows(sparse.numbers, spread, pieces)):
        begin_s, end_s = float(sparse.since_s[first]), float(sparse.stamp_s[last])
        way = next((each for each in ways if _covers(each, begin_s, end_s)), None)
        if way is None:
            continue
        (_, since), (_, now) = way.at(np.clip([begin_s, end_s], way.stamps_s[0], way.stamps_s[-1]))
        overlap_s = np.minimum(dense.stamp_s, end_s) - np.maximum(dense.since_s, begin_s)
        inside = overlap_s > _SAME_INSTANT_S
        share = (overlap_s / (dense.stamp_s - dense.since_s))[inside, None, None]
        # a part of a motion is interpolated, and with it its error
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
    dof = int((np.linalg.eigvalsh(covariances) < _UNMEASURED).sum())
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
