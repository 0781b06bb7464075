"""What the experiments of the paper are made of: truth from depth, scores of drives, figures; and all of it, short."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from trailmark.estimates import PathOffset
from trailmark.frames import Pinhole
from trailmark.geometry import Pose2, Pose3, Trajectory
from trailmark_papers.perroni2014.closed_loop import _share_row
from trailmark_papers.perroni2014.drives import Deviation, Place, Taught
from trailmark_papers.perroni2014.likelihood import _climb, _track_shifts
from trailmark_papers.perroni2014.offline import DriveAnswers, _signs_percent, compare
from trailmark_papers.perroni2014.plots import draw_clutter, draw_corners, draw_likelihood, draw_shifts, draw_ways
from trailmark_papers.perroni2014.true_shift import Eyepiece, Surroundings

LENS = Pinhole(250.0, 250.0, 159.5, 119.5)


@pytest.fixture
def eyepiece():
    return Eyepiece(LENS, (320, 240), Pose3(x=0.2, z=0.5))


@pytest.fixture
def wall(eyepiece):
    """A wall 5 m before the camera, seen from the origin."""
    points = eyepiece.points(np.full((240, 320), 5.0, dtype=np.float32), Pose2())
    return Surroundings(eyepiece, [Pose2()], [points])


def way(lateral_m, heading_rad=0.0, arrived=True, length_m=10.0):
    stations_m = np.linspace(0.0, length_m, len(lateral_m))
    return Deviation(stations_m, np.array(lateral_m), np.full(len(lateral_m), heading_rad), arrived)


def straight(length_m, heading_rad=0.0, lateral_m=0.0):
    """Drive straight at 1 m/s, a pose every 10 cm."""
    start = Pose2(0.0, lateral_m, heading_rad)
    steps = range(round(length_m * 10) + 1)
    return Trajectory.from_poses([(0.1 * k, start @ Pose2(0.1 * k, 0.0, 0.0)) for k in steps])


def test_points_of_a_depth_picture_lie_where_they_are(eyepiece):
    depth_m = np.full((240, 320), np.nan, dtype=np.float32)
    depth_m[40, 80] = 4.0

    points = eyepiece.points(depth_m, Pose2(1.0, 2.0, math.pi / 2))

    left_m, up_m = (159.5 - 80) / 250 * 4.0, (119.5 - 40) / 250 * 4.0
    np.testing.assert_allclose(points, [[1.0 - left_m, 2.0 + 0.2 + 4.0, 0.5 + up_m]])


def test_a_robot_to_the_left_of_a_wall_ahead_sees_it_farther_right(wall):
    # 250 px * 0.5 m / 5 m = 25 px; a column is 320 // 50 = 6 px.
    assert wall.shift_columns(Pose2(), Pose2(0.0, 0.5, 0.0)) == pytest.approx(25 / 6)


@pytest.mark.parametrize("turned_deg", [4.0, -4.0])
def test_a_turn_displaces_the_middle_by_what_the_lens_says(wall, turned_deg):
    columns = wall.shift_columns(Pose2(), Pose2(theta=math.radians(turned_deg)))

    assert columns == pytest.approx(250 * math.tan(math.radians(turned_deg)) / 6, rel=0.15)


def test_what_leaves_the_picture_is_not_counted(eyepiece, wall):
    assert np.isnan(eyepiece.u_px(np.array([[-3.0, 0.0, 0.5]]), Pose2())).all()
    assert np.isfinite(wall.shift_columns(Pose2(), Pose2(theta=math.radians(20.0))))


def test_a_drive_is_judged_by_its_end_and_by_what_grows_after_two_metres():
    drive = way([0.0, 0.4, 0.3, 0.1, 0.2, 0.15], heading_rad=math.radians(-2.0))  # stations 0, 2, 4, ...

    assert drive.end_m == 0.15
    assert drive.end_deg == pytest.approx(2.0)
    assert drive.largest_m == 0.4
    assert drive.growth_m == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("drive", "share"),
    [
        (way([0.0, 0.4, 0.2, 0.1]), 100.0),
        (way([0.0, 0.4, 0.2, 0.1], arrived=False), 0.0),
        (way([0.0, 0.4, 0.35, 0.31]), 0.0),
        (way([0.0, 0.4, 0.2, 0.1], heading_rad=0.06), 0.0),
        (way([0.0, 0.4, 0.1, 0.21]), 0.0),
    ],
)
def test_a_robot_came_back_if_it_arrived_near_straight_and_without_drifting_off_again(drive, share):
    assert _share_row("name", "item", [drive], 95.0).ours == share


def test_a_way_has_the_stations_of_its_truth():
    path = Taught(Place("street", 2.0, 320), Path("nowhere"), straight(2.0)).path()

    assert path.length_m == pytest.approx(2.0, abs=0.1)
    assert path.pose_at(1.3).x == pytest.approx(1.3)


def test_answers_are_set_beside_the_truth_of_the_poses_they_match(eyepiece):
    depth_m = np.full((240, 320), 5.0, dtype=np.float32)
    around = Surroundings(eyepiece, [Pose2(1.0, 0.0, 0.0)], [eyepiece.points(depth_m, Pose2(1.0, 0.0, 0.0))])
    taught = Taught(Place("street", 2.0, 320), Path("nowhere"), straight(2.0))
    by_columns = PathOffset(1.0, 1.0, 0.0, 0.0, np.eye(3), {"shift_columns": 4.0, "shift_px": 24.0})
    by_pixels = PathOffset(1.0, 1.2, 0.0, 0.0, np.eye(3), {"shift_px": 12.0})

    told = [("ours", 1.0, by_columns), ("ours", 1.1, None), ("peer", 1.0, by_pixels)]
    answers = compare(told, taught, around, straight(2.0, lateral_m=0.5))

    assert answers["ours"].said == [4.0]
    assert answers["ours"].true == [pytest.approx(25 / 6)]
    assert answers["ours"].spoken_percent == 50.0
    assert answers["peer"].said == [2.0]
    assert answers["peer"].misses_m == [pytest.approx(0.2)]


def test_a_picture_without_an_answer_has_the_wrong_sign():
    """Of 25 + 4 pictures the first 25 fill the window; of the others two are right, one is wrong, one is lost."""
    collecting = DriveAnswers([1.0, 2.0, -1.0], [1.0, 1.0, 1.0], n_lost=26, n_collecting=25)

    assert _signs_percent([collecting]) == 50.0
    assert _signs_percent([DriveAnswers(n_lost=25, n_collecting=25)]) is None


def test_what_is_lost_after_the_first_window_is_not_excused(wall):
    taught = Taught(Place("street", 2.0, 320), Path("nowhere"), straight(2.0))
    told = [("ours", 0.01 * k, None) for k in range(30)]

    answers = compare(told, taught, wall, straight(2.0))["ours"]

    assert (answers.n_lost, answers.n_collecting) == (30, 25)


def test_who_said_nothing_spoke_on_nothing():
    assert DriveAnswers().spoken_percent == 0.0


def test_both_selections_follow_a_shift_that_is_there():
    rng = np.random.default_rng(7)
    taught = np.repeat(rng.uniform(0, 9, (1, 50)), 30, axis=0)

    for select in (_climb, _track_shifts):
        likelihood, path = select(taught, np.roll(taught, 3, axis=1))

        assert likelihood.shape == (30, 41)
        np.testing.assert_allclose(path[-1], 3.0, atol=0.5)


def test_figures_are_drawn_alike_each_time(tmp_path):
    def draw(folder):
        series = {name: np.arange(3.0) for name in ("station", "said", "true")}
        draw_shifts(folder / "a.svg", {0.0: series, 5.0: series, -5.0: series})
        draw_ways(folder / "b.svg", {5.0: [way([0.0, 0.1])], -5.0: [way([0.0, -0.1])]})
        draw_corners(folder / "c.svg", straight(2.0), [way([0.0, 0.1])])
        draw_likelihood(folder / "d.svg", {"x": np.eye(9), "y": np.eye(9)}, {"x": np.zeros(9), "y": np.zeros(9)}, 4)
        draw_clutter(folder / "e.svg", {"x": np.eye(4, dtype=np.float32), "y": np.eye(4, dtype=np.float32)})
        return {path.name: path.read_bytes() for path in folder.glob("*.svg")}

    once, again = draw(tmp_path / "once"), draw(tmp_path / "again")

    assert len(once) == 5
    assert once == again
    assert all(b"<svg" in content for content in once.values())


def test_the_figure_of_shifts_shows_where_nothing_was_said(tmp_path):
    station = np.array([0.0, 0.1, 0.2, 0.9, 1.0, 1.1])  # silent for 0.7 m
    said = np.array([1.0, 1.5, 1.2, 4.0, 4.5, 4.2])

    draw_shifts(tmp_path / "a.svg", {0.0: {"station": station, "said": said, "true": 0.0 * said}})

    (line,) = re.findall(r'<path d="([^"]*)"[^>]*stroke-width: 1.2;', (tmp_path / "a.svg").read_text("utf-8"))[:1]
    assert line.count("M") == 2
    assert ">0°<" in (tmp_path / "a.svg").read_text("utf-8")


@pytest.mark.long
def test_the_short_version_of_the_paper_meets_its_bars(tmp_path):
    command = [
        sys.executable,
        "-m",
        "trailmark.cli",
        "reproduce",
        "perroni2014",
        "--quick",
        "--json",
        "--out",
        tmp_path,
    ]

    found = subprocess.run(command, capture_output=True, text=True, timeout=900, check=True)

    rows = json.loads(found.stdout)
    judged = [row for row in rows if row["met"] is not None and "time" not in row["experiment"]]
    assert len(judged) >= 8
    assert all(row["met"] for row in judged)
    assert len(list((tmp_path / "perroni2014").glob("*.svg"))) >= 4
