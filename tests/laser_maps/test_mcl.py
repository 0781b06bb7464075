"""Monte Carlo localization on a grid: found from nothing, lost where it must be, and exact on the way."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.errors import ConfigError, ShapeError
from trailmark.estimates import Belief, Estimate, Fix, Lost
from trailmark.frames import Frame, Scalar, Scan, SensorInfo
from trailmark.geometry import Pose2, Pose3, wrap_angle
from trailmark.interfaces import Session
from trailmark_laser_maps.carving import PlacedScan, carve_grid
from trailmark_laser_maps.grid import OccupancyGrid
from trailmark_laser_maps.map_yaml import write_map
from trailmark_laser_maps.mcl.config import GridMclConfig
from trailmark_laser_maps.mcl.localizer import GridMcl

Look = Callable[..., Floats]
N_BEAMS = 180
LASER = Pose3(x=0.1, yaw=0.0)
QUICK = {"n_start": 20_000, "n_search": 3000, "n_most": 3000}


@pytest.fixture(scope="module")
def map_file(tmp_path_factory: pytest.TempPathFactory, room_scans: list[PlacedScan]) -> Path:
    path = tmp_path_factory.mktemp("maps") / "room.yaml"
    write_map(path, carve_grid(room_scans))
    return path


BEGIN = Pose2(1.2, 1.0, 0.2)


def drive(n_steps: int = 30, begin: Pose2 = BEGIN) -> list[Pose2]:
    poses = [begin]
    for _ in range(n_steps - 1):
        poses.append(poses[-1] @ Pose2(0.08, 0.0, 0.03))
    return poses


def scan_of(points: Floats) -> Scan:
    """The scan whose points these are: all round, one a beam."""
    ranges = np.hypot(points[:, 0], points[:, 1])
    return Scan(ranges, -math.pi, 2.0 * math.pi / len(points), 0.0, 30.0)


def start(map_file: Path | None, *, seed: int = 0, start_pose: Pose2 | None = None, **keys: object) -> GridMcl:
    localizer = GridMcl(GridMclConfig(laser="laser", map=map_file, **{**QUICK, **keys}))  # type: ignore[arg-type]
    sensors = {"laser": SensorInfo("laser", "scan", pose_base_sensor=LASER)}
    localizer.start(Session("mcl", "track", sensors, start_pose=start_pose, rng=np.random.default_rng(seed)))
    return localizer


def said_over(
    localizer: GridMcl, poses: Sequence[Pose2], walls: Floats, look: Look, *, carried_at: int | None = None
) -> list[tuple[Pose2, Estimate]]:
    """Return what is said on the way; the odometry knows nothing of being carried from one pose to the next."""
    said: list[tuple[Pose2, Estimate]] = []
    odometry, before = Pose2(), poses[0]
    rng = np.random.default_rng(3)
    for index, pose in enumerate(poses):
        if index != carried_at:
            step = before.between(pose)
            odometry = odometry @ Pose2(step.x * 1.03, step.y, step.theta * (1.0 + 0.02 * rng.standard_normal()))
        before = pose
        points = look(walls, pose @ LASER.planar(), N_BEAMS, 0.01, index)
        belief = Belief(0.2 * index, pose_odom_base=odometry)
        said += [(pose, one) for one in localizer.observe(Frame("laser", 0.2 * index, scan_of(points)), belief)]
    return said


def errors_of(said: list[tuple[Pose2, Estimate]]) -> Floats:
    """Distance and turn of every fix from the truth, (N, 2)."""
    off = [truth.between(one.pose_map_base) for truth, one in said if isinstance(one, Fix)]
    return np.array([(math.hypot(error.x, error.y), abs(error.theta)) for error in off]).reshape(-1, 2)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_it_is_found_from_nothing_and_followed_to_a_centimetre(
    map_file: Path, walls: Floats, look: Look, seed: int
) -> None:
    said = said_over(start(map_file, seed=seed), drive(32), walls, look)
    errors = errors_of(said)
    assert len(errors) >= 25  # it drives 0.3 m, and one look more
    assert np.sqrt(np.square(errors[:, 0]).mean()) < 0.02
    assert np.sqrt(np.square(errors[:, 1]).mean()) < math.radians(0.3)
    assert errors[:, 0].max() < 0.06  # never anywhere else
    qualities = [one.details["quality"] for _, one in said]
    assert min(qualities[5:]) > 0.9


def test_errors_are_such_as_the_covariance_says(map_file: Path, walls: Floats, look: Look) -> None:
    nees = []
    for truth, one in said_over(start(map_file), drive(40), walls, look):
        if isinstance(one, Fix):
            error = one.pose_map_base.array() - truth.array()
            error[2] = wrap_angle(float(error[2]))
            nees.append(error @ one.information @ error / 3.0)
    assert 0.2 < np.mean(nees) < 2.0
    assert np.max(nees) < 6.0


def test_on_a_crooked_map_fixes_are_told_as_uncertain_as_it_is(
    tmp_path: Path, walls: Floats, look: Look, room_scans: list[PlacedScan]
) -> None:
    rng = np.random.default_rng(2)
    shakes = [Pose2(*rng.normal(0.0, (0.05, 0.05, math.radians(1.0)))) for _ in room_scans]
    shaken = [PlacedScan(shake @ one.laser, shake @ one.ends) for shake, one in zip(shakes, room_scans)]
    write_map(tmp_path / "crooked.yaml", carve_grid(shaken))
    way = drive(40)
    said = said_over(start(tmp_path / "crooked.yaml", start_pose=way[0]), way, walls, look)
    nees = []
    for truth, one in said:
        if isinstance(one, Fix):
            error = one.pose_map_base.array() - truth.array()
            error[2] = wrap_angle(float(error[2]))
            nees.append(error @ one.information @ error / 3.0)
    assert len(nees) >= 20
    assert np.mean(nees) < 3.0


def test_the_same_seed_gives_the_same_answers(map_file: Path, walls: Floats, look: Look) -> None:
    runs = [said_over(start(map_file, seed=4), drive(8), walls, look) for _ in range(2)]
    first, second = ([one.pose_map_base if isinstance(one, Fix) else one for _, one in run] for run in runs)
    assert first == second


def test_a_room_that_is_alike_from_both_ends_tells_no_place(tmp_path: Path, look: Look) -> None:
    alike = np.array([(0, 0, 6, 0), (6, 0, 6, 3), (6, 3, 0, 3), (0, 3, 0, 0)], np.float64)
    places = [Pose2(x, y) for x in (1.0, 3.0, 5.0) for y in (1.0, 2.0)]
    scans = [PlacedScan.at(pose, look(alike, pose, 720), (0.0, 0.0)) for pose in places]
    write_map(tmp_path / "alike.yaml", carve_grid(scans))
    way = drive(20, Pose2(1.0, 1.0, 0.1))
    said = said_over(start(tmp_path / "alike.yaml"), way, alike, look)
    assert len(said) >= 18
    assert all(isinstance(one, Lost) for _, one in said)
    assert said[-1][1].reason == "2 places fit"  # type: ignore[union-attr]

    told = said_over(
        start(tmp_path / "alike.yaml", start_pose=Pose2(1.0, 1.0, 0.0)), drive(20, Pose2(1.0, 1.0, 0.1)), alike, look
    )
    assert errors_of(told)[:, 0].max() < 0.1  # from a start that is known it keeps to its own end
    assert len(errors_of(told)) >= 18


def test_carried_away_it_is_lost_and_then_found(map_file: Path, walls: Floats, look: Look) -> None:
    before, after = drive(12), drive(25, Pose2(5.6, 3.2, 2.5))
    said = said_over(start(map_file, start_pose=before[0]), [*before, *after], walls, look, carried_at=12)
    kinds = ["fix" if isinstance(one, Fix) else "lost" for _, one in said]
    assert kinds[:12] == ["fix"] * 12
    assert kinds[12] == "lost"
    assert kinds[-5:] == ["fix"] * 5
    assert errors_of(said)[:, 0].max() < 0.1


def test_carried_to_where_it_looks_alike_it_is_not_followed_on(tmp_path: Path, look: Look) -> None:
    niches = [[(x, 0, x, -0.4), (x, -0.4, x + 1, -0.4), (x + 1, -0.4, x + 1, 0)] for x in (2.5, 6.5, 10.5)]
    fronts = [(0, 0, 2.5, 0), (3.5, 0, 6.5, 0), (7.5, 0, 10.5, 0), (11.5, 0, 16, 0)]
    others = [
        (16, 0, 16, 2),
        (16, 2, 12, 2),
        (12, 2, 12, 3),
        (12, 3, 11, 3),
        (11, 3, 11, 2),
        (11, 2, 0, 2),
        (0, 2, 0, 0),
    ]
    corridor = np.array([*fronts, *others, *(side for niche in niches for side in niche)], np.float64)
    scans = [
        PlacedScan.at(Pose2(x, 1.0), look(corridor, Pose2(x, 1.0), 720), (0.0, 0.0)) for x in np.arange(0.5, 16, 1)
    ]
    write_map(tmp_path / "niches.yaml", carve_grid(scans))
    before = [Pose2(2.0 + 0.08 * k, 1.0) for k in range(10)]
    after = [Pose2(6.8 + 0.08 * k, 1.0) for k in range(12)]  # one niche on: most of what it sees is the same

    said = said_over(
        start(tmp_path / "niches.yaml", start_pose=before[0]), [*before, *after], corridor, look, carried_at=10
    )

    assert len(errors_of(said[:9])) >= 8
    assert (errors_of(said)[:, 0] < 0.3).all()


def test_a_map_of_another_place_is_never_believed(map_file: Path, look: Look) -> None:
    elsewhere = np.array([(-9, -2, 3, -7), (3, -7, 5, 9), (5, 9, -3, 4), (-3, 4, -9, -2)], np.float64)
    said = said_over(start(map_file), drive(15, Pose2(-1.0, 0.0, 0.5)), elsewhere, look)
    assert said
    assert all(isinstance(one, Lost) for _, one in said)


@pytest.mark.parametrize("begin", [Pose2(5.6, 3.2, 2.5), Pose2(6.0, 1.0, 1.8)])
def test_a_mirrored_map_is_never_believed(
    tmp_path: Path, room_scans: list[PlacedScan], walls: Floats, look: Look, begin: Pose2
) -> None:
    grid = carve_grid(room_scans)
    mirrored = np.ascontiguousarray(grid.cells[::-1])
    write_map(tmp_path / "mirrored.yaml", OccupancyGrid(mirrored, grid.resolution_m, grid.pose_map_grid))
    said = said_over(start(tmp_path / "mirrored.yaml"), drive(20, begin), walls, look)
    assert len(said) >= 18
    assert all(isinstance(one, Lost) for _, one in said)


def test_a_turned_origin_turns_the_answer(
    tmp_path: Path, room_scans: list[PlacedScan], walls: Floats, look: Look
) -> None:
    grid = carve_grid(room_scans)
    turned = Pose2(10.0, -4.0, 2.0)
    write_map(tmp_path / "turned.yaml", OccupancyGrid(grid.cells, grid.resolution_m, turned @ grid.pose_map_grid))
    said = said_over(start(tmp_path / "turned.yaml", start_pose=turned @ drive()[0]), drive(10), walls, look)
    off = [(turned @ truth).between(one.pose_map_base) for truth, one in said if isinstance(one, Fix)]
    assert len(off) == 10
    assert max(math.hypot(error.x, error.y) for error in off) < 0.05


def test_at_rest_it_says_nothing_new(map_file: Path, walls: Floats, look: Look) -> None:
    localizer = start(map_file, start_pose=drive()[0])
    said = said_over(localizer, [drive()[0]] * 5, walls, look)
    assert len(said) == 1
    assert localizer.counters() == {"looks": 1, "found": 1}


def test_what_says_nothing_is_lost(map_file: Path) -> None:
    localizer = start(map_file)
    blind = Scan(np.full(N_BEAMS, np.nan), -math.pi, 0.03)
    assert localizer.observe(Frame("laser", 0.0, blind), Belief(0.0)) == [Lost(0.0, "only 0 returns")]
    with pytest.raises(ShapeError, match="takes scans"):
        localizer.observe(Frame("laser", 0.0, Scalar(1.0)), Belief(0.0))
    assert "no map" in start(None).observe(Frame("laser", 0.0, blind), Belief(0.0))[0].reason  # type: ignore[union-attr]


def test_a_map_without_walls_is_refused(tmp_path: Path) -> None:
    write_map(tmp_path / "empty.yaml", OccupancyGrid(np.zeros((5, 5), np.int8), 0.05))
    with pytest.raises(ShapeError, match="no occupied"):
        start(tmp_path / "empty.yaml")
    (tmp_path / "bare.yaml").write_text("image: empty.pgm\n")
    with pytest.raises(ConfigError, match="resolution is missing"):
        start(tmp_path / "bare.yaml")
