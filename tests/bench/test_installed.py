"""Localizers that take part by being installed, with others beside them."""

from __future__ import annotations

from typing import Any

CELLS: dict[str, Any] = {
    "localizers": {"alone": {"wheels": "odometry"}},
    "installed": {"gives": ["fix"], "beside": {"wheels": "odometry"}},
}


def test_an_installed_localizer_runs_with_those_beside_it_and_figures_are_about_it(bench_of) -> None:
    bench = bench_of(CELLS, {"estimator": {"plugin": "kalman"}})

    (cell,) = [cell for cell in bench.cells if cell.coordinates["localizer"] == "toy_fixer"]
    assert cell.is_installed
    assert list(cell.request["document"]["localizers"]) == ["wheels", "toy_fixer"]
    assert cell.request["localizer"] == "toy_fixer"


def test_one_that_cannot_run_beside_them_is_left_out_and_said(bench_of) -> None:
    bench = bench_of(CELLS, {"estimator": {"plugin": "dead_reckoning"}})

    assert "toy_fixer" not in {cell.coordinates["localizer"] for cell in bench.cells}
    assert any("'toy_fixer' is left out" in notice and "both give motion" in notice for notice in bench.notices)
