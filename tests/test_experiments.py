"""Rows of an experiment."""

from __future__ import annotations

import json
import math
import operator
from pathlib import Path

import pytest

from trailmark.experiments import ExperimentOptions, Row
from trailmark.report.experiment import write_experiment


@pytest.mark.parametrize(
    ("ours", "bar", "better", "met"),
    [
        (0.1, 0.2, "lower", True),
        (0.3, 0.2, "lower", False),
        (0.3, 0.2, "higher", True),
        (0.1, 0.2, "higher", False),
        (0.2, 0.2, "lower", True),
        (0.1, None, "lower", None),
        (None, 0.2, "lower", False),
        (math.nan, 0.2, "lower", False),
    ],
)
def test_a_bar_is_met_on_its_better_side(ours: float | None, bar: float | None, better: str, met: bool | None) -> None:
    assert Row("e", "i", "m", ours, bar=bar, better=better).met is met  # type: ignore[arg-type]


def test_the_document_has_the_promised_keys_and_no_nan() -> None:
    document = Row("B", "odometer", "%", math.inf, paper=0.99, bar=0.02, spread=math.nan, n=3, seeds=3).document()

    assert set(document) == {
        "experiment", "item", "unit", "paper", "bar", "stretch", "ours", "spread", "better", "met", "n", "seeds",
        "note", "faithful", "is_headline",
    }  # fmt: skip
    assert json.loads(json.dumps(document, allow_nan=False))["ours"] is None


@pytest.mark.parametrize("jobs", [1, 2])
def test_map_answers_in_order(tmp_path: Path, jobs: int) -> None:
    options = ExperimentOptions(quick=True, seed=0, out=tmp_path, report=print, jobs=jobs)

    assert options.map(operator.sub, [(5, 1), (9, 2), (3, 3)]) == [4, 7, 0]


@pytest.mark.parametrize("jobs", [1, 2])
def test_map_tells_what_a_call_raised(tmp_path: Path, jobs: int) -> None:
    options = ExperimentOptions(quick=True, seed=0, out=tmp_path, report=print, jobs=jobs)

    with pytest.raises(ZeroDivisionError):
        options.map(operator.truediv, [(1, 1), (1, 0)])


def test_the_page_holds_rows_notes_and_pictures(tmp_path: Path) -> None:
    (tmp_path / "figure_13.svg").write_text("<svg/>", encoding="utf-8")
    rows = [
        Row("C", "offset", "mm", 1.4, paper=4.4, bar=4.4, n=75000, faithful=2.4),
        Row("C", "poles touched", "", 1.0, bar=0.0, note="one gate only"),
    ]
    origin = {"command": "/a/b/trailmark reproduce x", "started": "2026-11-21T10:00", "trailmark": "1", "cpu": "A"}

    page = write_experiment(tmp_path, "Path tracking", "Nagai 2015", rows, origin, took_s=90.0).read_text("utf-8")

    assert "`trailmark reproduce x`, 2026-11-21, trailmark 1, 1.5 min on A.\n1 of 2 bars are met. Missed:" in page
    assert "- C, poles touched: 1, asked for 0" in page
    assert "`faithful` is the method as the paper prints it" in page
    assert "| C | offset | mm | 4.4 | 2.4 | 1.4 |  | 4.4 |  | 75000 | 1 | met |" in page
    assert "- C, poles touched: one gate only" in page
    assert "![figure 13](figure_13.svg)" in page
    assert len(json.loads((tmp_path / "rows.json").read_text("utf-8"))["rows"]) == 2


def test_the_page_begins_with_the_few_that_matter(tmp_path: Path) -> None:
    rows = [Row("C", "offset", "mm", 1.4, paper=4.4, bar=4.4, is_headline=True), Row("C", "file", "MB", 3.0)]
    origin = {"command": "trailmark", "started": "2026-11-21T10:00", "trailmark": "1", "cpu": "A"}

    page = write_experiment(tmp_path, "t", "", rows, origin, took_s=1.0).read_text("utf-8")
    head, _, folded = page.partition("<details")

    assert "| C: offset | mm | 4.4 |  | 1.4 |  | 4.4 | met |" in head
    assert "file" not in head
    assert "<summary>All 2 figures</summary>\n\n| experiment | item |" in folded
    assert "| C | offset | mm | 4.4 |  | 1.4 |  | 4.4 |  | 1 | 1 | met |" in folded
    assert "| C | file | MB |" in folded


def test_a_seed_has_a_place_of_its_own_unless_one_is_asked_for(tmp_path: Path) -> None:
    free = ExperimentOptions(quick=True, seed=4, out=tmp_path, report=print)
    fixed = ExperimentOptions(quick=True, seed=4, out=tmp_path, report=print, place=9)

    assert (free.world_seed, free.place_of(0)) == (5, 1)
    assert (fixed.world_seed, fixed.place_of(0)) == (9, 9)


def test_the_page_names_a_fixed_place(tmp_path: Path) -> None:
    origin = {"command": "trailmark", "started": "2026-11-21T10:00", "trailmark": "1", "cpu": "A"}

    anywhere = write_experiment(tmp_path / "a", "t", "", [], origin, took_s=1.0).read_text("utf-8")
    fixed = write_experiment(tmp_path / "b", "t", "", [], origin | {"place": 9}, took_s=1.0).read_text("utf-8")

    assert "world_seed" not in anywhere
    assert "All drives in one place, `world_seed` 9." in fixed
