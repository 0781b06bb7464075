from __future__ import annotations

from collections.abc import Callable
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from trailmark.report.console import run_table, summary_rows, to_rich
from trailmark.report.tables import Column, Table

Write = Callable[..., Path]


def _printed(table: object, width: int = 100) -> str:
    file = StringIO()
    Console(file=file, width=width).print(table)
    return file.getvalue()


def test_a_run_has_a_row_of_numbers_for_each_localizer_and_the_fused_one(fake_run: Write) -> None:
    folder = fake_run(seconds=20.0)

    rows = {row["name"]: row for row in summary_rows(folder)}

    assert list(rows) == ["floor", "floor_map", "klt", "fused"]
    assert rows["floor"]["outcomes"] == {"accepted": 340, "lost": 59}
    assert rows["floor_map"]["latency_p95_ms"] > 200.0
    assert 0.8 < rows["floor"]["tracked"] < 0.9
    assert rows["fused"]["errors"]
    assert rows["fused"]["rmse_m"] < rows["klt"]["rmse_m"]
    assert rows["fused"]["drift_percent"] > 0.0
    assert not (folder / "metrics.json").exists()


def test_without_ground_truth_the_rows_hold_differences(fake_run: Write) -> None:
    rows = summary_rows(fake_run(seconds=20.0, has_truth=False))

    assert {(row["errors"], row["reference"]) for row in rows} == {(False, "fused")}
    assert rows[0]["rmse_m"] > 0.0
    assert rows[0]["drift_percent"] is None
    assert rows[-1]["rmse_m"] is None


def test_a_localizer_that_was_never_sure_has_a_row(fake_run: Write) -> None:
    folder = fake_run(seconds=20.0)
    (folder / "trajectories" / "klt.tum").unlink()

    rows = {row["name"]: row for row in summary_rows(folder)}

    assert rows["klt"]["poses"] == 0
    assert rows["klt"]["outcomes"] == {"unused": 340}


def test_the_table_of_a_run_fits_into_a_hundred_columns(fake_run: Write) -> None:
    text = _printed(run_table(fake_run(seconds=20.0)))

    assert max(map(len, text.splitlines())) <= 100
    assert "…" not in text
    assert "floor_map" in text


def test_units_stand_in_the_last_line_of_the_header() -> None:
    table = Table((Column("name", is_number=False), Column("ATE rmse", "mm"), Column("poses")), (("a", "1", "2"),))

    first, second, third = _printed(to_rich(table)).splitlines()[1:4]

    assert first.split() == ["name", "ATE", "poses"]
    assert second.split() == ["rmse"]
    assert third.split() == ["mm"]


@pytest.mark.parametrize("name", ["[red]", "[/]", "[link=http://x]y"])
def test_names_are_not_markup(name: str) -> None:
    assert name in _printed(to_rich(Table((Column("name", is_number=False),), ((name,),))))
