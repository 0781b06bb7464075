"""Looking at a run while it goes on, from the files that it writes; nothing is asked of the run itself."""

from __future__ import annotations

import json
import math
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from trailmark.errors import DataError
from trailmark.evaluation import OUTCOMES
from trailmark.report.growing_rows import GrowingRows
from trailmark.report.numbers import MISSING, count_text, significant
from trailmark.report.tables import Column, Table

__all__ = ["LocalizerStatus", "RunWatch"]


@dataclass(slots=True)
class LocalizerStatus:
    """What one localizer has said so far.

    Attributes
    ----------
    outcomes : Counter
        Estimates by what became of them.
    first_s, last_s : float
        Stamps of the first and of the newest [s].
    way_m : float
        Sum of its motions [m].
    where : str
        Its newest fix or place on the path, in words; empty without one.
    reason : str
        Why its newest estimate was not taken; empty where it was.
    """

    outcomes: Counter[str] = field(default_factory=Counter)
    first_s: float = math.inf
    last_s: float = -math.inf
    way_m: float = 0.0
    where: str = ""
    reason: str = ""

    def take(self, row: dict[str, str]) -> None:
        """Take a row of ``estimates.csv``."""
        outcome = "lost" if row["kind"] == "lost" else row["status"]
        self.outcomes[outcome] += 1
        stamp_s = _number(row, "stamp_s")
        self.first_s, self.last_s = min(self.first_s, stamp_s), max(self.last_s, stamp_s)
        self.reason = "" if outcome in ("accepted", "unused") else row["reason"]
        if row["kind"] == "lost":
            return
        x, y, theta = (_number(row, name) for name in ("x", "y", "theta"))
        if row["kind"] == "motion":
            self.way_m += math.hypot(x, y)
        else:
            self.where = f"{x:.2f} m, {y:+.3f} m, {math.degrees(theta):+.1f}°"

    @property
    def n(self) -> int:
        """How many estimates."""
        return sum(self.outcomes.values())

    @property
    def rate_hz(self) -> float | None:
        """Estimates a second, in the time of the run; None while there is only one [Hz]."""
        return (self.n - 1) / (self.last_s - self.first_s) if self.last_s > self.first_s else None


def _number(row: dict[str, str], name: str) -> float:
    try:
        return float(row[name])
    except ValueError:
        raise ValueError(f"{name} is not a number: {row[name][:40]!r}") from None


class RunWatch:
    """Reads what a run has written since it was asked last.

    Parameters
    ----------
    folder : Path
        Of the run.

    Raises
    ------
    DataError
        If it is not the folder of a run.
    """

    def __init__(self, folder: Path) -> None:
        if not (folder / "run.json").is_file():
            raise DataError(f"{folder} is not the folder of a run: it has no run.json")
        self.folder = folder
        self.localizers: dict[str, LocalizerStatus] = {}
        self.status = "running"
        self._rows = GrowingRows(folder / "estimates.csv")

    def look(self) -> bool:
        """Read what is new; return whether the run still goes on."""
        self.status = self.read_status()  # before the rows: when it has ended, they are all there
        try:
            for row in self._rows.rows():
                self.take(row)
        except (ValueError, KeyError) as error:
            raise self._rows.wrong(error) from error
        return self.status == "running"

    def table(self) -> Table:
        """Return a row for each localizer."""
        outcomes = [word for word in OUTCOMES if any(word in seen.outcomes for seen in self.localizers.values())]
        columns = [Column("localizer", is_number=False), *(Column(word) for word in outcomes)]
        columns += [Column("rate", "Hz"), Column("way", "m"), Column("newest", "s")]
        columns += [Column("where", is_number=False), Column("why not", is_number=False)]
        rows = [
            (
                name,
                *(count_text(seen.outcomes[word]) for word in outcomes),
                significant(seen.rate_hz),
                significant(seen.way_m) if seen.way_m else MISSING,
                f"{seen.last_s:.2f}",
                seen.where,
                seen.reason,
            )
            for name, seen in self.localizers.items()
        ]
        return Table(tuple(columns), tuple(rows))

    def read_status(self) -> str:
        """Return what ``run.json`` says: ``running``, or how the run ended."""
        try:
            return str(json.loads((self.folder / "run.json").read_text(encoding="utf-8"))["status"])
        except (OSError, ValueError, KeyError, TypeError):  # it is being written at this instant
            return self.status

    def take(self, row: dict[str, str]) -> None:
        """Take a row of ``estimates.csv``."""
        self.localizers.setdefault(row["source"], LocalizerStatus()).take(row)
