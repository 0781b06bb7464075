"""Who says path offsets is judged by what he says: along, lateral, heading; never as poses."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from trailmark import paths
from trailmark.evaluation import evaluate_run, find_metric
from trailmark.geometry import Pose2, Trajectory
from trailmark.report.tables import Trajectories, offsets_table, trajectories_table

Write = Callable[..., Path]


@pytest.fixture
def path() -> paths.Path:
    """A straight line of 10 m, 0.1 m to the left of where base drives."""
    return paths.Path(paths.Waypoint(k, float(k), Pose2(float(k), 0.1, 0.0)) for k in range(11))


def offsets(truth: Trajectory, lateral: float, info: str = "0,0,0,1e4,0,1e4") -> list[str]:
    """Return offsets that are 20 mm too far left and turned by 1 degree; nothing is said of the way."""
    told = f"{lateral + 0.02!r},{math.radians(1.0)!r}"
    return [
        f"{t},streams,path_offset,,{t},{x!r},{told},{info},accepted,,,,"
        for t, x in zip(truth.stamps_s.tolist(), truth.positions[:, 0].tolist(), strict=True)
    ]


def test_offsets_are_compared_with_the_truth_on_the_path(
    write_run: Write, straight: Trajectory, path: paths.Path
) -> None:
    folder = write_run({"fused": straight}, truth=straight, estimates=offsets(straight, -0.1))

    metrics = evaluate_run(folder, path=path)["sources"]["streams"]["metrics"]

    assert metrics["offset_lateral_rmse_m[n=101]"] == pytest.approx(0.02, abs=1e-6)
    assert metrics["offset_heading_rmse_deg[n=101]"] == pytest.approx(1.0, abs=1e-6)
    assert find_metric(metrics, "offset_along_rmse_m") is None  # it was not measured


def test_they_have_a_table_of_their_own_and_no_row_among_the_trajectories(
    write_run: Write, straight: Trajectory, path: paths.Path
) -> None:
    nothing = Trajectory([], np.empty((0, 3)))
    folder = write_run({"streams": nothing, "fused": straight}, truth=straight, estimates=offsets(straight, -0.1))
    evaluate_run(folder, path=path)

    document = evaluate_run(folder, write=False)  # the path is in the folder now
    rows = trajectories_table(Trajectories.of_run(document)).rows
    table = offsets_table([((name,), item) for name, item in document["sources"].items()])

    assert [row[0] for row in rows] == ["fused", "standstill"]
    assert table is not None
    assert table.title == "Path offsets against the ground truth"
    shown = {column.title: cell for column, cell in zip(table.columns, table.rows[0], strict=True)}
    assert shown == {"localizer": "streams", "lateral rmse": "20.0", "heading rmse": "1.00"}


def test_without_truth_they_are_differences_from_the_belief(
    write_run: Write, straight: Trajectory, path: paths.Path
) -> None:
    folder = write_run({"fused": straight}, estimates=offsets(straight, -0.1))

    document = evaluate_run(folder, path=path)
    metrics = document["sources"]["streams"]["metrics"]
    table = offsets_table([((name,), item) for name, item in document["sources"].items()])

    assert metrics["offset_lateral_difference_rmse_m[n=101]"] == pytest.approx(0.02, abs=1e-6)
    assert "offset_lateral_rmse_m[n=101]" not in metrics
    assert table is not None
    assert table.title == "Path offsets against the belief"


def test_who_says_poses_as_well_keeps_the_row(write_run: Write, straight: Trajectory, path: paths.Path) -> None:
    rows = [*offsets(straight, -0.1), "10.0,streams,fix,,10.0,10,0,0,1,0,0,1,0,1,accepted,,,,"]
    folder = write_run({"streams": straight, "fused": straight}, truth=straight, estimates=rows)

    document = evaluate_run(folder, path=path)

    assert document["sources"]["streams"]["says_places"]
    assert "streams" in [row[0] for row in trajectories_table(Trajectories.of_run(document)).rows]


def test_a_robot_that_never_moved_is_the_floor_of_every_table(write_run: Write, straight: Trajectory) -> None:
    document = evaluate_run(write_run({"fused": straight}, truth=straight))

    table = trajectories_table(Trajectories.of_run(document))

    shown = {column.title: cell for column, cell in zip(table.columns, table.rows[-1], strict=True)}
    assert shown["trajectory"] == "standstill"
    assert float(shown["ATE rmse"]) == pytest.approx(10.0 / math.sqrt(3.0), rel=0.02)  # of a line driven evenly
    assert table.notes == ("Alignment: se2, over 101 pairs of poses.",)


def test_a_truth_that_covers_nothing_says_why(write_run: Write, straight: Trajectory) -> None:
    folder = write_run({"cam": straight, "fused": straight})
    (folder / "trajectories" / "groundtruth.tum").write_text("")

    table = trajectories_table(Trajectories.of_run(evaluate_run(folder, write=False)))

    assert table.notes[0].startswith("The source has a ground truth, but it covers no frame of the run")
    assert "max_truth_gap_s" in table.notes[0]
    assert table.title == "Differences from fused"
