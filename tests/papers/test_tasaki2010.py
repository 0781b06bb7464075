"""The paper's experiments: their parts by themselves, and the quick version by the command line."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from trailmark.geometry import Pose2
from trailmark.paths import Keyframe, Waypoint
from trailmark.paths import Path as TaughtPath
from trailmark_omni_surf.landmark_map import Candidates
from trailmark_omni_surf.laser.scan_map import ScanMap
from trailmark_papers.tasaki2010.goals import GoalDrive, can_stand, random_starts
from trailmark_papers.tasaki2010.labels import first_hit, labelled_candidates
from trailmark_papers.tasaki2010.variants import Answers


@pytest.fixture(scope="module")
def walls() -> ScanMap:
    """Return a square room of 8 m around the origin."""
    along = np.arange(-4.0, 4.0, 0.05)
    sides = [np.stack([along, np.full(len(along), side)], axis=1) for side in (-4.0, 4.0)]
    return ScanMap.from_scans([np.concatenate([*sides, *(side[:, ::-1] for side in sides)])], [Pose2()])


def test_a_ray_ends_at_the_first_wall(walls: ScanMap) -> None:
    hit = first_hit(walls, Pose2(1.0, 0.5, math.pi / 2), -math.pi / 2)

    assert hit is not None
    np.testing.assert_allclose(hit, [4.0, 0.5], atol=0.12)


def test_a_ray_out_of_the_map_hits_nothing(walls: ScanMap) -> None:
    assert first_hit(walls, Pose2(9.0, 0.0, 0.0), 0.0) is None


def candidates_at(positions: list[tuple[float, float]]) -> Candidates:
    n = len(positions)
    return Candidates(
        np.arange(n), np.array(positions), np.zeros((n, 2, 2)), np.arange(6.0 * n).reshape(n, 6), np.ones(n, int),
        [np.zeros((1, 4), np.float32)] * n, np.ones(n, np.int8),
    )  # fmt: skip


def test_labels_say_which_candidates_were_measured_well(walls: ScanMap) -> None:
    poses = [Pose2(x, 0.0, 0.3) for x in (-1.0, -0.5, 0.0, 0.5)]
    true = np.array([[2.0, 4.0], [-4.0, 1.0], [0.0, -4.0]])
    keyframes = [
        Keyframe(float(k), float(k), pose, {
            "ids": np.arange(3 if k < 2 else 2),
            "bearings": np.arctan2(*(true - (pose.x, pose.y)).T[::-1])[: 3 if k < 2 else 2] - pose.theta,
            "pose_base_camera": np.zeros(3),
        })
        for k, pose in enumerate(poses)
    ]  # fmt: skip
    measured = candidates_at([(2.2, 4.1), (-3.0, 1.6), (0.0, -4.0)])

    features, is_good = labelled_candidates(keyframes, {float(k): p for k, p in enumerate(poses)}, walls, measured)

    np.testing.assert_array_equal(is_good, [True, False])  # the third was seen twice only: nobody knows its place
    np.testing.assert_array_equal(features, measured.features[:2])


def test_random_starts_are_beside_the_path_and_free() -> None:
    path = TaughtPath(Waypoint(k, 0.1 * k, Pose2(1.0 + 0.1 * k, 2.0, 0.0)) for k in range(40))

    starts = random_starts(path, 5, seed=3)

    assert starts == random_starts(path, 5, seed=3)
    assert all(np.hypot(*(path.positions - start[:2]).T).min() <= 0.5 for start in starts)
    assert all(can_stand(start) for start in starts)
    assert not can_stand((3.2, 4.6, 0.0))  # in the middle of a shelf


def test_no_start_is_left_out_where_the_robot_can_stand() -> None:
    """Beside a shelf it can stand, but not turn: some of the starts beside the taught way are such places."""
    path = TaughtPath(Waypoint(k, 0.1 * k, Pose2(8.5, 4.0 + 0.1 * k, math.pi / 2)) for k in range(20))

    starts = random_starts(path, 20, seed=1)

    assert any(not all(can_stand((x, y, heading + turn)) for turn in range(0, 180, 10)) for x, y, heading in starts)


def test_an_arrival_counts_only_where_the_robot_said_so() -> None:
    way = np.zeros((2, 2))

    assert GoalDrive(True, 0.05, way, way, 0, 0.0, 0).arrived
    assert not GoalDrive(False, 0.05, way, way, 0, 0.0, 0).arrived
    assert not GoalDrive(True, 0.15, way, way, 0, 0.0, 0).arrived
    assert not GoalDrive(True, 0.05, way, way, 0, 0.0, 1).arrived  # it touched something


def test_answers_know_their_errors_and_what_was_lost() -> None:
    said = np.array([[0.3, 0.4, 0.0], [np.nan] * 3])
    answers = Answers(np.zeros((2, 3)), said, np.zeros(2), np.zeros(2), np.array([1.0, np.nan]))

    np.testing.assert_allclose(answers.errors_m, [0.5, np.nan])
    assert answers.fixed_share == 0.5


@pytest.mark.long
def test_the_quick_experiments_run_and_report_every_part(tmp_path: Path) -> None:
    arguments = ["reproduce", "tasaki2010", "--quick", "--json", "--out", str(tmp_path)]
    command = [sys.executable, "-m", "trailmark.cli", *arguments]

    found = subprocess.run(command, capture_output=True, text=True, timeout=900, check=False)

    assert found.returncode == 0, found.stderr
    rows = json.loads(found.stdout)
    names = {row["experiment"] for row in rows}
    assert {"Table 1", "Table 2", "4 people walking", "Laser alone, unknown start"} <= names
    assert all(row["met"] for row in rows if row["bar"] is not None)
    assert all(row["ours"] is not None for row in rows)
    for plot in ("tasaki2010_fig6_positions.svg", "tasaki2010_fig7_routes.svg"):
        assert (tmp_path / "tasaki2010" / plot).read_text(encoding="utf-8").startswith("<?xml")
