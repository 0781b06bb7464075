"""CARMEN logs."""

from __future__ import annotations

import gzip
import math

import numpy as np
import pytest

from trailmark.errors import SourceError
from trailmark.frames import Odometry, Scan
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark_datasets.carmen_lines import parse_line
from trailmark_datasets.carmen_log import CarmenLog
from trailmark_datasets.config import CarmenLogConfig

RANGES = " ".join(["1.5", "0", "81.91", *["2.0"] * 177])


def odom(t: float, x: float, y: float = 0.0, theta: float = 0.0) -> str:
    return f"ODOM {x} {y} {theta} 0 0 0 {t} host {t}"


def flaser(t: float, laser: tuple[float, float, float], robot: tuple[float, float, float] | None = None) -> str:
    poses = " ".join(str(value) for value in (*laser, *(robot or laser)))
    return f"FLASER 180 {RANGES} {poses} {t} host {t}"


def log(tmp_path, *lines: str, **keys) -> CarmenLog:
    path = tmp_path / "a.log"
    path.write_text("# CARMEN\n" + "\n".join(lines) + "\n")
    return CarmenLog(CarmenLogConfig.model_validate({"path": path, **keys}))


def of(frames, sensor):
    return [frame for frame in frames if frame.sensor == sensor]


def test_laser_and_odometry_are_merged_by_stamp(tmp_path, play):
    source = log(
        tmp_path,
        "PARAM robot_frontlaser_offset 0.1 host 0",
        odom(1.0, 5.0),
        odom(1.2, 5.2),
        flaser(1.1, (0, 0, 0)),
        "SYNC something else",
        odom(1.3, 5.3),
    )

    frames = play(source)

    assert [(frame.sensor, frame.stamp_s) for frame in frames] == [
        ("odometry", 1.0),
        ("laser", 1.1),
        ("odometry", 1.2),
        ("odometry", 1.3),
    ]
    assert [frame.payload.pose_start_base.x for frame in of(frames, "odometry")] == pytest.approx([0.0, 0.2, 0.3])
    assert source.sensors["laser"].kind == "scan"
    assert source.sensors["laser"].pose_base_sensor.x == 0.1
    assert source.sensors["odometry"].kind == "odometry"


def test_a_flaser_line_looks_from_right_to_left_and_knows_what_came_back(tmp_path, play):
    (frame,) = play(log(tmp_path, flaser(1.0, (0, 0, 0))))

    scan = frame.payload
    assert isinstance(scan, Scan)
    assert scan.angle_min_rad == pytest.approx(-math.pi / 2)
    assert scan.angle_step_rad == pytest.approx(math.radians(1))
    np.testing.assert_array_equal(scan.ranges_m[:4], [1.5, np.nan, np.nan, 2.0])


@pytest.mark.parametrize(
    ("count", "first_deg", "step_deg"),
    [(180, -90, 1), (181, -90, 1), (360, -90, 0.5), (361, -90, 0.5), (401, -50, 0.25)],
)
def test_the_number_of_beams_tells_their_angles(count, first_deg, step_deg):
    line = f"FLASER {count} {' '.join(['1'] * count)} 0 0 0 0 0 0 1 host 1"

    scan = parse_line(line, "x", 80.0, None).scan()

    assert math.degrees(scan.angles()[0]) == pytest.approx(first_deg)
    assert math.degrees(scan.angles()[1] - scan.angles()[0]) == pytest.approx(step_deg)


def test_a_robotlaser_line_tells_its_angles_and_range(tmp_path, play):
    line = "ROBOTLASER1 0 -1.5 3.0 0.5 20.0 0.01 0 4 1 2 20 3 2 9 9 0.1 0 0 0 0 0 0.1 0.2 0.5 0.5 0.1 7.5 host 7.6"

    (frame,) = play(log(tmp_path, line))

    assert frame.stamp_s == 7.5
    assert frame.payload.angle_min_rad == -1.5
    assert frame.payload.angle_step_rad == 0.5
    np.testing.assert_array_equal(frame.payload.ranges_m, [1, 2, np.nan, 3])


