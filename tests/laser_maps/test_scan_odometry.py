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
from trailmark.geometry.scans.lines import scan_normals
from trailmark.geometry.scans.local_map import LocalMap
from trailmark.geometry.scans.things import few_small_things
from trailmark.geometry.scans.uncertainty import errors_in_common, step_information
from trailmark.interfaces import Session
from trailmark_laser_maps.odometry.config import ScanOdometryConfig
from trailmark_laser_maps.odometry.localizer import ScanOdometry

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
    poses: Sequence[Pose2], walls: Floats, look: Look, odometry: Sequence[Pose2] | None = None, noise_m: float = 0.01
) -> list[Estimate]:
    localizer, said = start(), list[Estimate]()
    for index, pose in enumerate(poses):
        scan = scan_of(look(walls, pose @ LASER, 360, noise_m, index))
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
    said = said_over(poses, walls, look, noise_m=ScanOdometryConfig(laser="laser").sigma_m)
    for before, now, one in zip(poses, poses[1:], said, strict=False):
        assert isinstance(one, Motion)
        error = one.pose_since_now.array() - before.between(now).array()
        nees.append(error @ one.information @ error / 3.0)
    assert 0.4 < np.mean(nees) < 2.0  # n = 39 steps of 3 numbers


def test_rays_share_an_error_as_their_residuals_do() -> None:
    rng = np.random.default_rng(7)
    white = rng.standard_normal(2000)
    runs_of_six = np.repeat(rng.standard_normal(400), 6)  # their sum of autocorrelations is 6

    assert errors_in_common(white) == pytest.approx(1.0, abs=0.4)
    assert 4.0 < errors_in_common(runs_of_six) < 6.5
    assert errors_in_common(np.where(rng.random(2400) < 0.2, np.nan, runs_of_six)) > 3.0
    assert errors_in_common(np.tile([1.0, -1.0], 20)) == 1.0
    assert errors_in_common(np.full(5, np.nan)) == 1.0


def test_a_step_is_as_uncertain_as_draws_of_both_its_ends() -> None:
    rng = np.random.default_rng(7)
    before, now = Pose2(1.0, 2.0, 0.7), Pose2(2.0, 1.5, 1.1)
    sigmas = np.diag([0.01, 0.03, 0.02])
    covariances = sigmas @ sigmas, np.diag([4e-4, 1e-4, 1e-4])
    errors = [rng.multivariate_normal(np.zeros(3), covariance, 20_000) for covariance in covariances]
    drawn = [
        Pose2.from_array(before.array() + a).between(Pose2.from_array(now.array() + b)).array() for a, b in zip(*errors)
    ]

    told = step_information(before, np.linalg.inv(covariances[0]), now, np.linalg.inv(covariances[1]))

    np.testing.assert_allclose(np.linalg.inv(told), np.cov(np.transpose(drawn)), rtol=0.05, atol=2e-5)


def test_a_step_tells_little_of_what_one_of_its_ends_does_not() -> None:
    corridor, room = np.diag([0.0, 1e4, 1e5]), np.diag([1e4, 1e4, 1e5])
    turned = Pose2(0.0, 0.0, 0.01)  # the directions of a wall differ by half a degree from scan to scan
    turn = np.array([[math.cos(0.01), -math.sin(0.01), 0.0], [math.sin(0.01), math.cos(0.01), 0.0], [0.0, 0.0, 1.0]])

    into_it = step_information(Pose2(), room, Pose2(), corridor)
    along_it = step_information(Pose2(), turn @ corridor @ turn.T, Pose2(), corridor)
    out_of_it = step_information(turned, corridor, turned @ Pose2(0.2), room)

    np.testing.assert_allclose(np.diag(into_it), [0.0, 5e3, 5e4], rtol=2e-3, atol=1e-6)
    np.testing.assert_allclose(np.diag(along_it), [0.0, 5e3, 5e4], rtol=0.1, atol=1e-6)
    assert out_of_it[0, 0] ** -0.5 == pytest.approx(0.3, rel=0.05)


def test_a_corridor_tells_nothing_along_itself(look: Look) -> None:
    poses = drive(12, Pose2(0.1, 0.0, 0.0), Pose2(0.0, 0.2, 0.25))
    said = said_over(poses, CORRIDOR, look)
    along = np.array([math.cos(0.25), -math.sin(0.25)])  # of the corridor, in axes of base
    across = np.array([math.sin(0.25), math.cos(0.25)])
    for one in said:
        assert isinstance(one, Motion)
        assert across @ one.information[:2, :2] @ across > 0.01**-2
        # nothing, in a direction that is the corridor's to half a degree
        assert along @ one.information[:2, :2] @ along < 1e-4 * (across @ one.information[:2, :2] @ across)


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


def test_somebody_before_the_laser_is_not_the_room(walls: Floats, look: Look) -> None:
    poses = drive(8, Pose2(0.1), Pose2(1.5, 1.0, 0.0))
    localizer, said = start(), list[Estimate]()
    for index, pose in enumerate(poses):
        scan = scan_of(look(walls, pose @ LASER, 360, 0.01, index))
        if index in (3, 4):  # he stands so near that half of the rays end at him
            ranges = np.array(scan.ranges_m)
            ranges[:220] = 0.25
            scan = Scan(ranges, scan.angle_min_rad, scan.angle_step_rad, 0.0, 12.0)
        said += localizer.observe(Frame("laser", 0.2 * index, scan), Belief(0.2 * index))

    assert [type(one) for one in said] == [Motion, Motion, Lost, Lost, Motion, Motion, Motion]
    over = said[4]
    assert isinstance(over, Motion)
    assert over.since_s == pytest.approx(0.4)  # what was seen before is still known
    off = poses[2].between(poses[5]).between(over.pose_since_now)
    assert math.hypot(off.x, off.y) < 0.02


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


