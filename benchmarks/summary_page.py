"""The summary page: every figure that README, cards and manual head with, read from the one page that measured it. ::

    python benchmarks/summary_page.py            # prints the table; the recipe of pages puts it into its page

``summary.toml`` lists them: where each is read, in which words, and where these words stand. A test compares: what
stands in a README is what its page says, and every figure of the README's tables is on the list.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

TOP = Path(__file__).resolve().parents[1]
LIST = Path(__file__).with_name("summary.toml")

#: Column of a page of `trailmark reproduce` that has what was measured here.
_OURS = "ours"


@dataclass(frozen=True, slots=True)
class Headline:
    """A figure that is told elsewhere than on the page that measured it.

    Attributes
    ----------
    what : str
        What was measured.
    page : str
        Where the figure stands: a page below ``docs/results``, or a path in the checkout.
    say : str
        The words, with fields for the figures.
    stands : sequence of str
        Files that have these words.
    table : (str, str) or None
        Experiment and item of rows of ``trailmark reproduce``; ``*`` and ``[+-]`` stand for more than one.
    figures : str
        Without `table`: a regular expression whose groups are figures.
    after, until : str
        It is looked for behind the first and before the next of these; "" is the whole page.
    times : float
        The figures are multiplied by this.
    bar : float or None
        What all figures must reach.
    given : sequence of str
        Conditions that stand beside the words, and are no result.
    """

    what: str
    page: str
    say: str
    stands: Sequence[str]
    table: Sequence[str] | None = None
    figures: str = ""
    after: str = ""
    until: str = ""
    times: float = 1.0
    bar: float | None = None
    given: Sequence[str] = ()

    def path(self, top: Path) -> Path:
        """Return its page in a checkout."""
        return top / self.page if "/" in self.page else top / "docs" / "results" / self.page

    def words(self, top: Path) -> str:
        """Return the words with the figures of its page.

        Raises
        ------
        ValueError
            If the page has no such figure, or one that does not reach the bar.
        """
        text = self.path(top).read_text(encoding="utf-8")
        found = self._of_table(text) if self.table else self._of_pattern(text)
        if not found:
            raise ValueError(f"{self.page} has no figure for: {self.what}")
        if self.bar is not None and min(found) < self.bar:
            raise ValueError(f"{self.page}: {min(found):g} where {self.bar:g} is said to be reached: {self.what}")
        values = [self.times * value for value in found]
        mean = sum(values) / len(values)
        return self.say.format(least=min(values), most=max(values), mean=mean, total=sum(values), n=len(values))

    def _of_pattern(self, text: str) -> list[float]:
        part = text.partition(self.after)[2] if self.after else text
        part = part.partition(self.until)[0] if self.until else part
        return [float(value) for found in re.finditer(self.figures, part, re.MULTILINE) for value in found.groups()]

    def _of_table(self, text: str) -> list[float]:
        assert self.table is not None
        column, found = -1, []
        for line in text.splitlines():
            cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
            if cells[:2] == ["experiment", "item"]:
                column = cells.index(_OURS)
            elif column > 0 and len(cells) > column and all(map(fnmatchcase, cells, self.table)):
                found.append(float(cells[column]))
        return found


def headlines() -> list[Headline]:
    """Return the list."""
    listed = tomllib.loads(LIST.read_text(encoding="utf-8"))["headline"]
    return [Headline(**one) for one in listed]


def summary(top: Path = TOP) -> str:
    """Return the table of all headlines."""
    lines = ["| what was measured | figure | on | told in |", "|---|---|---|---|"]
    for one in headlines():
        page, told = _link(one.path(top), top), ", ".join(_link(top / file, top) for file in one.stands)
        lines.append(f"| {one.what} | {one.words(top)} | {page} | {told} |")
    return "\n".join(lines)


def _link(file: Path, top: Path) -> str:
    """Return a file as the manual links to it from a page of results: cards are pages of its methods."""
    parts = file.relative_to(top).parts
    if parts[0] == "plugins":
        return f"[{parts[1]}](../methods/{parts[1]}.md)"
    if parts[:2] == ("docs", "results"):
        return f"[{file.stem}]({file.name})"
    return f"[{file.stem}](../{'/'.join(parts[1:])})" if parts[0] == "docs" else file.stem


if __name__ == "__main__":
    sys.stdout.write(summary() + "\n")
