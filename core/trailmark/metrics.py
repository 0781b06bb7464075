"""What a figure is: its unit, which way is better, what it needs, and how tables show it.

Each quantity is declared once, as a `MetricSpec`: those that every evaluation computes in
`trailmark.evaluation.quantities`, those of a ``metric`` plugin where it is registered. Reports, ``compare``,
``evaluate`` and benches read the declarations and know no name.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

__all__ = ["Better", "Judged", "MetricSpec", "Needs"]

Better = Literal["lower", "higher", "near one"]
#: ``truth``: without it there is no number, or the `difference` that was declared; ``nothing``: what a run says of
#: itself.
Needs = Literal["truth", "nothing"]
#: What a metric plugin is given: aligned trajectories, or one localizer's estimates as it told them.
Judged = Literal["trajectory", "estimates"]


@dataclass(frozen=True, slots=True)
class MetricSpec:
    """A quantity of ``metrics.json``.

    Attributes
    ----------
    name : str
        Without its protocol: ``ate_rmse_m``.
    unit : {"m", "deg", "s", "ms", "%", "share", ...}
        Of the number. Tables choose mm or m for lengths, and show a ``share`` in percent.
    better : {"lower", "higher", "near one"}
        Which way is better.
    needs : {"truth", "nothing"}
        See `Needs`.
    title : str
        Heads its column; empty: it has none in the tables of runs, but in the details.
    protocol : {"", "alignment", "distance"}
        Which of several numbers of this name a table shows: the one after the alignment that was used, the first
        over a distance, or the first.
    difference, difference_title : str
        What it is called where the reference is an estimate; empty: it is left out there.
    """

    name: str
    unit: str = ""
    better: Better = "lower"
    needs: Needs = "truth"
    title: str = ""
    protocol: Literal["", "alignment", "distance"] = ""
    difference: str = ""
    difference_title: str = ""

    def oriented(self, value: float) -> float:
        """Return a number that is lower where the value is better; of a failure infinity."""
        if not math.isfinite(value):
            return math.inf
        if self.better == "higher":
            return -value
        if self.better == "near one":
            return abs(math.log(value)) if value > 0 else math.inf
        return value

    def as_difference(self) -> MetricSpec | None:
        """Return the quantity that stands for this one without ground truth; None where there is none."""
        if self.needs == "nothing":
            return self
        if not self.difference:
            return None
        return MetricSpec(
            self.difference, self.unit, self.better, "nothing", self.difference_title or self.title, self.protocol
        )

    def document(self) -> dict[str, Any]:
        """Return it as plain data, for ``metrics.json``."""
        return asdict(self)

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> MetricSpec:
        """Return what `document` gave; keys of later versions are left out."""
        return cls(**{key: value for key, value in document.items() if key in cls.__slots__})
