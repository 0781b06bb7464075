"""The rows of one experiment, which share its name, its samples and its seeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.experiments import Row

__all__ = ["Table"]


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
