"""The headline figures: what README and manual say is what the pages of results say."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

TOP = Path(__file__).parents[2]
#: A number with the unit of a result.
FIGURE = re.compile(
    r"\d[\d.]*(?: (?:to|and|of) [\d.]+)? (?:mm|cm|km|m/s|m|ms|s|%|pictures|drives|things|starts)(?![\w/])"
)


@pytest.fixture(scope="module")
def summary(load_script: Callable[[str], ModuleType]) -> ModuleType:
    return load_script("benchmarks/summary_page.py")


def measured_cells() -> list[str]:
    """Return the cells of the README's tables that link to a page of results."""
    lines = (TOP / "README.md").read_text(encoding="utf-8").splitlines()
    cells = [line.strip("|").split("|")[-1] for line in lines if line.startswith("|")]
    return [cell for cell in cells if "docs/results/" in cell]


def test_what_is_told_is_what_the_pages_say(summary: ModuleType) -> None:
    wrong = [
        f"{file} does not say {words!r}, as {one.page} does"
        for one in summary.headlines()
        for words in [one.words(TOP)]
        for file in one.stands
        if words not in (TOP / file).read_text(encoding="utf-8")
    ]

    assert not wrong


def test_every_measured_figure_of_the_readme_is_read_from_a_page(summary: ModuleType) -> None:
    listed = [one for one in summary.headlines() if "README.md" in one.stands]
    known = sorted({words for one in listed for words in (one.words(TOP), *one.given)}, key=len, reverse=True)
    loose = []
    for cell in measured_cells():
        for words in known:
            cell = cell.replace(words, "")
        loose += FIGURE.findall(cell)

    assert len(measured_cells()) >= 12
    assert not loose


def test_the_page_is_what_the_other_pages_say_today(summary: ModuleType) -> None:
    page = (TOP / "docs" / "results" / "summary.md").read_text(encoding="utf-8")

    assert summary.summary(TOP) in page, "python benchmarks/results.py make summary"


def headline(summary: ModuleType, **more: Any) -> Any:
    return summary.Headline(what="offset", page="a.md", say="{least:.1f} to {most:.1f} mm", stands=(), **more)


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    (tmp_path / "docs" / "results").mkdir(parents=True)
    table = "| experiment | item | unit | bar | ours |\n|---|---|---|--:|--:|\n| A | offset | mm | 9 | 1.25 |\n"
    (tmp_path / "docs" / "results" / "a.md").write_text(f"{table}\n## Later\n\n7 mm, 8 mm\n", encoding="utf-8")
    return tmp_path


def test_a_row_is_read_from_the_column_of_ours(summary: ModuleType, checkout: Path) -> None:
    assert headline(summary, table=("A", "offset"), times=2.0).words(checkout) == "2.5 to 2.5 mm"


def test_figures_are_looked_for_behind_their_heading(summary: ModuleType, checkout: Path) -> None:
    assert headline(summary, figures=r"(\d) mm", after="## Later").words(checkout) == "7.0 to 8.0 mm"


def test_a_figure_that_has_gone_or_misses_its_bar_is_refused(summary: ModuleType, checkout: Path) -> None:
    with pytest.raises(ValueError, match=r"a\.md has no figure for: offset"):
        headline(summary, table=("B", "offset")).words(checkout)
    with pytest.raises(ValueError, match=r"7 where 7\.5 is said"):
        headline(summary, figures=r"(\d) mm", after="## Later", bar=7.5).words(checkout)
