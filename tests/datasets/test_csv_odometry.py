"""Odometry from tables."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError

from trailmark.errors import SourceError
from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import Session
from trailmark_datasets.config import CsvOdometryConfig
from trailmark_datasets.csv_odometry import CsvOdometry


def csv(tmp_path, text: str, **keys) -> CsvOdometry:
    path = tmp_path / "wheels.csv"
    path.write_text(text)
    return CsvOdometry(CsvOdometryConfig.model_validate({"path": path, **keys}))


def poses(frames) -> np.ndarray:
    return np.array([frame.payload.pose_start_base.array() for frame in frames])


def test_poses_are_seen_from_the_first(tmp_path, play):
    source = csv(tmp_path, "t,x,y,theta\n1,10,20,1.5707963267948966\n2,10,23,1.5707963267948966\n")

    frames = play(source, "wheels")

    np.testing.assert_allclose(poses(frames), [[0, 0, 0], [3, 0, 0]], atol=1e-12)
    assert [frame.stamp_s for frame in frames] == [1.0, 2.0]
    assert source.sensors["wheels"].kind == "odometry"
    assert source.ground_truth() is None


def test_velocities_that_hold_make_the_exact_circle(tmp_path, play):
    """v = 0.5 m/s and omega = 0.25 rad/s drive a circle of 2 m, at whatever rate it is recorded."""
    rng = np.random.default_rng(7)
    stamps_s = np.concatenate([[0.0], np.cumsum(rng.uniform(0.01, 0.5, 200))])
    text = "t,v,omega\n" + "".join(f"{stamp_s!r},0.5,0.25\n" for stamp_s in stamps_s.tolist())

    frames = play(csv(tmp_path, text))

    angles = 0.25 * stamps_s
    circle = np.column_stack([2 * np.sin(angles), 2 * (1 - np.cos(angles))])
    np.testing.assert_allclose(poses(frames)[:, :2], circle, atol=1e-12)
    assert frames[0].payload.twist == Twist2(0.5, 0.0, 0.25)


@pytest.mark.parametrize(("hold", "expected_m"), [("forward", [0.0, 1.0, 3.0]), ("backward", [0.0, 2.0, 5.0])])
def test_a_velocity_holds_forward_or_backward(tmp_path, play, hold, expected_m):
    frames = play(csv(tmp_path, "t,v,omega\n0,1,0\n1,2,0\n2,3,0\n", hold=hold))

    np.testing.assert_allclose(poses(frames)[:, 0], expected_m)


@pytest.mark.parametrize("per_row", [True, False])
def test_a_way_and_a_turn_drive_an_arc(tmp_path, play, per_row):
    """A quarter of a circle of 2 m in ten steps, told step by step or since the start."""
    way_m, turn_rad = math.pi / 10.0, math.pi / 20.0
    rows = [(k, way_m * (1 if per_row else k), turn_rad * (1 if per_row else k)) for k in range(11)]
    text = "t,distance,turn\n" + "".join(f"{k},{way!r},{turn!r}\n" for k, way, turn in rows)

    frames = play(csv(tmp_path, text, per_row=per_row))

    np.testing.assert_allclose(poses(frames)[-1], [2.0, 2.0, math.pi / 2.0], atol=1e-12)
    np.testing.assert_allclose(poses(frames)[0], 0.0)


def test_a_heading_that_is_wrapped_turns_the_short_way(tmp_path, play):
    rows = "".join(f"{k},{0.1 * k},{(3.1 + 0.05 * k + math.pi) % (2 * math.pi) - math.pi!r}\n" for k in range(5))

    frames = play(csv(tmp_path, "t,distance,turn\n" + rows))

    assert poses(frames)[-1][2] == pytest.approx(0.2)
    assert poses(frames)[-1][0] == pytest.approx(0.4, abs=0.01)


def test_turns_that_count_on_are_not_folded(tmp_path, play):
    rows = "".join(f"{k},0,{4.0 * k}\n" for k in range(5))

    frames = play(csv(tmp_path, "t,distance,turn\n0,0,10\n" + rows.replace("0,0,0.0\n", "").replace(",4.0", ",14.0")))

    assert poses(frames)[1][2] == pytest.approx(4.0 - 2.0 * math.pi)  # 14 - 10, as a heading


@pytest.mark.parametrize("columns", ["distance,turn", "distance"])
def test_the_way_of_a_row_whose_stamp_is_repeated_is_driven(tmp_path, play, columns):
    n = columns.count(",") + 1
    rows = "".join(f"{t},1{',0' * (n - 1)}\n" for t in (0, 1, 1, 2))
    source = csv(tmp_path, f"t,{columns}\n" + rows, per_row=True)

    last = play(source)[-1].payload

    assert (last.distance_m if n == 1 else last.pose_start_base.x) == pytest.approx(3.0)


def test_a_way_that_is_no_number_of_metres_is_named(tmp_path, play):
    source = csv(tmp_path, "t,distance,turn\n0,0,0\n1,1e308,0.1\n2,-1e308,0.1\n")

    with pytest.raises(SourceError, match=r"wheels\.csv:4: a way of -inf m|wheels\.csv:3: a way of"):
        play(source)


def test_wheels_drive_arcs(tmp_path, play):
    """Over a quarter turn to the left about a point 1 m beside the robot, track 0.5 m."""
    left, right = 0.75 * math.pi / 2, 1.25 * math.pi / 2
    text = f"t,left,right\n0,10,20\n1,{10 + left!r},{20 + right!r}\n"

    frames = play(csv(tmp_path, text, track_width_m=0.5))

    np.testing.assert_allclose(poses(frames)[1], [1.0, 1.0, math.pi / 2], atol=1e-12)


def test_wheel_steps_of_each_row_in_ticks_add_up(tmp_path, play):
    text = "t,left,right\n0,999,999\n1,100,100\n2,100,100\n"

    frames = play(csv(tmp_path, text, track_width_m=0.5, per_row=True, metres_per_unit=0.001))

    np.testing.assert_allclose(poses(frames), [[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]], atol=1e-12)


@pytest.mark.parametrize(("per_row", "rows"), [(False, "0,7\n1,9\n2,8.5\n"), (True, "0,7\n1,2\n2,-0.5\n")])
def test_a_distance_is_told_since_the_start(tmp_path, play, per_row, rows):
    frames = play(csv(tmp_path, f"t,distance\n{rows}", per_row=per_row))

    assert [frame.payload.distance_m for frame in frames] == [0.0, 2.0, 1.5]
    assert frames[0].payload.pose_start_base is None


def test_units_apply_to_poses_and_rates(tmp_path, play):
    text = "t;x;y;theta;v;omega\n1000;0;0;90;500;45\n2000;0;1000;180;500;45\n"

    frames = play(csv(tmp_path, text, time_unit="ms", metres_per_unit=0.001, angle_unit="deg"))

    np.testing.assert_allclose(poses(frames)[1], [1.0, 0.0, math.pi / 2], atol=1e-12)
    assert frames[1].payload.twist == Twist2(0.5, 0.0, math.radians(45))
    assert frames[1].stamp_s == 2.0


def test_the_quantity_can_be_chosen(tmp_path, play):
    text = "t,x,y,theta,v,omega,distance\n0,0,0,0,1,0,5\n1,9,9,0,1,0,7\n"

    assert play(csv(tmp_path, text))[1].payload.pose_start_base == Pose2(9, 9)
    assert play(csv(tmp_path, text, quantity="velocity"))[1].payload.pose_start_base == Pose2(1)
    assert play(csv(tmp_path, text, quantity="distance"))[1].payload.distance_m == 2.0


def test_a_file_as_that_of_mrclam_is_read_as_it_is(tmp_path, play):
    text = "# UTIAS\n# Time [s]    forward velocity [m/s]    angular\n10.0 \t 0.1 \t 0\n12.0 \t 0 \t 0\n"

    frames = play(csv(tmp_path, text, header=["t", "v", "omega"]))

    np.testing.assert_allclose(poses(frames)[:, 0], [0.0, 0.2])


def test_true_poses_may_stand_in_another_table(tmp_path, play):
    (tmp_path / "truth.dat").write_text("0.0 1 2 0.5\n2.0 2 2 0.5\n")
    source = csv(tmp_path, "t,distance\n0,0\n", poses=tmp_path / "truth.dat", poses_header=["t", "x", "y", "theta"])
    play(source)

    truth = source.ground_truth()

    assert truth is not None
    np.testing.assert_allclose(truth.poses, [[1, 2, 0.5], [2, 2, 0.5]])


@pytest.mark.parametrize(
    ("text", "keys", "message"),
    [
        ("x,y,theta\n1,2,3\n", {}, r"wheels\.csv: no column t; name the one that holds the stamps in columns"),
        ("t,a,b\n1,2,3\n", {}, r"wheels\.csv: besides t it needs columns x, y, theta; left, right; v, omega; distance"),
        ("t,v\n1,2\n", {"quantity": "velocity"}, r"wheels\.csv: quantity velocity needs the columns omega"),
        ("t,left,right\n1,2,3\n", {}, r"wheels\.csv: columns left, right need track_width_m"),
        ("1,2,3\n", {}, r"wheels\.csv:1 has no header row"),
    ],
)
def test_a_table_that_does_not_fit_is_refused(tmp_path, text, keys, message):
    with pytest.raises(SourceError, match=message):
        csv(tmp_path, text, **keys).start(Session())


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("2,fast,0", r"wheels\.csv:3: column 'v' is 'fast', not a number"),
        ("2,nan,0", r"wheels\.csv:3: column 'v' is 'nan', not a finite number"),
        ("soon,1,0", r"wheels\.csv:3: the stamp is 'soon', not a number"),
        ("2,1", r"wheels\.csv:3: expected 3 fields, found 2"),
        ("0.5,1,0", r"wheels\.csv:3: the stamp goes back: 0\.5"),
    ],
)
def test_a_bad_row_is_an_error_or_a_counted_skip_that_does_not_bend_the_way(tmp_path, play, row, message):
    text = f"t,v,omega\n1,1,0\n{row}\n3,1,0\n"

    with pytest.raises(SourceError, match=message):
        play(csv(tmp_path, text))

    source = csv(tmp_path, text, on_bad_frame="skip")
    np.testing.assert_allclose(poses(play(source))[:, 0], [0.0, 2.0])
    assert source.counters() == {"skipped": 1}


def test_a_rename_of_no_quantity_is_refused(tmp_path):
    with pytest.raises(ValidationError, match=r"'speed' is no quantity .*; write \{v: speed\}"):
        csv(tmp_path, "t,v,omega\n", columns={"speed": "v"})
