"""What the map and the time axis show."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trailmark import paths
from trailmark.evaluation import evaluate_run_folder, read_run
from trailmark.geometry import Pose2, Trajectory, write_tum
from trailmark.pipeline.outputs.beliefs import BELIEF_COLUMNS
from trailmark.report import write_report
from trailmark.report.explorer import explorer_document
from trailmark.report.write import drawn_trajectories

Write = Callable[..., Path]


def unpacked(column: list[int | None]) -> np.ndarray:
    """Return the numbers of a packed column."""
    steps, *rest = column
    values, total = [], 0
    for step in rest:
        total += step or 0
        values.append(np.nan if step is None else total / steps)
    return np.array(values)


def data_of(page: Path) -> dict[str, Any]:
    """Return what a page hands to its script."""
    found = re.search(r'<script type="application/json" id="explorer-data">(.*?)</script>', page.read_text(), re.DOTALL)
    assert found is not None
    return json.loads(found[1])


def document_of(folder: Path, path: paths.Path | None = None) -> dict[str, Any]:
    """Return what the page of a run would hand to its script."""
    evaluated = evaluate_run_folder(read_run(folder))
    document = explorer_document(evaluated, drawn_trajectories(evaluated), path, {})
    return json.loads(json.dumps(document, allow_nan=False))


@pytest.fixture
def run(fake_run: Write) -> Path:
    """A run with everything: beliefs that are certain to 2 cm, a room, a robot."""
    folder = fake_run(seconds=30.0)
    rows = [
        [0.5 * k, 0.1 * k, 0.0, np.pi / 2, 4e-4, 0.0, 0.0, 1e-4, 0.0, 1e-4] for k in range(60)
    ]  # looks along y: 1 cm ahead, 2 cm to the side
    lines = [",".join(BELIEF_COLUMNS), *(",".join(map(repr, map(float, row))) for row in rows)]
    (folder / "beliefs.csv").write_text("\n".join(lines) + "\n")
    room = [[-5, -1], [5, -1], [5, 6], [-5, 6], [-5, -1]]
    (folder / "outlines.json").write_text(json.dumps({"around": [room], "robot": [[0.3, 0.2], [-0.3, 0.0]]}))
    return folder


def test_lines_lie_where_the_trajectories_lie(run: Path) -> None:
    data = document_of(run)

    truth = next(track for track in data["tracks"] if track["name"] == "groundtruth")
    way = read_run(run).truth
    assert way is not None
    drawn = np.column_stack([unpacked(truth["x"]), unpacked(truth["y"])])
    np.testing.assert_allclose(drawn[0], way.positions[0], atol=1e-4)
    np.testing.assert_allclose(drawn[-1], way.positions[-1], atol=1e-4)
    assert data["around"] == [[[-5, -1], [5, -1], [5, 6], [-5, 6], [-5, -1]]]
    assert data["robot"] == [[0.3, 0.2], [-0.3, 0.0]]


def test_errors_of_the_map_are_those_of_the_metrics(run: Path) -> None:
    data = document_of(run)

    evaluated = evaluate_run_folder(read_run(run))
    fused = next(track for track in data["tracks"] if track["name"] == "fused")
    distance = np.hypot(unpacked(fused["ahead"]), unpacked(fused["left"]))
    assert np.nanmax(distance) == pytest.approx(evaluated.evaluations["fused"].absolute.position.max, abs=2e-6)


def test_an_error_to_the_left_is_left(tmp_path: Path) -> None:
    stamps = np.arange(0.0, 5.0, 0.1)
    heading = np.full_like(stamps, np.pi / 2)  # along y, so that left is -x
    truth = Trajectory(stamps, np.column_stack([0.0 * stamps, stamps, heading]))
    folder = tmp_path / "run"
    (folder / "trajectories").mkdir(parents=True)
    write_tum(folder / "trajectories/groundtruth.tum", truth)
    aside = np.zeros_like(truth.poses)
    aside[24:26, 0] = -0.2
    write_tum(folder / "trajectories/fused.tum", Trajectory(stamps, truth.poses + aside))

    data = document_of(folder)

    left = unpacked(next(track for track in data["tracks"] if track["name"] == "fused")["left"])
    assert left[24] - np.median(left) == pytest.approx(0.2, abs=0.01)  # the alignment moves the way a little


def test_sigmas_are_told_in_the_axes_of_the_robot(run: Path) -> None:
    beliefs = document_of(run)["beliefs"]

    np.testing.assert_allclose(unpacked(beliefs["ahead"]), 0.01, atol=1e-6)
    np.testing.assert_allclose(unpacked(beliefs["left"]), 0.02, atol=1e-6)
    np.testing.assert_allclose(unpacked(beliefs["long"]), 0.02, atol=1e-6)
    np.testing.assert_allclose(unpacked(beliefs["short"]), 0.01, atol=1e-6)


def test_a_stretch_in_which_a_localizer_was_lost_is_told_with_its_reason(run: Path) -> None:
    gaps = [gap for gap in document_of(run)["gaps"] if gap["name"] == "floor"]

    assert [(gap["kind"], gap["reason"]) for gap in gaps] == [("lost", "too dark, blurred")]
    assert gaps[0]["from"] == pytest.approx(15.0, abs=0.11)
    assert gaps[0]["to"] == pytest.approx(18.0, abs=0.11)


def test_a_stretch_without_a_word_is_silence(run: Path) -> None:
    table = run / "estimates.csv"
    kept = [line for line in table.read_text().splitlines() if ",floor," not in line or ",lost," not in line]
    table.write_text("\n".join(kept) + "\n")

    gaps = [gap for gap in document_of(run)["gaps"] if gap["name"] == "floor"]

    assert [gap["kind"] for gap in gaps] == ["silent"]


def test_a_localizer_that_never_answered_darkens_nothing(run: Path) -> None:
    table = run / "estimates.csv"
    head, *rows = table.read_text().splitlines()
    kept = [row for row in rows if ",floor," not in row or ",lost," in row]
    table.write_text("\n".join([head, *kept]) + "\n")

    data = document_of(run)

    assert not [gap for gap in data["gaps"] if gap["name"] == "floor"]
    assert next(lane for lane in data["lanes"] if lane["name"] == "floor")["counts"].keys() == {"lost"}


def test_fixes_that_were_not_accepted_are_all_there(run: Path) -> None:
    fixes = document_of(run)["fixes"]

    counts = read_run(run).estimates.of("floor_map").counts()  # type: ignore[union-attr]
    (told,) = fixes
    assert told["name"] == "floor_map"
    assert sum(outcome != 0 for outcome in told["outcome"]) == counts["gated"] + counts.get("late", 0)


def test_the_taught_path_is_drawn_where_the_map_lies(run: Path) -> None:
    path = paths.Path([paths.Waypoint(k, float(k), Pose2(float(k), 1.0, 0.0)) for k in range(5)])
    pose = evaluate_run_folder(read_run(run)).evaluations["fused"].absolute.alignment.pose_truth_estimate

    taught = np.array(document_of(run, path)["taught"])

    np.testing.assert_allclose(taught, pose @ np.ascontiguousarray(path.positions), atol=1e-4)


@pytest.mark.filterwarnings("ignore:overflow encountered", "ignore:invalid value encountered")
def test_a_fix_beyond_all_reason_is_a_gap(run: Path) -> None:
    table = run / "estimates.csv"
    head, *rows = table.read_text().splitlines()
    fix = next(row for row in rows if ",fix," in row).split(",")
    fix[5] = "1e308"
    table.write_text("\n".join([head, ",".join(fix), *rows]) + "\n")

    (told,) = document_of(run)["fixes"]

    assert np.isnan(unpacked(told["x"])).sum() == 1


def test_words_of_a_run_cannot_end_the_data(run: Path) -> None:
    table = run / "estimates.csv"
    table.write_text(table.read_text().replace('"too dark, blurred"', '"</script><script>alert(1)</script>"'))

    page = write_report(run)

    assert page.read_text().count("<script") == 2
    assert data_of(page)["gaps"][0]["reason"] == "</script><script>alert(1)</script>"


def test_broken_beliefs_and_outlines_are_told_and_left_out(run: Path) -> None:
    (run / "beliefs.csv").write_text("stamp_s,x\n1,2\n")
    (run / "outlines.json").write_text('{"around": [[[1]]]}')

    page = write_report(run)

    assert data_of(page)["beliefs"] is None
    assert "is not a table of beliefs" in page.read_text()
    assert "holds no outlines" in page.read_text()


def test_a_run_without_truth_has_differences_and_no_fix_errors(fake_run: Write) -> None:
    data = document_of(fake_run(seconds=10.0, has_truth=False))

    assert data["errors"] is False
    assert data["reference"] == "fused"
    assert all("ahead" not in item for item in data["fixes"])
