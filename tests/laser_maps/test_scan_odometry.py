"""Motion from scans: exact in a room, wide along a corridor, lost where a scan does not match."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.errors import ShapeError
from trailmark.estimates import Belief, Estimate, Lost, Motion
from trailmark.frames import Frame, Scalar, Scan, SensorInfo
from trailmark.geometry import Pose2, Pose3
from trailmark.interfaces import Session
from trailmark_laser_maps.odometry.config import ScanOdometryConfig
from trailmark_laser_maps.odometry.lines import scan_normals
from trailmark_laser_maps.odometry.localizer import ScanOdometry
from trailmark_laser_maps.odometry.matching import LocalMap

Look = Callable[..., Floats]
LASER = Pose2(0.15, 0.05, 0.3)
CORRIDOR = np.array([(-30, -1, 30, -1), (-30, 1, 30, 1)], np.float64)


def start() -> ScanOdometry:
    localizer = ScanOdometry(ScanOdometryConfig(laser="laser"))
    localizer.start(Session(sensors={"laser": SensorInfo("laser", "scan", pose_base_sensor=Pose3.from_planar(LASER))}))
    return localizer


def scan_of(points: Floats) -> Scan:
    """The scan of points that were looked at all round; returns beyond 12 m are none."""
    n_beams = 360
    ranges = np.full(n_beams, np.nan)
    beams = np.rint((np.arctan2(points[:, 1], points[:, 0]) + math.pi) / (2 * math.pi / n_beams)).astype(int) % n_beams
    ranges[beams] = np.hypot(points[:, 0], points[:, 1])
    ranges[ranges > 12.0] = np.nan
    return Scan(ranges, -math.pi, 2.0 * math.pi / n_beams, 0.0, 12.0)


def said_over(
    poses: Sequence[Pose2], walls: Floats, look: Look, odometry: Sequence[Pose2] | None = None
) -> list[Estimate]:
    localizer, said = start(), list[Estimate]()
    for index, pose in enumerate(poses):
        scan = scan_of(look(walls, pose @ LASER, 360, 0.01, index))
        moved = Pose2() if odometry is None else odometry[index]
        said += localizer.observe(Frame("laser", 0.2 * index, scan), Belief(0.2 * index, pose_odom_base=moved))
    return said


def drive(n_steps: int, step: Pose2, begin: Pose2) -> list[Pose2]:
    poses = [begin]
    for _ in range(n_steps - 1):
        poses.append(poses[-1] @ step)
    return poses


def chain(said: Sequence[Estimate]) -> Pose2:
    pose = Pose2()
    for one in said:
        assert isinstance(one, Motion)
        pose = pose @ one.pose_since_now
    return pose


def test_a_drive_through_a_room_is_followed_without_other_motion(walls: Floats, look: Look) -> None:
    poses = drive(40, Pose2(0.09, 0.0, 0.035), Pose2(1.5, 1.0, 0.0))
    said = said_over(poses, walls, look)
    assert len(said) == 39
    off = poses[0].between(poses[-1]).between(chain(said))
    assert math.hypot(off.x, off.y) < 0.02  # of 3.5 m
    assert abs(off.theta) < math.radians(0.4)


def test_a_laser_that_sits_aside_sees_base_turn_on_the_spot(walls: Floats, look: Look) -> None:
    poses = drive(25, Pose2(0.0, 0.0, math.radians(8.0)), Pose2(2.5, 2.0, 0.5))
    off = poses[0].between(poses[-1]).between(chain(said_over(poses, walls, look)))
    assert math.hypot(off.x, off.y) < 0.02
    assert abs(off.theta) < math.radians(0.4)


def test_errors_of_steps_are_such_as_their_information_says(walls: Floats, look: Look) -> None:
    poses = drive(40, Pose2(0.09, 0.0, 0.035), Pose2(1.5, 1.0, 0.0))
    nees = []
    for before, now, one in zip(poses, poses[1:], said_over(poses, walls, look), strict=False):
        assert isinstance(one, Motion)
        error = before.between(now).between(one.pose_since_now).array()
        nees.append(error @ one.information @ error / 3.0)
    assert 0.05 < np.mean(nees) < 2.0


def test_a_corridor_tells_nothing_along_itself(look: Look) -> None:
    poses = drive(12, Pose2(0.1, 0.0, 0.0), Pose2(0.0, 0.2, 0.25))
    said = said_over(poses, CORRIDOR, look)
    along = np.array([math.cos(0.25), -math.sin(0.25)])  # of the corridor, in axes of base
    across = np.array([math.sin(0.25), math.cos(0.25)])
    for one in said:
        assert isinstance(one, Motion)
        assert across @ one.information[:2, :2] @ across > 0.01**-2
        assert along @ one.information[:2, :2] @ along < 1.0  # not to a metre: nothing


def test_along_a_corridor_it_goes_as_far_as_the_wheels_say(look: Look) -> None:
    poses = drive(12, Pose2(0.1, 0.0, 0.0), Pose2(0.0, 0.2, 0.0))
    said = said_over(poses, CORRIDOR, look, odometry=[poses[0].between(pose) for pose in poses])
    assert chain(said).x == pytest.approx(1.1, abs=0.03)
    assert chain(said).y == pytest.approx(0.0, abs=0.01)


def test_large_turns_between_scans_are_found(walls: Floats, look: Look) -> None:
    poses = [Pose2(2.5, 2.0, 0.3), Pose2(2.6, 2.0, 0.3 + math.radians(22.0)), Pose2(2.7, 2.0, 0.3)]
    off = poses[0].between(poses[-1]).between(chain(said_over(poses, walls, look)))
    assert math.hypot(off.x, off.y) < 0.02
    assert abs(off.theta) < math.radians(0.5)


def test_carried_away_it_is_lost_and_goes_on(walls: Floats, look: Look) -> None:
    poses = [*drive(4, Pose2(0.1), Pose2(1.5, 1.0, 0.0)), *drive(4, Pose2(0.1), Pose2(5.7, 3.0, 1.0))]
    said = said_over(poses, walls, look)
    assert [type(one) for one in said] == [Motion, Motion, Motion, Lost, Motion, Motion, Motion]
    lost, after = said[3], said[4]
    assert isinstance(lost, Lost)
    assert "of the scan lies on those before it" in lost.reason
    assert isinstance(after, Motion)
    assert after.since_s == lost.stamp_s  # the gap is left to others


def test_what_says_nothing_is_lost() -> None:
    localizer = start()
    blind = Scan(np.full(90, np.nan), -math.pi, 0.03)
    assert localizer.observe(Frame("laser", 0.0, blind), Belief(0.0)) == [Lost(0.0, "only 0 returns")]
    with pytest.raises(ShapeError, match="takes scans"):
        localizer.observe(Frame("laser", 0.0, Scalar(1.0)), Belief(0.0))


def test_normals_are_those_of_the_wall_and_none_at_corners() -> None:
    y = np.linspace(-1.0, 1.0, 41)
    wall = np.stack([np.full(41, 2.0), y], axis=1)
    np.testing.assert_allclose(np.abs(scan_normals(wall)), np.tile([1.0, 0.0], (41, 1)), atol=1e-9)
    corner = np.concatenate([wall, np.stack([np.linspace(1.95, 0.5, 30), np.full(30, 1.0)], axis=1)])
    normals = scan_normals(corner)
    assert np.abs(normals[40]).sum() == 0.0
    np.testing.assert_allclose(np.abs(normals[60]), [0.0, 1.0], atol=1e-9)
    assert scan_normals(np.zeros((2, 2))).tolist() == [[0.0, 0.0], [0.0, 0.0]]


def test_a_match_with_nothing_near_says_so() -> None:
    local = LocalMap(3)
    local.add(Pose2(), np.stack([np.full(30, 2.0), np.linspace(-1, 1, 30)], axis=1))
    match = local.match(np.full((30, 2), 50.0), [Pose2()], 0.02)
    assert match.share == 0.0
    assert not match.information.any()
