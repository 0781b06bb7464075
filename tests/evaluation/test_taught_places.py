"""A map that was taught by odometry is bent: what is said in it is judged in it, and how far it is off is said."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from trailmark import paths
from trailmark.arrays import Floats
from trailmark.errors import DataError
from trailmark.evaluation import evaluate_run
from trailmark.evaluation.map_frame import ONE_FRAME
from trailmark.evaluation.path_file import PATH_FILE, write_path
from trailmark.evaluation.taught_places import (
    TRUTH_FILE,
    BentMapFrame,
    bent_map_frame,
    read_taught_places,
    write_taught_places,
)
from trailmark.geometry import Pose2, Trajectory, wrap_angles
from trailmark.paths import TaughtPlaces

Write = Callable[..., Path]
_SIGMAS = np.array([0.02, 0.02, 0.01])


def _bent(truth: Floats) -> Floats:
    """Return where odometry with a heading that drifts by 0.05 deg a step has true poses."""
    pose, before = Pose2.from_array(truth[0]), Pose2.from_array(truth[0])
    bent = [pose]
    for row in truth[1:]:
        here = Pose2.from_array(row)
        pose = pose @ before.between(here) @ Pose2(0.0, 0.0, math.radians(0.05))
        before = here
        bent.append(pose)
    return np.array([one.array() for one in bent])


@pytest.fixture
def places(figure_eight: Trajectory) -> TaughtPlaces:
    """Return a figure eight that was taught 1 m off at its end."""
    truth = figure_eight.poses[::4]
    return TaughtPlaces(_bent(figure_eight.poses)[::4], truth)


def _fixes(poses: Floats, stamps_s: Floats, off_m: float = 0.0) -> list[str]:
    rng = np.random.default_rng(3)
    information = ",".join(f"{value:.9g}" for value in _information())
    rows = []
    for stamp_s, pose in zip(stamps_s.tolist(), poses, strict=True):
        x, y, theta = (pose + rng.normal(0.0, _SIGMAS) + [0.0, off_m, 0.0]).tolist()
        rows.append(f"{stamp_s},cam,fix,,{stamp_s},{x:.9g},{y:.9g},{theta:.9g},{information},accepted,,,,")
    return rows


def _information() -> tuple[float, ...]:
    xx, yy, tt = (1.0 / _SIGMAS**2).tolist()
    return xx, 0.0, 0.0, yy, 0.0, tt


def _replay(
    write_run: Write, way: Trajectory, places: TaughtPlaces | None, off_m: float = 0.0, name: str = "run"
) -> Path:
    """Write a replay on the way, a hand beside it, by a camera that is honest in the bent map, or off."""
    assert len(way) == 401
    aside = Trajectory(way.stamps_s, np.array([(Pose2.from_array(p) @ Pose2(0.0, 0.05)).array() for p in way.poses]))
    taught = TaughtPlaces(_bent(way.poses), way.poses)
    in_map = BentMapFrame(places=taught).in_map(aside.poses)
    folder = write_run(
        {"fused": Trajectory(way.stamps_s, in_map)},
        truth=aside,
        estimates=_fixes(in_map[::4], way.stamps_s[::4], off_m),
        name=name,
    )
    (folder / "run.json").write_text(json.dumps({"status": "done", "mode": "replay"}))
    waypoints = [paths.Waypoint(i, 0.03 * i, Pose2.from_array(p)) for i, p in enumerate(taught.in_map[::4])]
    write_path(paths.Path(waypoints), folder / PATH_FILE)
    if places is not None:
        write_taught_places(places, folder / TRUTH_FILE)
    return folder


def test_an_honest_localizer_in_a_bent_map_is_consistent(
    write_run: Write, figure_eight: Trajectory, places: TaughtPlaces
) -> None:
    document = evaluate_run(_replay(write_run, figure_eight, places), write=False)

    assert 0.7 < document["sources"]["cam"]["nees"]["per_dof"] < 1.4
    assert document["map_frame"].startswith("the taught map is 0.")
    assert "at most 0.95 m" in document["map_frame"]


def test_without_the_truth_of_teaching_the_map_counts_as_the_localizers_error_and_that_is_said(
    write_run: Write, figure_eight: Trajectory
) -> None:
    document = evaluate_run(_replay(write_run, figure_eight, None), write=False)

    assert document["sources"]["cam"]["nees"]["per_dof"] > 100.0
    assert "nobody knows how far the map is off" in document["map_frame"]


def test_a_localizer_that_is_off_in_the_map_is_not_excused(
    write_run: Write, figure_eight: Trajectory, places: TaughtPlaces
) -> None:
    document = evaluate_run(_replay(write_run, figure_eight, places, off_m=0.2), write=False)

    assert document["sources"]["cam"]["nees"]["per_dof"] > 20.0


def test_the_true_way_is_beside_the_path_by_as_much_as_it_was_beside_the_taught_one(
    write_run: Write, figure_eight: Trajectory, places: TaughtPlaces
) -> None:
    folder = _replay(write_run, figure_eight, places)
    path = paths.Path(
        [paths.Waypoint(i, 0.03 * i, Pose2.from_array(p)) for i, p in enumerate(_bent(figure_eight.poses)[::4])]
    )

    metrics = evaluate_run(folder, path=path, write=False)["trajectories"]["groundtruth"]["metrics"]

    lateral = next(value for name, value in metrics.items() if name.startswith("lateral_median_m"))
    assert lateral == pytest.approx(0.05, abs=0.01)


def test_where_a_path_comes_back_the_heading_says_which_place_is_meant() -> None:
    there = np.array([[x, 0.0, 0.0] for x in range(5)], dtype=float)
    back = np.array([[x, 0.0, math.pi] for x in range(4, -1, -1)], dtype=float)
    truth = np.vstack([there, back])
    frame = BentMapFrame(places=TaughtPlaces(truth + np.repeat([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]], 5, axis=0), truth))

    found = frame.in_map(np.array([[2.1, 0.0, 0.1], [2.1, 0.0, -3.1], [math.nan, 0.0, 0.0]]))

    np.testing.assert_allclose(found[0], [2.1, 0.0, 0.1], atol=1e-12)
    np.testing.assert_allclose(found[1], [2.1, 1.0, -3.1], atol=1e-12)
    assert np.isnan(found[2]).all()


def test_a_true_pose_at_a_place_is_carried_by_the_rigid_motion_of_it(places: TaughtPlaces) -> None:
    frame, aside = BentMapFrame(places=places), Pose2(0.0, 0.0, 0.1)

    found = frame.in_map((Pose2.from_array(places.in_truth[7]) @ aside).array()[None])

    expected = (Pose2.from_array(places.in_map[7]) @ aside).array()
    np.testing.assert_allclose(found[0, :2], expected[:2], atol=1e-12)
    assert wrap_angles(found[:, 2] - expected[2]) == pytest.approx(0.0, abs=1e-12)


def test_truths_of_two_frames_are_not_mixed(places: TaughtPlaces) -> None:
    """The recording that is replayed has a truth that begins at its own origin: teaching says nothing about it."""
    said = places.in_map
    far = TaughtPlaces(places.in_map, places.in_truth + np.array([50.0, 0.0, 0.0]))

    assert bent_map_frame(far, ONE_FRAME, said, places.in_truth) is ONE_FRAME
    assert isinstance(bent_map_frame(places, ONE_FRAME, said, places.in_truth), BentMapFrame)


def test_of_a_map_that_is_hardly_bent_nothing_is_said(figure_eight: Trajectory) -> None:
    hardly = figure_eight.poses + np.array([0.0, 0.003, 0.0])

    frame = bent_map_frame(TaughtPlaces(figure_eight.poses, hardly), ONE_FRAME, figure_eight.poses, hardly)

    assert frame.note == ""
    np.testing.assert_allclose(frame.in_map(hardly), figure_eight.poses, atol=1e-9)  # 3 mm are many sigmas to a camera


def test_places_are_read_as_they_were_written(tmp_path: Path, places: TaughtPlaces) -> None:
    write_taught_places(places, tmp_path / TRUTH_FILE)

    again = read_taught_places(tmp_path / TRUTH_FILE)

    np.testing.assert_array_equal(again.in_map, places.in_map)
    np.testing.assert_array_equal(again.in_truth, places.in_truth)


def test_a_table_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / TRUTH_FILE).write_text("x,y\n1,2\n")

    with pytest.raises(DataError, match="no column 'theta'"):
        read_taught_places(tmp_path / TRUTH_FILE)


def test_between_two_places_the_map_is_bent_as_between_them() -> None:
    stations_m = np.arange(0.0, 3.0, 0.05)
    true = np.column_stack([stations_m, np.zeros_like(stations_m), np.zeros_like(stations_m)])
    frame = BentMapFrame(places=TaughtPlaces(true * [1.05, 1.0, 1.0], true))  # wheels that tell 5 % too much
    there = np.column_stack([np.linspace(0.0, 2.95, 301), np.full(301, 0.01), np.full(301, 0.2)])

    np.testing.assert_allclose(frame.in_map(there), there * [1.05, 1.0, 1.0], atol=1e-12)


def test_poses_are_carried_as_one_after_the_other_would_be(figure_eight: Trajectory) -> None:
    way = figure_eight.poses[::4]
    shifts = np.repeat([[0.0, 0.0, 0.0], [0.0, 0.1, 0.0]], len(way), axis=0)  # the path comes by twice
    truth = np.tile(way, (2, 1)) + shifts
    places = TaughtPlaces(_bent(truth), truth)
    rng = np.random.default_rng(7)
    poses = truth[np.sort(rng.integers(0, len(truth), 400))] + rng.normal(0.0, [0.05, 0.05, 0.1], (400, 3))

    expected, place = [], 0
    for pose in poses:
        apart = truth - pose
        away_m = np.hypot(apart[:, 0], apart[:, 1]) + np.abs(wrap_angles(apart[:, 2]))
        meant = np.flatnonzero(away_m <= away_m.min() + 0.3)
        passes = np.split(meant, np.flatnonzero(np.diff(meant) > 1) + 1)
        goes_on = min(passes, key=lambda one: np.abs(one - place).min())
        place = int(goes_on[away_m[goes_on].argmin()])
        expected.append(place)
    frame = BentMapFrame(places=places)

    np.testing.assert_array_equal(frame.in_map(poses), frame._carry(poses, np.array(expected)))
