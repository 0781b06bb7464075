"""The rows of one experiment, which share its name, its samples and its seeds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.experiments import Row

__all__ = ["Table", "begin_with", "beside_faithful"]


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of one experiment, in the order in which they are added; iterating gives them.

    Attributes
    ----------
    name : str
        The experiment that every row names.
    n, seeds : int
        Samples and seeds behind a figure, where a row does not say otherwise.
    rows : list of Row
        What was added.
    """

    name: str
    n: int = 1
    seeds: int = 1
    rows: list[Row] = field(default_factory=list)

    def __iter__(self) -> Iterator[Row]:
        """Iterate over the rows."""
        return iter(self.rows)

    def add(self, item: str, unit: str, ours: float | None, **more: Any) -> None:
        """Add a figure of which less is better; `more` are the other fields of `Row`, by name."""
        self.rows.append(Row(self.name, item, unit, ours, **{"n": self.n, "seeds": self.seeds, **more}))

    def add_higher(self, item: str, unit: str, ours: float | None, **more: Any) -> None:
        """Add a figure of which more is better."""
        self.add(item, unit, ours, better="higher", **more)

    def add_share(self, item: str, holds: Bools | Floats | Sequence[bool], **more: Any) -> None:
        """Add the mean share of what holds, of which more is better [%]."""
        self.add_higher(item, "%", 100.0 * float(np.mean(holds)), **more)


def beside_faithful(ours: Iterable[Row], faithful: Iterable[Row]) -> list[Row]:
    """Return rows with the figures that the method as printed gives for the same items.

    Parameters
    ----------
    ours, faithful : iterable of Row
        Of the default and of the preset; what only one of them measured stays as it is, or is left out.
    """
    found = {(row.item, row.unit): row.ours for row in faithful}
    return [replace(row, faithful=found.get((row.item, row.unit))) for row in ours]


def begin_with(rows: Iterable[Row], *headlines: str) -> list[Row]:
    """Return rows of which those that are named begin the page.

    Parameters
    ----------
    rows : iterable of Row
        All of a paper.
    *headlines : str
        ``experiment: item``, where ``*`` stands for any words: a short version drives less far.
    """
    return [
        replace(row, is_headline=any(fnmatchcase(f"{row.experiment}: {row.item}", name) for name in headlines))
        for row in rows
    ]
