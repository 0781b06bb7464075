"""What became of each case, kept in a file: work that is cut off goes on, and several pieces make one page."""

from __future__ import annotations

import json
import subprocess
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

__all__ = ["CaseRecord", "Records", "Tally", "commit"]


@dataclass(frozen=True, slots=True)
class CaseRecord:
    """What became of a case.

    Attributes
    ----------
    target, number : str, int
        What it is made from.
    ended : str
        How it ended, in a word.
    cpu_s, peak_mib : float
        What it took.
    findings : tuple of str
        What is wrong with that.
    commit : str
        Of the code that it was tried on.
    """

    target: str
    number: int
    ended: str
    cpu_s: float = 0.0
    peak_mib: float = 0.0
    findings: tuple[str, ...] = ()
    commit: str = ""


@dataclass
class Tally:
    """What became of the cases of a target."""

    n: int = 0
    ended: Counter[str] = field(default_factory=Counter)
    slowest_s: float = 0.0
    peak_mib: float = 0.0
    findings: list[str] = field(default_factory=list)


class Records:
    """Records of cases, in memory, and in a file if there is one; the file is read first.

    A case that is recorded with a finding is tried again: the finding may have been mended.

    Parameters
    ----------
    path : Path or None
        Lines of JSON.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._path = path
        self._records: dict[tuple[str, int], CaseRecord] = {}
        if path is not None and path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                entry = json.loads(line)
                self._take(CaseRecord(**(entry | {"findings": tuple(entry["findings"])})))

    def __len__(self) -> int:
        return len(self._records)

    def __iter__(self) -> Iterator[CaseRecord]:
        return iter(self._records.values())

    def has_passed(self, target: str, number: int) -> bool:
        """Return whether a case has been tried, without a finding."""
        record = self._records.get((target, number))
        return record is not None and not record.findings

    def add(self, record: CaseRecord) -> None:
        """Keep what became of a case, at once."""
        self._take(record)
        if self._path is not None:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(record)) + "\n")

    def tallies(self) -> dict[str, Tally]:
        """Return what became of the cases of each target."""
        tallies: dict[str, Tally] = {}
        for record in self._records.values():
            tally = tallies.setdefault(record.target, Tally())
            tally.n += 1
            tally.ended[record.ended] += 1
            tally.slowest_s = max(tally.slowest_s, record.cpu_s)
            tally.peak_mib = max(tally.peak_mib, record.peak_mib)
            tally.findings += record.findings
        return tallies

    def commits(self) -> str:
        """Return on which code the cases were tried, and how many on each."""
        counted = Counter(record.commit for record in self._records.values() if record.commit)
        return ", ".join(f"{name} ({n})" for name, n in counted.items())

    def _take(self, record: CaseRecord) -> None:
        self._records[record.target, record.number] = record


def commit() -> str:
    """Return the commit of this code, marked if it was changed since; nothing if there is none."""
    command = ("git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty", "--exclude=*")
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    return ended.stdout.strip()
