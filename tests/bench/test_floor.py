"""The robot that stands still is a row of every table with ground truth, and nobody's rival."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from trailmark_bench import Index
from trailmark_bench.floor import FLOOR
from trailmark_bench.summary import summarize_bench
from trailmark_bench.tables import bench_tables


def test_it_stands_below_the_methods_of_each_condition(tmp_path: Path, synthetic: Callable[..., Index]) -> None:
    with synthetic(tmp_path, sources=2, localizers=3, fails=0.0, floor_m=0.4) as index:
        summary = summarize_bench(index)

    medians, *others = bench_tables(summary)
    rows = [row for row in medians.rows if row[1] == FLOOR]
    assert [row[1] for row in medians.rows] == 2 * ["method_0", "method_1", "method_2", FLOOR]
    assert [row[3] for row in rows] == ["400", "800"]
    assert summary.entries[FLOOR, "world_1"].spreads["ate_rmse_m"].n == 1  # seeds do not change it
    assert FLOOR not in {row.method for row in summary.overall}
    assert len(others) == 3


def test_it_changes_no_rank_and_no_comparison(tmp_path: Path, synthetic: Callable[..., Index]) -> None:
    with synthetic(tmp_path / "a", floor_m=4.0) as with_floor, synthetic(tmp_path / "b") as without:
        told, expected = (summarize_bench(index).document() for index in (with_floor, without))

    assert told["overall"] == expected["overall"]
    assert [entry for entry in told["entries"] if entry["method"] != FLOOR] == expected["entries"]


@pytest.mark.parametrize("reason", ["no truth", "failed"])
def test_where_nobody_knows_the_truth_there_is_none(
    tmp_path: Path, synthetic: Callable[..., Index], reason: str
) -> None:
    with synthetic(tmp_path, fails=1.0 if reason == "failed" else 0.0, floor_m=None) as index:
        assert FLOOR not in summarize_bench(index).methods


def test_a_cell_says_it(tmp_path: Path, bench_of: Callable[..., Any], run_cells: Callable[..., Any]) -> None:
    run_cells(bench_of({"localizers": ["odometry"]}), tmp_path)

    with Index(tmp_path) as index:
        (still,) = [entry for entry in summarize_bench(index).entries.values() if entry.method == FLOOR]
    assert all(way_m > 0.0 for way_m in still.values["ate_rmse_m"].values())
