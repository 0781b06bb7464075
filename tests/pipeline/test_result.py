"""What a run hands to a notebook."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from trailmark.geometry import Pose2, Trajectory, notebook
from trailmark.pipeline import RunResult

WAY = Trajectory.from_poses([(0.0, Pose2()), (0.5, Pose2(3.0, 4.0, 0.1)), (2.0, Pose2(3.0, 5.0, 0.2))])


@pytest.fixture
def result() -> RunResult:
    """A run with two trajectories, one of them empty."""
    empty = Trajectory(np.zeros(0), np.zeros((0, 3)))
    metrics = {"trajectories": {"fused": {"metrics": {"ate_rmse_m[se2,n=3]": 0.25}}}}
    return RunResult(
        "done",
        "the <end>",
        counters={f"count.{k}": k for k in range(500)},
        trajectories={"lost": empty, "fused": WAY},
        ground_truth=WAY,
        folder=Path("runs/now"),
        metrics=metrics,
    )


def test_reprs_say_what_it_is_in_one_line(result: RunResult) -> None:
    assert repr(WAY) == "Trajectory(3 poses, 0 to 2 s, 6 m)"
    assert repr(result.trajectories["lost"]) == "Trajectory(no poses)"
    assert repr(result) == "RunResult(done: the <end>; trajectories lost, fused, folder 'runs/now')"


def test_a_trajectory_becomes_a_table() -> None:
    pytest.importorskip("pandas")

    table = WAY.to_frame()

    assert table.index.name == "stamp_s"
    assert table.loc[0.5].tolist() == pytest.approx([3.0, 4.0, 0.1])


def test_a_run_becomes_one_table_of_all_its_poses(result: RunResult) -> None:
    pytest.importorskip("pandas")

    table = result.to_frame()

    assert table.columns.tolist() == ["trajectory", "stamp_s", "x", "y", "theta"]
    assert table.groupby("trajectory").size().to_dict() == {"fused": 3, "groundtruth": 3}
    assert RunResult("done").to_frame().empty


def test_without_pandas_it_is_said_how_it_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(notebook, "import_module", missing)

    with pytest.raises(ImportError, match=r"pip install 'trailmark\[notebook\]'"):
        WAY.to_frame()


def test_plots_draw_into_the_axes_that_are_given(result: RunResult) -> None:
    axes = Figure().subplots()

    assert result.plot(axes) is axes

    assert [line.get_label() for line in axes.lines] == ["groundtruth", "fused"]
    np.testing.assert_array_equal(axes.lines[1].get_xydata(), WAY.positions)


def test_a_notebook_shows_a_table_and_no_markup_of_the_run(result: RunResult) -> None:
    html = result._repr_html_()

    assert "the &lt;end&gt;" in html
    assert "<td>fused</td><td>3</td><td>6</td><td>0.25</td>" in html
    assert "count.7" not in html


def test_a_notebook_shows_the_ends_and_a_sketch_of_a_trajectory() -> None:
    html = WAY._repr_html_()

    assert "Trajectory(3 poses, 0 to 2 s, 6 m)" in html
    assert "<td>last</td><td>2.000</td><td>3.000</td><td>5.000</td><td>0.200</td>" in html
    assert 'points="5.0,185.0 113.0,41.0 113.0,5.0"' in html  # y up, as long as the longer side


def test_the_ends_are_told_apart_at_stamps_of_the_epoch_and_far_from_the_origin() -> None:
    html = Trajectory([1.764e9, 1.764e9 + 12.5], [[123456.7, 0.0, 0.0], [123457.9, 0.0, 0.0]])._repr_html_()

    assert "<td>1764000000.000</td><td>123456.700</td>" in html
    assert "<td>1764000012.500</td><td>123457.900</td>" in html


def test_a_sketch_of_many_poses_is_small_and_one_of_none_or_of_rest_is_possible() -> None:
    stamps_s = np.arange(50_000.0)
    poses = np.column_stack([np.cos(stamps_s / 1e4), np.sin(stamps_s / 1e4), np.zeros(50_000)])

    assert len(Trajectory(stamps_s, poses)._repr_html_()) < 10_000
    assert Trajectory(np.zeros(0), np.zeros((0, 3)))._repr_html_() == "<p>Trajectory(no poses)</p>"
    assert "nan" not in Trajectory.from_poses([(0.0, Pose2(1.0, 2.0, 0.0))])._repr_html_()
