"""CI fails where a bar of accuracy is missed, and only there."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from trailmark.experiments import Row

SCRIPT = Path(__file__).parents[2] / ".ci" / "judge_rows.py"


@pytest.fixture(scope="module")
def judging(load_script: Callable[[str], ModuleType]) -> ModuleType:
    return load_script(".ci/judge_rows.py")


def rows(*more: Row, n: int = 40) -> list[dict[str, Any]]:
    """Return rows that meet their bars, and some more."""
    good = [Row("Table 1", f"error {k}", "m", 0.1, bar=0.2) for k in range(n)]
    return [row.document() for row in [*good, *more]]


def test_a_missed_bar_of_accuracy_fails(judging: ModuleType) -> None:
    lines, is_good = judging.report(rows(Row("Fig. 5", "offset", "m", 0.4, bar=0.3)))

    assert not is_good
    assert lines[0] == "missed: Fig. 5, offset: 0.4 m, asked for 0.3"


def test_what_could_not_be_measured_fails(judging: ModuleType) -> None:
    lines, is_good = judging.report(rows(Row("Fig. 5", "offset", "m", None, bar=0.3)))

    assert not is_good
    assert "nothing m" in lines[0]


@pytest.mark.parametrize(
    "slow",
    [
        Row("E times", "search", "ms", 9.0, bar=8.0),
        Row("E start", "cold", "s", 12.0, bar=10.0),
        Row("rate", "landmarks", "fps", 9.0, bar=15.0, better="higher"),
        Row("Table 1, paired", "time, SURF only over developed", "x", 0.9, bar=1.0, better="higher"),
    ],
    ids=lambda row: row.unit,
)
def test_times_are_told_and_not_judged(judging: ModuleType, slow: Row) -> None:
    lines, is_good = judging.report(rows(slow))

    assert is_good
    assert any(line.startswith("slow (not judged)") for line in lines)


def test_rows_that_have_gone_missing_fail(judging: ModuleType) -> None:
    assert not judging.report(rows(n=5))[1]


@pytest.mark.parametrize(("ours", "code"), [(0.1, 0), (0.9, 1)])
def test_the_exit_code_says_it(tmp_path: Path, ours: float, code: int) -> None:
    file = tmp_path / "rows.json"
    file.write_text(json.dumps(rows(Row("e", "i", "m", ours, bar=0.2))), encoding="utf-8")

    done = subprocess.run([sys.executable, str(SCRIPT), str(file)], capture_output=True, text=True, check=False)

    assert done.returncode == code


@pytest.mark.parametrize("more", [[], [Row("E times", "search", "ms", 7.0, bar=8.0)], [Row("e", "i", "m", 0.1)]])
def test_a_paper_that_brings_no_bar_of_accuracy_fails(tmp_path: Path, more: list[Row]) -> None:
    files = [tmp_path / "good.json", tmp_path / "bare.json"]
    for file, brought in zip(files, (rows(), [row.document() for row in more]), strict=True):
        file.write_text(json.dumps(brought), encoding="utf-8")

    done = subprocess.run([sys.executable, str(SCRIPT), *map(str, files)], capture_output=True, text=True, check=False)

    assert done.returncode == 1
    assert f"missed: {files[1]} has no row with a bar of accuracy" in done.stdout
