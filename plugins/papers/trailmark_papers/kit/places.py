"""The same experiment in several places: a figure of one place says nothing of the next."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from trailmark.experiments import ExperimentOptions, Row

__all__ = ["Trial", "over_places"]

#: Between the seeds of two places: more than any experiment counts on from its own.
_SEED_STEP = 1000
#: What an item says that is the worst of many; of several places it is the worst of all.
_WORST = re.compile(r"\b(max|largest|worst|p99|p of the t-test)\b")


@dataclass(frozen=True, slots=True)
class Trial:
    """Where the drives of one place are kept, with which seed, and where they take place.

    Attributes
    ----------
    out : Path
        Folder of runs and plots.
    seed : int
        Of noise, slip and people.
    place : int
        ``world_seed`` of the simulator.
    """

    out: Path
    seed: int
    place: int

    @classmethod
    def of(cls, options: ExperimentOptions) -> Trial:
        """Return the trial of the first seed."""
        return cls(options.out, options.seed, options.world_seed)


def over_places(
    options: ExperimentOptions, rows_of: Callable[[ExperimentOptions], Iterable[Row]], n_places: int
) -> list[Row]:
    """Repeat an experiment in several places, each with seeds of its own, and return its rows over all of them.

    Figures are drawn of the first place, whose folder is that of the experiment.

    Parameters
    ----------
    rows_of : callable
        The experiment in one place.
    n_places : int
        How many, where the command line does not say; rows of one alone are returned as they are. In a place that the
        command line fixes, so many seeds are of that one.
    """
    found = []
    for k in range(options.n_places(n_places)):
        seed = options.seed + _SEED_STEP * k
        out = options.out if k == 0 else options.out / "places" / str(seed + 1)
        found.append(list(rows_of(replace(options, seed=seed, out=out))))
    if len(found) == 1:
        return found[0]
    pooled = [_over(rows, "by place" if options.place is None else "by seed") for rows in _align_rows(found)]
    return pooled if options.place is None else [replace(row, n=min(row.n, 1)) for row in pooled]


def _align_rows(found: Sequence[Sequence[Row]]) -> list[list[Row]]:
    """Return the rows of all places by what they measure, in the order of the first place."""
    by_key = [{(row.experiment, row.item): row for row in rows} for rows in found]
    keys = dict.fromkeys(key for rows in by_key for key in rows)
    return [[rows[key] for rows in by_key if key in rows] for key in keys]


def _over(rows: Sequence[Row], by: str) -> Row:
    """Return one row for several places: `n` counts those that it is of, the spread is over them, the note names each.

    Where there is a bar, a place in which nothing could be measured misses it, and counts.
    """
    first, values = rows[0], [row.ours for row in rows if row.ours is not None]
    each = ", ".join("nothing" if row.ours is None else f"{row.ours:.3g}" for row in rows)
    samples = sum(row.n for row in rows)
    note = f"{first.note}; " if first.note else ""
    return replace(
        first,
        ours=_figure_of(first, values) if len(values) == len(rows) or first.bar is None else None,
        bar=None if first.bar is None else float(np.mean([row.bar for row in rows if row.bar is not None])),
        faithful=_figure_of(first, [row.faithful for row in rows if row.faithful is not None]),
        spread=float(np.std(values)) if len(values) > 1 else None,
        n=len(values) if first.bar is None else len(rows),
        seeds=sum(row.seeds for row in rows),
        note=f"{note}{by}: {each}; {samples} samples",
    )


def _figure_of(row: Row, values: Sequence[float]) -> float | None:
    if not values:
        return None
    if _WORST.search(row.item):
        return max(values) if row.better == "lower" else min(values)
    return float(np.mean(values))
