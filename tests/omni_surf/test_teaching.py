"""Teaching with a laser beside odometry: never worse than the odometry alone, better where it is poor."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.estimates import Fix, Lost, Motion
from trailmark.estimation.scan_following import FollowingRules, ScanFollower
from trailmark.frames import Frame, Odometry, Scan, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.paths import Path as TaughtPath
from trailmark.pipeline import Pipeline
from trailmark.stores import SqlitePathStore, SqliteStoreConfig
from trailmark_omni_surf.laser.joining import ScanJoiner

Walls = tuple[tuple[float, float, float, float], ...]
CORRIDOR: Walls = ((-3.0, -1.0, 40.0, -1.0), (-3.0, 1.0, 40.0, 1.0))
ROOM: Walls = (
    (0.0, 0.0, 8.0, 0.0), (8.0, 0.0, 8.0, 5.0), (8.0, 5.0, 4.5, 5.0), (4.5, 5.0, 4.5, 6.0), (4.5, 6.0, 0.0, 6.0),
    (0.0, 6.0, 0.0, 0.0), (3.5, 2.6, 4.1, 2.6), (4.1, 2.6, 4.1, 3.4), (4.1, 3.4, 3.5, 3.4), (3.5, 3.4, 3.5, 2.6),
)  # fmt: skip
RANGE_M, N_BEAMS = 10.0, 180


def scan_at(walls: Walls, pose: Pose2, rng: np.random.Generator) -> Scan:
    """Return what a laser sees that looks all round."""
    angles = pose.theta + 2.0 * math.pi * np.arange(N_BEAMS) / N_BEAMS
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    best = np.full(N_BEAMS, np.inf)
    for x1, y1, x2, y2 in walls:
        edge, to_wall = np.array([x2 - x1, y2 - y1]), np.array([x1 - pose.x, y1 - pose.y])
        cross = rays[:, 0] * edge[1] - rays[:, 1] * edge[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            along_ray = (to_wall[0] * edge[1] - to_wall[1] * edge[0]) / cross
            along_wall = (to_wall[0] * rays[:, 1] - to_wall[1] * rays[:, 0]) / cross
        hit = (along_ray > 0) & (along_wall >= 0) & (along_wall <= 1)
        best = np.where(hit & (along_ray < best), along_ray, best)
    ranges = best + rng.normal(0.0, 0.01, N_BEAMS)
    return Scan(np.where(ranges < RANGE_M, ranges, np.nan), 0.0, 2.0 * math.pi / N_BEAMS, 0.05, RANGE_M)


def down_the_corridor() -> list[Pose2]:
    return [Pose2(0.1 * k, 0.0, 0.0) for k in range(70)]


def round_the_pillar() -> list[Pose2]:
    turns = np.linspace(0.0, 2.0 * math.pi, 80)
    return [Pose2(3.8 + 1.6 * math.sin(turn), 3.0 - 1.6 * math.cos(turn), float(turn)) for turn in turns]


def poor(truth: Sequence[Pose2]) -> list[Pose2]:
    """Return an odometry that is 2 % too long and drifts by a degree a metre."""
    rng, pose, found = np.random.default_rng(1), truth[0], [truth[0]]
    for before, now in itertools.pairwise(truth):
        step = before.between(now)
        way_m = math.hypot(step.x, step.y)
        turn = step.theta + math.radians(1.0) * way_m + math.radians(0.5) * math.sqrt(way_m) * rng.standard_normal()
        pose = pose @ Pose2(1.02 * step.x, step.y, turn)
        found.append(pose)
    return found


def taught(
    walls: Walls, truth: Sequence[Pose2], odometry: Sequence[Pose2], store: Path, *, corrects: bool = True
) -> Floats:
    """Return the errors of the belief in position while teaching, laid on the truth at the start, (N,) [m]."""
    start, rng = truth[0], np.random.default_rng(7)
    config = {
        "mode": "teach",
        "start": [start.x, start.y, math.degrees(start.theta)],
        "localizers": {
            "odometry": {"plugin": "odometry", "wheels": "wheels"},
            "laser": {"plugin": "laser_icp", "laser": "scan", "correct_while_teaching": corrects},
        },
        "estimator": {"plugin": "kalman"},
        "path_store": {"plugin": "sqlite", "path": str(store)},
    }
    errors = []
    with Pipeline(config, sensors=[SensorInfo("wheels", "odometry"), SensorInfo("scan", "scan")]) as pipeline:
        for k, (true, said) in enumerate(zip(truth, odometry, strict=True)):
            pipeline.feed(Frame("wheels", 0.2 * k, Odometry(odometry[0].between(said))))
            step = pipeline.feed(Frame("scan", 0.2 * k, scan_at(walls, true, rng)))
            assert step is not None
            pose = step.belief.pose_map_base
            errors.append(0.0 if pose is None else pose.distance_to(true))
    return np.array(errors)


@pytest.mark.parametrize(("walls", "drive"), [(CORRIDOR, down_the_corridor), (ROOM, round_the_pillar)])
def test_an_exact_odometry_is_not_bent(walls: Walls, drive: object, tmp_path: Path) -> None:
    truth = drive()  # type: ignore[operator]
    assert taught(walls, truth, truth, tmp_path / "a.trail").max() < 0.04


def test_a_poor_odometry_gets_straight_in_a_corridor(tmp_path: Path) -> None:
    truth = down_the_corridor()
    odometry = poor(truth)
    wheels = np.array([a.distance_to(b) for a, b in zip(odometry, truth, strict=True)])
    assert wheels.max() > 0.4
    errors = taught(CORRIDOR, truth, odometry, tmp_path / "a.trail")
    assert errors.max() < 0.25  # 2 % of the way, which nothing but the wheels tells


def test_a_poor_odometry_gets_better_in_a_room(tmp_path: Path) -> None:
    truth = round_the_pillar()
    odometry = poor(truth)
    wheels = np.array([a.distance_to(b) for a, b in zip(odometry, truth, strict=True)])
    errors = taught(ROOM, truth, odometry, tmp_path / "a.trail")
    assert errors.mean() < 0.3 * wheels.mean()


@pytest.fixture(scope="module")
def twice_round() -> list[Pose2]:
    """Return a way that goes twice round the pillar."""
    turns = np.linspace(0.0, 4.0 * math.pi, 90)
    return [Pose2(3.8 + 1.6 * math.sin(turn), 3.0 - 1.6 * math.cos(turn), float(turn)) for turn in turns]


def test_a_way_that_closes_is_straightened_when_teaching_ends(twice_round: list[Pose2], tmp_path: Path) -> None:
    during = taught(ROOM, twice_round, poor(twice_round), tmp_path / "a.trail", corrects=False)

    after, path = errors_of_keyframes(twice_round, tmp_path / "a.trail")

    assert after.mean() < 0.3 * during.mean()
    assert path[-1].pose_map_base.distance_to(twice_round[-1]) < 0.15  # the last waypoint lies before the end


def test_closing_leaves_a_way_straight_that_scans_have_kept_straight(twice_round: list[Pose2], tmp_path: Path) -> None:
    during = taught(ROOM, twice_round, poor(twice_round), tmp_path / "a.trail")

    after, path = errors_of_keyframes(twice_round, tmp_path / "a.trail")

    assert max(during.max(), after.max()) < 0.03
    assert path[-1].pose_map_base.distance_to(twice_round[-1]) < 0.15


def errors_of_keyframes(truth: Sequence[Pose2], file: Path) -> tuple[Floats, TaughtPath]:
    """Return how far remembered scans are off in position [m], and the path."""
    store = SqlitePathStore(SqliteStoreConfig(path=str(file), access="read"))
    store.start(Session())
    keyframes = store.localizer_map("laser").keyframes()
    path = store.path()
    assert path is not None
    store.close()
    return np.array([one.pose_map_base.distance_to(truth[round(one.stamp_s / 0.2)]) for one in keyframes]), path


def test_a_scan_is_joined_where_it_was_taken_and_nowhere_else() -> None:
    rng = np.random.default_rng(5)
    poses = [Pose2(2.0 + 0.5 * k, 1.2, 0.1) for k in range(6)]
    scans = [scan_at(ROOM, pose, rng).points() for pose in poses]
    known, spread = {k: poses[k] for k in range(5)}, np.diag([0.1, 0.1, 0.02])
    joiner = ScanJoiner(0.6, 0.01)
    told = joiner.place(scans, known, 5, poses[5] @ Pose2(0.4, -0.3, 0.1), spread)
    assert isinstance(told, Fix)
    assert told.pose_map_base.distance_to(poses[5]) < 0.03
    scans[5] = rng.uniform(-5.0, 5.0, (180, 2))
    assert isinstance(joiner.place(scans, known, 5, poses[5], spread), Lost)


def test_a_corridor_joins_across_itself_and_leaves_the_way_along_to_the_guess() -> None:
    rng = np.random.default_rng(5)
    poses = [Pose2(10.0 + 0.5 * k, 0.1, 0.0) for k in range(6)]
    scans = [scan_at(CORRIDOR, pose, rng).points() for pose in poses]
    known = {k: poses[k] for k in range(5)}
    guess = poses[5] @ Pose2(0.5, 0.2, 0.05)
    told = ScanJoiner(0.6, 0.01).place(scans, known, 5, guess, np.diag([0.1, 0.1, 0.01]))
    assert isinstance(told, Fix)
    assert told.pose_map_base.x == pytest.approx(guess.x, abs=0.06)
    assert told.pose_map_base.y == pytest.approx(0.1, abs=0.02)
    assert told.information[0, 0] < 1e-3 * told.information[1, 1]


def followed(walls: Walls, poses: Sequence[Pose2], follower: ScanFollower) -> list[Motion | Lost | None]:
    rng, said = np.random.default_rng(3), []
    for k, pose in enumerate(poses):
        points = scan_at(walls, pose, rng).points()
        said.append(follower.follow(0.2 * k, points, poses[0].between(pose)).answer)
    return said


def test_a_motion_is_as_sure_as_the_walls_let_it_be() -> None:
    slanting = [Pose2(0.1 * k, 0.02 * k - 0.2, 0.2) for k in range(12)]
    said = followed(CORRIDOR, slanting, ScanFollower(Pose2(), FollowingRules()))
    assert said[0] is None
    along, across = (np.array([math.cos(turn), -math.sin(turn)]) for turn in (0.2, 0.2 - math.pi / 2.0))
    for one, before, now in zip(said[1:], slanting, slanting[1:], strict=False):
        assert isinstance(one, Motion)
        assert along @ one.information[:2, :2] @ along < 1e-3 * (across @ one.information[:2, :2] @ across)
        assert one.pose_since_now.distance_to(before.between(now)) < 0.02


def test_after_a_scan_of_elsewhere_the_motion_begins_anew() -> None:
    follower, rng = ScanFollower(Pose2(), FollowingRules()), np.random.default_rng(3)
    poses = [Pose2(2.0 + 0.1 * k, 1.2, 0.1) for k in range(6)]
    scans = [scan_at(ROOM, pose, rng).points() for pose in poses]
    scans[3] = rng.uniform(-9.0, 9.0, (180, 2))
    said = []
    for k, points in enumerate(scans):
        said.append(follower.follow(float(k), points, poses[0].between(poses[k])).answer)
    assert [type(one) for one in said] == [type(None), Motion, Motion, Lost, Lost, Motion]
    assert isinstance(said[5], Motion)
    assert said[5].since_s == 4.0


def test_wheels_that_slip_bend_nothing_that_comes_after() -> None:
    follower, rng = ScanFollower(Pose2(), FollowingRules()), np.random.default_rng(3)
    poses = [Pose2(2.0 + 0.1 * k, 1.2, 0.1) for k in range(9)]
    slip = Pose2(0.0, 0.0, 2.0)  # farther than a scan is looked for: where the last step leads again, it lies well
    said = []
    for k, pose in enumerate(poses):
        odometry = poses[0].between(pose) if k < 4 else poses[0].between(poses[3]) @ slip @ poses[3].between(pose)
        said.append(follower.follow(float(k), scan_at(ROOM, pose, rng).points(), odometry).answer)
    for one, before, now in zip(said[1:], poses, poses[1:], strict=False):
        assert isinstance(one, Motion)
        assert one.pose_since_now.distance_to(before.between(now)) < 0.02
        assert abs(one.pose_since_now.theta) < math.radians(0.5)