def boxes(centres: Sequence[tuple[float, float]]) -> Floats:
    """The sides of people of 0.4 m, as walls."""
    corners = ((-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2))
    pairs = list(zip(corners, corners[1:] + corners[:1]))
    return np.array([(x + a, y + b, x + c, y + d) for x, y in centres for (a, b), (c, d) in pairs])


def errors_in_sigmas(scans: Sequence[Scan], poses: Sequence[Pose2]) -> Floats:
    """How far each step is off, in its own sigmas."""
    localizer, found = start(), []
    for index, (scan, pose) in enumerate(zip(scans, poses)):
        for one in localizer.observe(Frame("laser", 0.1 * index, scan), Belief(0.1 * index)):
            assert isinstance(one, Motion)
            error = one.pose_since_now.array() - poses[index - 1].between(pose).array()
            found.append(math.sqrt(max(error @ one.information @ error, 0.0)))
    return np.array(found)


def test_two_people_who_pass_in_a_corridor_are_not_its_walls(look: Look) -> None:
    poses = [Pose2(0.0, 0.1)] * 25
    scans = []
    for index, pose in enumerate(poses):
        x = -3.0 + 0.08 * index
        walls = np.concatenate([CORRIDOR, boxes([(x, -0.6), (x + 1.2, 0.6)])])
        scans.append(scan_of(look(walls, pose @ LASER, 360, 0.01, index)))
    assert errors_in_sigmas(scans, poses).max() < 4.0


def test_who_walks_ahead_in_a_corridor_does_not_stop_the_robot(look: Look) -> None:
    poses = drive(25, Pose2(0.07), Pose2())
    scans = []
    for index, pose in enumerate(poses):
        walls = np.concatenate([CORRIDOR, boxes([(pose.x + 1.4, 0.1)])])
        scans.append(scan_of(look(walls, pose @ LASER, 360, 0.01, index)))
    assert errors_in_sigmas(scans, poses).max() < 4.0


def test_what_covers_a_part_of_the_laser_does_not_stop_the_robot(look: Look) -> None:
    poses = drive(25, Pose2(0.05), Pose2())
    rng, scans = np.random.default_rng(7), []
    for index, pose in enumerate(poses):
        scan = scan_of(look(CORRIDOR, pose @ LASER, 360, 0.01, index))
        ranges = np.array(scan.ranges_m)
        ranges[160:205] = 0.25 + 0.003 * rng.standard_normal(45)
        scans.append(Scan(ranges, scan.angle_min_rad, scan.angle_step_rad, 0.0, 12.0))
    assert errors_in_sigmas(scans, poses).max() < 4.0


def test_two_people_in_an_endless_hall_of_pillars_make_no_step_surely_wrong(look: Look) -> None:
    rng = np.random.default_rng(5)  # one of six drives in which a step was 5.9 of its sigmas off, 56 mm
    pillars = boxes([(x, y) for x in np.arange(-20, 20) * 2.0 for y in (-2.0, 2.0)])
    walls = np.array([(-60, -3.5, 60, -3.5), (-60, 3.5, 60, 3.5)], np.float64)
    begins, sides = rng.uniform(-3.0, 3.0, 2), rng.uniform(-1.0, 1.0, 2)
    speeds = rng.choice([-1.0, 1.0], 2) * 0.1 * rng.uniform(0.5, 1.2, 2)
    poses = [Pose2(0.3 + 0.07 * k, 0.1, 0.02) for k in range(17)]
    scans = []
    for k, pose in enumerate(poses):
        people = boxes([(x + speed * k, y) for x, speed, y in zip(begins, speeds, sides)])
        around = np.concatenate([pillars, walls, people])
        scans.append(scan_of(look(around, pose @ LASER, 360, 0.01, 5000 + k)))
    assert errors_in_sigmas(scans, poses).max() < 4.0


def test_a_few_small_things_tell_nothing_and_many_do() -> None:
    wall = np.stack([np.linspace(-3.0, 3.0, 121), np.full(121, 2.0)], axis=1)
    normals_of_wall = np.tile([0.0, 1.0], (121, 1))

    def counted(n_things: int) -> list[bool]:
        across = np.linspace(-0.15, 0.15, 7)
        faces = np.concatenate([np.stack([np.full(7, 1.0 + n), n + across], axis=1) for n in range(n_things)])
        points, normals = np.concatenate([wall, faces]), np.tile([1.0, 0.0], (len(faces), 1))
        is_few = few_small_things(points, np.concatenate([normals_of_wall, normals]), np.zeros(2))
        assert not is_few[:121].any()
        return (~is_few[121:].reshape(n_things, 7).any(axis=1)).tolist()

    assert not any(counted(1))
    assert not any(counted(6))
    assert sum(counted(7)) == 3
    assert sum(counted(9)) == 5
