"""The paper's experiments, in short."""

from __future__ import annotations

from pathlib import Path

import pytest

from trailmark.experiments import ExperimentOptions
from trailmark_ground_vo import experiments


def test_straight_lines_give_the_papers_three_figures_for_two_modes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(experiments, "_QUICK_FLOORS", ("asphalt",))
    monkeypatch.setattr(experiments, "_QUICK_S", 4.0)
    said: list[str] = []

    rows = experiments._straight_rows(ExperimentOptions(quick=True, seed=3, out=tmp_path, report=said.append))

    assert len(said) == 2
    assert [row.unit for row in rows] == ["%", "%", "deg/m"] * 2
    assert [row.paper for row in rows if "odometer" in row.item] == [0.99, 0.99]
    assert all(row.ours is not None and 0 <= abs(row.ours) < 1.0 for row in rows)
    assert all(row.met for row in rows if row.bar is not None)