def test_restated_poses_of_a_corrected_log_do_not_leak_into_the_odometry(tmp_path, play):
    """The wheels drive 1 m a second; SLAM says 1.1 m, and the log restates its pose after every scan."""
    lines = [odom(0.0, 0.0)]
    pose = 0.0
    for i in range(1, 4):
        lines += [odom(float(i), pose + 1.0)]
        pose += 1.1
        lines += [flaser(float(i), (pose, 0.0, 0.0)), odom(0.0, pose)]
    source = log(tmp_path, *lines)

    frames = play(source)
    truth = source.ground_truth()

    driven = [frame.payload for frame in of(frames, "odometry")]
    assert [payload.pose_start_base.x for payload in driven] == pytest.approx([0.0, 1.0, 2.0, 3.0])
    assert source.counters() == {"restated": 3}
    assert truth is not None
    np.testing.assert_allclose(truth.stamps_s, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(truth.poses[:, 0], [1.1, 2.2, 3.3])


def test_once_a_log_is_known_as_corrected_restated_poses_may_have_any_stamp(tmp_path, play):
    source = log(
        tmp_path,
        odom(1.0, 1.0),
        flaser(1.0, (1.5, 0, 0)),
        odom(0.0, 1.5),
        odom(2.0, 2.5),
        flaser(2.0, (3.0, 0, 0)),
        odom(1e300, 3.0),  # a stamp that nobody set
        odom(3.0, 4.0),
    )

    frames = play(source)

    assert [frame.stamp_s for frame in of(frames, "odometry")] == [1.0, 2.0, 3.0]
    assert of(frames, "odometry")[-1].payload.pose_start_base.x == pytest.approx(2.0)


def test_a_robot_at_rest_repeats_its_pose_and_is_not_corrected(tmp_path, play):
    source = log(tmp_path, odom(1.0, 5.0), flaser(1.1, (5.0, 0.0, 0.0)), odom(1.2, 5.0), odom(1.3, 6.0))

    frames = play(source)

    assert [frame.payload.pose_start_base.x for frame in of(frames, "odometry")] == [0.0, 0.0, 1.0]
    assert source.ground_truth() is None


def test_true_poses_of_a_simulator_are_the_ground_truth(tmp_path, play):
    source = log(tmp_path, odom(1.0, 0.0), "TRUEPOS 1 2 0.5 0 0 0 1.0 host 1.0", "TRUEPOS 3 2 0.5 0 0 0 2.0 host 2.0")
    play(source)

    truth = source.ground_truth()

    assert truth is not None
    np.testing.assert_allclose(truth.poses, [[1, 2, 0.5], [3, 2, 0.5]])


def test_a_laser_that_moves_against_the_robot_was_corrected(tmp_path, play):
    """Laser poses hold the corrected pose, robot poses the odometry; the laser sits 0.1 m ahead."""
    source = log(
        tmp_path,
        "PARAM robot_frontlaser_offset 0.1 host 0",
        flaser(1.0, (0.1, 0, 0), (0, 0, 0)),
        flaser(2.0, (1.2, 0, 0), (1.0, 0, 0)),
    )
    play(source)

    truth = source.ground_truth()

    assert truth is not None
    np.testing.assert_allclose(truth.poses[:, 0], [0.0, 1.1])


def test_a_raw_log_has_no_truth_but_may_have_odometry_in_its_scans(tmp_path, play):
    lines = (flaser(1.0, (5.1, 0, 0), (5, 0, 0)), flaser(2.0, (6.1, 0, 0), (6, 0, 0)))

    source = log(tmp_path, *lines)
    play(source)
    assert list(source.sensors) == ["laser"]
    assert source.ground_truth() is None

    source = log(tmp_path, *lines, scan_poses="odometry")
    frames = play(source)
    assert [frame.payload for frame in of(frames, "odometry")] == [Odometry(Pose2()), Odometry(Pose2(1.0))]

    source = log(tmp_path, *lines, scan_poses="truth")
    play(source)
    truth = source.ground_truth()
    assert truth is not None
    assert len(truth) == 2


def test_gzipped_logs_are_read(tmp_path, play):
    path = tmp_path / "a.log.gz"
    path.write_bytes(gzip.compress(odom(1.0, 0.0).encode()))

    assert len(play(CarmenLog(CarmenLogConfig.model_validate({"path": path})))) == 1


def test_a_stamp_that_goes_back_is_an_error_or_a_counted_skip_that_loses_no_way(tmp_path, play):
    lines = (odom(1.0, 0.0), odom(3.0, 1.0), odom(2.0, 2.0), odom(4.0, 3.0))

    with pytest.raises(SourceError, match=r"a\.log:4: the stamp goes back: 2\.0+ s after 3\.0+ s of sensor 'odometry'"):
        play(log(tmp_path, *lines))

    source = log(tmp_path, *lines, on_bad_frame="skip")
    assert [frame.payload.pose_start_base.x for frame in play(source)] == [0.0, 1.0, 3.0]
    assert source.counters() == {"skipped": 1}


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("ODOM 1 2 3", r"a\.log:3: ODOM has 4 fields, expected 10: cut off or damaged"),
        ("ODOM 1 2 x 0 0 0 1 host 1", r"a\.log:3: a pose is 'x', not a number"),
        ("FLASER 180 1 2 3", r"a\.log:3: FLASER has 5 fields, expected 191"),
        ("FLASER many 1 2 3", r"a\.log:3: FLASER does not say how many readings follow"),
        (f"FLASER 77 {' '.join(['1'] * 77)} 0 0 0 0 0 0 1 h 1", "angle between its 77 beams; set angle_step_deg"),
        (f"FLASER 180 {RANGES.replace('1.5', 'far')} 0 0 0 0 0 0 9 h 9", "a range is 'far', not a number"),
        ("ROBOTLASER1 0 -1.5 3.0", "ROBOTLASER1 does not say how many readings follow"),
        ("TRUEPOS 1 2", "TRUEPOS has 3 fields, expected 10"),
    ],
)
def test_a_malformed_line_is_an_error_or_a_counted_skip(tmp_path, play, line, message):
    lines = (odom(1.0, 0.0), line, odom(9.0, 1.0))

    with pytest.raises(SourceError, match=message):
        play(log(tmp_path, *lines, flaser(9.5, (0, 0, 0))))

    source = log(tmp_path, *lines, on_bad_frame="skip")
    assert len(of(play(source), "odometry")) == 2
    assert source.counters()["skipped"] == 1


def test_the_angle_between_beams_can_be_told(tmp_path, play):
    line = f"FLASER 77 {' '.join(['1'] * 77)} 0 0 0 0 0 0 1 h 1"

    (frame,) = play(log(tmp_path, line, angle_step_deg=2))

    assert math.degrees(frame.payload.angle_min_rad) == pytest.approx(-76)


def test_a_file_that_is_no_log_is_refused(tmp_path):
    with pytest.raises(SourceError, match=r"a\.log: no ODOM, FLASER or ROBOTLASER1 line, so no CARMEN log"):
        log(tmp_path, "hello world").start(Session())
