"""The drawing of how far from its path a robot was."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trailmark.evaluation import evaluate_run_folder, read_run
from trailmark.geometry import Pose2, Trajectory, write_tum
from trailmark.paths import Path as TaughtPath
from trailmark.paths import Waypoint
from trailmark.report import write_report
from trailmark.report.offsets import offset_series

PATH = TaughtPath([Waypoint(index, float(index), Pose2(float(index), 0.0, 0.0)) for index in range(11)])


def beside(offset_m: float, n: int = 3000) -> Trajectory:
    """Return a drive along the x axis, beside it."""
    way_m = np.linspace(0.0, 10.0, n)
    return Trajectory(5.0 + way_m, np.column_stack([way_m, np.full(n, offset_m), np.zeros(n)]))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "trajectories").mkdir()
    (tmp_path / "config.yaml").write_text("mode: replay\n")
    write_tum(tmp_path / "trajectories" / "groundtruth.tum", beside(0.02))
    write_tum(tmp_path / "trajectories" / "fused.tum", beside(-0.01))
    return tmp_path


def test_offsets_of_truth_and_belief_are_those_from_the_path(folder: Path) -> None:
    found = offset_series(evaluate_run_folder(read_run(folder)), PATH)

    assert found.keys() == {"groundtruth", "fused"}
    for name, offset_m in {"groundtruth": 0.02, "fused": -0.01}.items():
        time_s, lateral_m = found[name].T
        assert len(time_s) <= 800
        assert (time_s[0], time_s[-1]) == pytest.approx((0.0, 10.0), abs=0.02)
        np.testing.assert_allclose(lateral_m, offset_m, atol=1e-9)


def test_without_a_path_there_is_no_drawing(folder: Path) -> None:
    evaluated = evaluate_run_folder(read_run(folder))

    assert offset_series(evaluated, None) == {}
    assert offset_series(evaluated, TaughtPath([Waypoint(0, 0.0, Pose2())])) == {}
    write_report(folder)
    assert not (folder / "plots" / "offsets.svg").exists()


def test_with_a_path_the_page_has_the_drawing(folder: Path) -> None:
    page = write_report(folder, path=PATH).read_text(encoding="utf-8")

    assert "Offset from the taught path" in page
    assert "Left of the path" in (folder / "plots" / "offsets.svg").read_text(encoding="utf-8")
