"""How localizers of one run differ from each other, without any truth: whether they agree within what they state."""

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
from trailmark.geometry import Trajectory, wrap_angles

__all__ = ["Difference", "localizer_differences"]

#: Motion is compared over windows of this length, and between two estimates farther apart none is interpolated [s].
_WINDOW_S = 1.0
_SAME_INSTANT_S = 1e-6
_FEWEST = 5


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
        Of x, y and heading, or station, lateral and heading; NaN where one of the two does not measure it [m, m, rad].
    per_dof : float
        Squared differences in units of what both state together, a degree of freedom: 1 where they differ as they say.
    """

    one: str
    other: str
    kind: str
    n: int
    mean: Floats
    rms: Floats
    largest: Floats
    per_dof: float

    def document(self) -> dict[str, Any]:
        """Return it as plain data, with headings in degrees; what was not measured is None."""
        numbers = {
            f"{what}_{unit}": [_plain(value) for value in (np.degrees(triple[2:]) if unit == "deg" else triple[:2])]
            for what, triple in (("mean", self.mean), ("rms", self.rms), ("largest", self.largest))
            for unit in ("m", "deg")
        }
        about = {"one": self.one, "other": self.other, "kind": self.kind, "n": self.n}
        return {**about, **numbers, "per_dof": _plain(self.per_dof)}


def localizer_differences(estimates: EstimateTable, reference: str | None = None) -> list[Difference]:
    """Return how each two localizers differ that say the same kind of thing at the same time.

    Poses and path offsets are compared where the one spoke, with the other's interpolated between two that are at most
    a second apart; motions are chained to windows of a second.

    Parameters
    ----------
    estimates : EstimateTable
        Of a run.
    reference : str, optional
        Only pairs with this localizer: what the others say less what it says.

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
    kept = rows.where((rows.kind == kind) & (rows.outcome != "refused") & is_finite)
    return kept.where(np.unique(kept.stamp_s, return_index=True)[1])


def _singles(one: EstimateTable, other: EstimateTable) -> Iterator[tuple[Floats, Floats]]:
    """Yield differences and their covariances where the rarer of the two spoke."""
    sparse, dense, sign = (one, other, 1.0) if len(one) <= len(other) else (other, one, -1.0)
    if len(dense) < 2:
        return
    after = np.clip(np.searchsorted(dense.stamp_s, sparse.stamp_s), 1, len(dense) - 1)
    spreads = covariances_of(sparse.information), covariances_of(dense.information)
    measured = [np.diagonal(table.information, axis1=1, axis2=2) > 0.0 for table in (sparse, dense)]
    for row, (stamp_s, end) in enumerate(zip(sparse.stamp_s.tolist(), after.tolist())):
        begin_s, end_s = dense.stamp_s[end - 1], dense.stamp_s[end]
        is_inside = begin_s - _SAME_INSTANT_S <= stamp_s <= end_s + _SAME_INSTANT_S
        if not is_inside or end_s - begin_s > _WINDOW_S + _SAME_INSTANT_S:
            continue
        share = (stamp_s - begin_s) / (end_s - begin_s)
        step = dense.numbers[end] - dense.numbers[end - 1]
        step[2] = _wrapped(step[2])
        value = sparse.numbers[row] - (dense.numbers[end - 1] + share * step)
        nearest = end if share > 0.5 else end - 1
        yield _of_both(sign * value, spreads[0][row] + spreads[1][nearest], measured[0][row] & measured[1][nearest])


def _motions(one: EstimateTable, other: EstimateTable) -> Iterator[tuple[Floats, Floats]]:
    """Yield differences of motion over windows of a second, and their covariances."""
    sparse, dense, sign = (one, other, 1.0) if len(one) <= len(other) else (other, one, -1.0)
    if not len(sparse) or not len(dense):
        return
    pieces = list(windows(sparse.since_s, sparse.stamp_s, sparse.stamp_s - sparse.since_s, _WINDOW_S))
    spread, spread_dense = covariances_of(sparse.information), covariances_of(dense.information)
    is_measured = np.logical_and(_always_measured(sparse), _always_measured(dense))
    ways = list(_ways(dense))
    for value, covariance, first, last in zip(*chain_windows(sparse.numbers, spread, pieces)):
        begin_s, end_s = sparse.since_s[first], sparse.stamp_s[last]
        way = next((one for one in ways if one.stamps_s[0] <= begin_s and end_s <= one.stamps_s[-1]), None)
        if way is None:
            continue
        (_, since), (_, now) = way.at([begin_s, end_s])
        inside = (dense.stamp_s > begin_s + _SAME_INSTANT_S) & (dense.since_s < end_s - _SAME_INSTANT_S)
        of_dense = chained_motion(dense.numbers[inside], spread_dense[inside])[1]
        difference = value - since.between(now).array()
        yield _of_both(sign * difference, covariance + of_dense, is_measured)


def _always_measured(rows: EstimateTable) -> Bools:
    return np.asarray((np.diagonal(rows.information, axis1=1, axis2=2) > 0.0).all(axis=0))


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


def _of_both(value: Floats, covariance: Floats, is_measured: Bools) -> tuple[Floats, Floats]:
    """Return a difference that is NaN where not both measure it, and its covariance."""
    return np.where(is_measured, [value[0], value[1], _wrapped(value[2])], np.nan), covariance


def _difference(one: str, other: str, kind: str, told: list[tuple[Floats, Floats]]) -> Difference:
    values = np.array([value for value, _ in told])
    squares, dof = 0.0, 0
    for value, covariance in told:
        known = np.flatnonzero(np.isfinite(value))
        if len(known):
            squares += float(value[known] @ np.linalg.solve(covariance[np.ix_(known, known)], value[known]))
            dof += len(known)
    mean, rms, largest = (_of_columns(values, of) for of in (np.mean, _rms, _largest))
    return Difference(one, other, kind, len(told), mean, rms, largest, squares / dof if dof else math.nan)


def _of_columns(values: Floats, of: Any) -> Floats:
    columns = [column[np.isfinite(column)] for column in values.T]
    return np.array([float(of(column)) if len(column) else math.nan for column in columns])


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values * values)))


def _largest(values: Floats) -> float:
    return float(np.abs(values).max())


def _wrapped(angle: float) -> float:
    return float(wrap_angles(np.array([angle]))[0])


def _plain(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
