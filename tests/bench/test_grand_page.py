"""The tables of the page of the grand bench, from a file of results."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from trailmark_bench import Index
from trailmark_bench.shared import write_results


@pytest.fixture(scope="session")
def grand(load_script: Callable[[str], ModuleType]) -> ModuleType:
    """`benchmarks/bench_grand.py` as a module."""
    return load_script("benchmarks/bench_grand.py")


@pytest.fixture
def printed(
    grand: ModuleType,
    synthetic: Callable[..., Index],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> Callable[..., str]:
    """Return what the script prints of a bench of three conditions and four methods that nobody ran."""
    with synthetic(tmp_path / "bench", fails=0.2) as index:
        passes = [{"started": "2026-11-27T20:00:00", "cpu": "EPYC", "cells": n, "wall_s": 1800.0, "cpu_s": 3600.0,
                   "git": {"trailmark": "abc1234"}} for n in (90, 20)]  # of the first some have run again  # fmt: skip
        index.set_meta(passes=passes)
        write_results(index, tmp_path / "cells.json.xz")

    def run(*words: str) -> str:
        monkeypatch.setattr("sys.argv", ["bench_grand.py", *words, "--results", str(tmp_path / "cells.json.xz")])
        grand.main()
        return capsys.readouterr().out

    return run


def test_what_passes_cost_stands_beside_what_the_cells_cost_that_are_left(printed: Callable[..., str]) -> None:
    said = printed("run")

    assert "| cells that stand |  | 60 |  | " in said
    assert "| 1 | abc1234, EPYC, 2026-11-27 20:00 | 90 | 0.50 | 1.00 |" in said
    assert "| 2 | abc1234, EPYC, 2026-11-27 20:00 | 20 | 0.50 | 1.00 |" in said
    assert "60 of 60 cells: " in said


def test_the_best_of_a_row_is_bold_and_failures_are_counted(printed: Callable[..., str]) -> None:
    head, _, *rows = printed("figures").strip().splitlines()

    assert head == "| ATE rmse [mm] | method_0 | method_1 | method_2 | method_3 |"
    assert [row.split(" | ")[0] for row in rows] == ["| world_0", "| world_1", "| world_2"]
    assert all(row.split(" | ")[1].startswith("**") for row in rows)
    assert any("(1)" in row or "(2)" in row for row in rows)


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ("run", "| pass | "),
        ("ranking", "| method | ok |"),
        ("better", "better than | method_0 |"),
        ("answers", "| method | cells | failed | "),
        ("silent", "| method | cells | with a silent error |"),
        ("winners", "| condition | best |"),
        ("failed", "ended by SIGSEGV"),
        ("honest", "| method | conditions | from 0.2 to 5 |"),
    ],
)
def test_every_block_has_a_table(printed: Callable[..., str], what: str, said: str) -> None:
    assert said in printed(what)


def test_a_method_that_states_too_little_is_named_with_the_condition(
    grand: ModuleType, tmp_path: Path, synthetic: Callable[..., Index]
) -> None:
    with synthetic(tmp_path / "stated") as index:
        records = index.records()
        for record in records:
            is_sure = record.coordinates["localizer"] == "method_1" and record.coordinates["source"] == "world_2"
            record.result["metrics"] = {"nees_per_dof[n=9,dof=27]": 40.0 if is_sure else 0.9}
        table = grand.honest_table(records)

    assert [column.title for column in table.columns[:3]] == ["method", "conditions", "from 0.2 to 5"]
    assert [row[:6] for row in table.rows[:2]] == [
        ("method_0", "3", "3", "0.9", "0.9", "0.9"),
        ("method_1", "3", "2", "0.9", "0.9", "40"),
    ]
    assert table.rows[1][-1] == "world_2"
