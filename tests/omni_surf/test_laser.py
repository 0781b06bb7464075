"""Scan matching against a taught map."""

from __future__ import annotations

import gzip
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trailmark.errors import ShapeError
from trailmark.estimates import Belief, Fix, Lost, Motion
from trailmark.frames import Frame, Image, Scan, SensorInfo
from trailmark.geometry import Pose2, wrap_angle
from trailmark.interfaces import Session
from trailmark.paths import Keyframe
from trailmark_omni_surf import ScanMap, SearchWindow, match_scan
from trailmark_omni_surf.laser.anywhere import AnywhereSearch, least_share
from trailmark_omni_surf.laser.config import LaserIcpConfig
from trailmark_omni_surf.laser.kernels import truncated_cost
from trailmark_omni_surf.laser.localizer import LaserIcp
from trailmark_omni_surf.laser.matching import ScanMatch
from trailmark_omni_surf.laser.told_fit import told_fit

Points = npt.NDArray[np.float64]
WALLS = (  # an L-shaped room with a pillar: x1 y1 x2 y2
    (0.0, 0.0, 6.0, 0.0), (6.0, 0.0, 6.0, 3.0), (6.0, 3.0, 3.5, 3.0), (3.5, 3.0, 3.5, 5.0), (3.5, 5.0, 0.0, 5.0),
    (0.0, 5.0, 0.0, 0.0), (1.5, 2.0, 1.9, 2.0), (1.9, 2.0, 1.9, 2.4), (1.9, 2.4, 1.5, 2.4), (1.5, 2.4, 1.5, 2.0),
)  # fmt: skip


def ranges_at(pose: Pose2, n_beams: int = 360, noise_m: float = 0.0, seed: int = 0, walls: tuple = WALLS) -> Points:
    """Exact ranges of a full-circle laser in a room of line segments."""
    angles = pose.theta + 2 * math.pi * np.arange(n_beams) / n_beams
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    best = np.full(n_beams, np.inf)
    for x1, y1, x2, y2 in walls:
        edge = np.array([x2 - x1, y2 - y1])
        to_wall = np.array([x1 - pose.x, y1 - pose.y])
        cross = rays[:, 0] * edge[1] - rays[:, 1] * edge[0]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            along_ray = (to_wall[0] * edge[1] - to_wall[1] * edge[0]) / cross
            along_wall = (to_wall[0] * rays[:, 1] - to_wall[1] * rays[:, 0]) / cross
        hit = (along_ray > 0) & (along_wall >= 0) & (along_wall <= 1)
        best = np.where(hit & (along_ray < best), along_ray, best)
    return best + np.random.default_rng(seed).normal(0.0, noise_m, n_beams)


def scan_at(pose: Pose2, **options: float) -> Scan:
    ranges = ranges_at(pose, **options)  # type: ignore[arg-type]
    return Scan(ranges, 0.0, 2 * math.pi / len(ranges), 0.05, 20.0)


@pytest.fixture(scope="module")
def room() -> ScanMap:
    poses = [Pose2(1.0 + 0.2 * i, 1.2, 0.1 * i) for i in range(20)]
    return ScanMap.from_scans([scan_at(pose, noise_m=0.01, seed=i).points() for i, pose in enumerate(poses)], poses)


def error_of(found: Pose2, true: Pose2) -> tuple[float, float]:
    return found.distance_to(true), abs(wrap_angle(found.theta - true.theta))


@settings(max_examples=25, deadline=None)
@given(
    x=st.floats(0.5, 3.0), y=st.floats(0.4, 1.6), theta=st.floats(-3.1, 3.1),
    direction=st.floats(-3.1, 3.1), turn=st.floats(-0.17, 0.17),
)  # fmt: skip
def test_a_scan_is_found_from_sixty_centimetres_and_ten_degrees(
    room: ScanMap, x: float, y: float, theta: float, direction: float, turn: float
) -> None:
    true = Pose2(x, y, theta)
    guess = Pose2(x + 0.6 * math.cos(direction), y + 0.6 * math.sin(direction), theta + turn)

    match = match_scan(room, scan_at(true, noise_m=0.01).points(), guess)

    distance_m, heading_rad = error_of(match.pose_map_base, true)
    assert distance_m < 0.03
    assert heading_rad < math.radians(0.7)
    assert match.inlier_share > 0.9


def test_point_to_point_finds_the_pose_as_well(room: ScanMap) -> None:
    true = Pose2(2.0, 1.0, 0.4)

    match = match_scan(room, scan_at(true).points(), Pose2(2.2, 0.9, 0.45), to_line=False)

    assert error_of(match.pose_map_base, true)[0] < 0.05


def test_the_raster_names_the_nearest_point_by_brute_force(room: ScanMap) -> None:
    rng = np.random.default_rng(3)
    rows, columns = np.nonzero(room.nearest_idx >= 0)
    chosen = rng.choice(len(rows), 300, replace=False)
    centres = room.origin + (np.stack([columns[chosen], rows[chosen]], axis=1) + 0.5) * room.cell_m

    distances = np.linalg.norm(centres[:, None, :] - room.points[None, :, :], axis=2)

    np.testing.assert_allclose(room.distance_m[rows[chosen], columns[chosen]], distances.min(axis=1), atol=1e-6)


def test_the_cost_kernel_equals_its_plain_twin(room: ScanMap) -> None:
    points, pose = scan_at(Pose2(2.0, 1.0, 0.0)).points(), Pose2(2.1, 1.1, 0.05)
    uv = np.floor((pose @ points - room.origin) / room.cell_m).astype(int)
    inside = ((uv >= 0) & (uv < room.distance_m.shape[::-1])).all(axis=1)
    plain = np.where(inside, room.distance_m[uv[:, 1] * inside, uv[:, 0] * inside], room.reach_m).mean()

    cost = truncated_cost(points, pose.x, pose.y, pose.theta, room.origin, room.cell_m, room.distance_m, room.reach_m)

    assert cost == pytest.approx(plain, rel=1e-6)


def test_a_corridor_leaves_no_information_along_itself() -> None:
    corridor = ((-50.0, 0.0, 50.0, 0.0), (-50.0, 2.0, 50.0, 2.0))
    scan = Scan(ranges_at(Pose2(0.0, 1.0, 0.0), walls=corridor), 0.0, 2 * math.pi / 360, 0.05, 10.0)
    points = scan.points()[np.hypot(*scan.points().T) < 10.0]
    scan_map = ScanMap.from_scans([points], [Pose2(0.0, 1.0, 0.0)])

    match = match_scan(scan_map, points, Pose2(0.02, 1.0, 0.0), SearchWindow(span_m=0.2))

    assert match.information[0, 0] < 1e-2 * match.information[1, 1]
    np.testing.assert_allclose(match.information, match.information.T)


def test_walls_smeared_by_wrong_poses_become_lines_again() -> None:
    rng = np.random.default_rng(5)
    poses = [Pose2(1.0 + 0.1 * i, 1.2, 0.0) for i in range(30)]
    said = [Pose2(p.x + rng.normal(0, 0.03), p.y + rng.normal(0, 0.03), p.theta) for p in poses]

    scan_map = ScanMap.from_scans([scan_at(pose).points() for pose in poses], said)

    bottom = scan_map.points[(abs(scan_map.points[:, 1]) < 0.15) & (abs(scan_map.points[:, 0] - 3.0) < 1.5)]
    assert np.sqrt((bottom[:, 1] ** 2).mean()) < 0.015  # the poses are 3 cm wrong


@pytest.mark.parametrize(
    ("points", "match"),
    [(np.zeros((4, 2)), "at least 10 points"), (np.zeros((20, 3)), "at least 10 points")],
)
def test_a_scan_of_too_few_points_is_refused(room: ScanMap, points: Points, match: str) -> None:
    with pytest.raises(ShapeError, match=match):
        match_scan(room, points, Pose2())


def test_maps_of_nothing_and_of_everything_are_refused() -> None:
    with pytest.raises(ShapeError, match="no points"):
        ScanMap.from_scans([np.empty((0, 2))], [Pose2()])
    with pytest.raises(ShapeError, match="too much"):
        ScanMap.from_points(np.array([[0.0, 0.0], [1e6, 1e6]]), np.zeros((2, 2)))


class FakeMap:
    """A localizer map in memory."""

    def __init__(self) -> None:
        self.added: list = []
        self.saved: dict = {}

    def add(self, keyframe: object) -> None:
        self.added.append(keyframe)

    def keyframes(self) -> list:
        return self.added

    def save(self, name: str, arrays: dict) -> None:
        self.saved[name] = arrays

    def load(self, name: str) -> dict | None:
        return self.saved.get(name)


def localizer(mode: str, localizer_map: FakeMap | None = None, **config: object) -> LaserIcp:
    part = LaserIcp(LaserIcpConfig.model_validate({"laser": "scan", **config}))
    part.start(Session(mode=mode, sensors={"scan": SensorInfo("scan", "scan")}, map=localizer_map))  # type: ignore[arg-type]
    return part


def taught(localizer_map: FakeMap) -> None:
    """Teach a two-metre line with odometry that is up to 5 cm off."""
    part = localizer("teach", localizer_map)
    for i in range(21):
        true = Pose2(1.0 + 0.1 * i, 1.2, 0.02 * i)
        believed = true @ Pose2(0.002 * i, -0.0015 * i, 0.0)
        estimates = part.observe(
            Frame("scan", float(i), scan_at(true, noise_m=0.01, seed=i)),
            Belief(float(i), believed, pose_odom_base=believed, travelled_m=0.1 * i),
        )
        if i > 0:
            (motion,) = estimates
            assert isinstance(motion, Motion)
            assert error_of(motion.pose_since_now, Pose2(0.9 + 0.1 * i, 1.2, 0.02 * i - 0.02).between(true))[0] < 0.02
    part.finish()


def test_what_covers_the_laser_becomes_no_wall_of_the_map() -> None:
    localizer_map = FakeMap()
    part = localizer("teach", localizer_map)

    for i in range(4):
        pose = Pose2(1.0 + 0.5 * i, 1.2, 0.0)
        scan = scan_at(pose, noise_m=0.01, seed=i)
        if i == 2:
            scan = replace(scan, ranges_m=np.full_like(scan.ranges_m, 0.15))
        said = part.observe(
            Frame("scan", float(i), scan), Belief(float(i), pose, pose_odom_base=pose, travelled_m=0.5 * i)
        )
        assert isinstance(said[0] if said else None, Lost) == (i == 2)

    assert [keyframe.stamp_s for keyframe in localizer_map.keyframes()] == [0.0, 1.0, 3.0]


def test_it_teaches_a_map_and_localizes_in_it() -> None:
    localizer_map = FakeMap()
    taught(localizer_map)
    part = localizer("replay", localizer_map)
    true = Pose2(2.03, 1.15, 0.3)

    (fix,) = part.observe(Frame("scan", 0.0, scan_at(true, noise_m=0.01)), Belief(0.0, Pose2(2.3, 1.4, 0.2)))

    assert isinstance(fix, Fix)
    distance_m, heading_rad = error_of(fix.pose_map_base, true)
    assert distance_m < 0.04
    assert heading_rad < math.radians(1.0)
    assert np.linalg.eigvalsh(fix.information).min() > 0


def test_finish_from_the_map_alone_gives_the_same_map() -> None:
    localizer_map = FakeMap()
    taught(localizer_map)
    before = localizer_map.saved.pop("map")

    localizer("replay", localizer_map).finish()

    np.testing.assert_array_equal(localizer_map.saved["map"]["points"], before["points"])


def driven_without_a_start(part: LaserIcp, walls: tuple = WALLS, first_m: float = 1.0) -> list[tuple[Pose2, object]]:
    """Drive 1.6 m with exact odometry from where nobody knows; return true poses and answers."""
    start, told = Pose2(first_m, 1.3, 0.1), []
    for k in range(9):
        moved = Pose2(0.2 * k, 0.02 * k, 0.05 * k)
        scan = scan_at(start @ moved, noise_m=0.01, seed=90 + k, walls=walls)  # type: ignore[arg-type]
        (answer,) = part.observe(Frame("scan", float(k), scan), Belief(float(k), pose_odom_base=moved))
        told.append((start @ moved, answer))
    return told


def test_without_a_pose_it_is_looked_for_in_the_whole_place() -> None:
    localizer_map = FakeMap()
    taught(localizer_map)

    told = driven_without_a_start(localizer("replay", localizer_map))

    fixes = [(true, answer) for true, answer in told if isinstance(answer, Fix)]
    assert len(fixes) >= 5
    assert all(error_of(fix.pose_map_base, true)[0] < 0.06 for true, fix in fixes)


class BestElsewhere:
    """Finds the same pose for every scan, along its way, that explains so much of it and stands out."""

    def __init__(self, *inlier_shares: float) -> None:
        self._inlier_shares, self._n = inlier_shares, 0

    def match(self, points_base: Points, *, to_line: bool = True) -> ScanMatch:
        share = self._inlier_shares[self._n % len(self._inlier_shares)]
        self._n += 1
        return ScanMatch(Pose2(0.2 * self._n), np.eye(3), share, 0.02, 0.07, 0.2)


@pytest.mark.parametrize(
    ("shares", "believed_from"),
    [
        ((0.97,), 5),  # so many scans must lead there
        ((0.87,), None),  # a pose that stands out must explain the scan
        ((0.97, 0.97, 0.6), None),  # and the scans between them too: a foreign building fits now and then
        ((0.97, 0.97, 0.97, 0.97, 0.6), 6),
    ],
)
def test_a_pose_must_explain_scan_after_scan_to_be_a_start(
    shares: tuple[float, ...], believed_from: int | None
) -> None:
    search = AnywhereSearch(BestElsewhere(*shares), 0.9)  # type: ignore[arg-type]

    told = [search.update(np.zeros((40, 2)), Pose2(0.2 * k))[1] for k in range(1, 20)]

    assert (told.index(True) + 1 if True in told else None) == believed_from


def test_a_place_asks_for_what_its_own_scans_explain() -> None:
    wall = np.stack([np.linspace(0.0, 4.0, 400), np.full(400, 2.0)], axis=1)
    scan_map = ScanMap.from_scans([wall], [Pose2()], min_hits=1)

    def keyframe_of(n_elsewhere: int) -> Keyframe:
        """A scan that was taken with so many of 100 returns from what is not in the map."""
        points = wall[::4] - (1.0, 0.0)
        points[:n_elsewhere, 1] = 0.0
        return Keyframe(0.0, 0.0, Pose2(1.0), {"points": points.astype(np.float32)})

    assert least_share(scan_map, [keyframe_of(0)] * 5) == pytest.approx(0.98)
    assert least_share(scan_map, [keyframe_of(4)] * 200) == pytest.approx(0.94)  # an untidy place asks for less
    assert least_share(scan_map, [keyframe_of(50)] * 5) == 0.9  # and none for less than this


def test_a_room_that_is_the_same_turned_about_tells_no_start() -> None:
    walls = ((0.0, 0.0, 6.0, 0.0), (6.0, 0.0, 6.0, 4.0), (6.0, 4.0, 0.0, 4.0), (0.0, 4.0, 0.0, 0.0))
    localizer_map = FakeMap()
    part = localizer("teach", localizer_map)
    for k in range(41):
        pose = Pose2(1.0 + 0.1 * k, 2.0, 0.0)
        scan = scan_at(pose, noise_m=0.01, seed=k, walls=walls)  # type: ignore[arg-type]
        part.observe(Frame("scan", float(k), scan), Belief(float(k), pose, travelled_m=0.1 * k))
    part.finish()

    told = driven_without_a_start(localizer("replay", localizer_map), walls)

    assert all(isinstance(answer, Lost) for _, answer in told)


def test_a_robot_that_stands_is_not_looked_for_again() -> None:
    localizer_map = FakeMap()
    taught(localizer_map)
    part, nothing = localizer("replay", localizer_map), Scan(np.full(360, 3.0), 0.0, 2 * math.pi / 360, 0.05, 20.0)

    reasons = [part.observe(Frame("scan", float(k), nothing), Belief(float(k)))[0] for k in range(2)]

    assert all(isinstance(answer, Lost) for answer in reasons)
    assert "stands" in reasons[1].reason  # type: ignore[union-attr]


def test_a_map_without_taught_poses_says_that_it_needs_a_start() -> None:
    localizer_map = FakeMap()
    taught(localizer_map)
    localizer_map.added.clear()

    (lost,) = localizer("replay", localizer_map).observe(Frame("scan", 0.0, scan_at(Pose2(2, 1, 0))), Belief(0.0))

    assert isinstance(lost, Lost)
    assert "no start pose" in lost.reason


def test_a_scan_of_another_place_is_refused() -> None:
    localizer_map = FakeMap()
    taught(localizer_map)
    elsewhere = Scan(np.random.default_rng(1).uniform(0.3, 8.0, 360), 0.0, 2 * math.pi / 360, 0.05, 20.0)

    (lost,) = localizer("replay", localizer_map).observe(Frame("scan", 0.0, elsewhere), Belief(0.0, Pose2(2, 1, 0)))

    assert isinstance(lost, Lost)
    assert "does not fit" in lost.reason


def test_an_empty_scan_and_a_missing_map_are_lost_not_errors() -> None:
    blind = Scan(np.full(360, np.nan), 0.0, 0.017)
    localizer_map = FakeMap()
    taught(localizer_map)

    (without_returns,) = localizer("replay", localizer_map).observe(Frame("scan", 0.0, blind), Belief(0.0, Pose2()))
    (without_map,) = localizer("track").observe(Frame("scan", 0.0, blind), Belief(0.0, Pose2()))

    assert isinstance(without_returns, Lost)
    assert isinstance(without_map, Lost)


def test_another_payload_is_a_typed_error() -> None:
    frame = Frame("scan", 0.0, Image(np.zeros((4, 4), np.uint8)))

    with pytest.raises(ShapeError, match="takes scans"):
        localizer("track").observe(frame, Belief(0.0))


def carmen_scans(path: Path) -> list[tuple[Points, Pose2]]:
    """Points and corrected pose of every FLASER line."""
    scans = []
    with gzip.open(path, "rt") as file:
        for line in file:
            fields = line.split()
            if fields and fields[0] == "FLASER":
                n = int(fields[1])
                ranges = np.array(fields[2 : 2 + n], dtype=float)
                angles = -math.pi / 2 + math.pi * np.arange(n) / n
                seen = (ranges > 0.1) & (ranges < 20.0)
                points = np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=1)[seen]
                scans.append((points, Pose2(*map(float, fields[2 + n : 5 + n]))))
    return scans


@pytest.mark.data
@pytest.mark.parametrize("log", ["intel", "freiburg-079"])
def test_real_scans_are_found_from_sixty_centimetres_and_ten_degrees_and_fit_to_the_noise_of_their_poses(
    data_folder: Path, log: str
) -> None:
    scans = carmen_scans(data_folder / "omni" / "laser2d_carmen" / f"{log}-corrected.log.gz")
    scan_map = ScanMap.from_scans([points for points, _ in scans[::2]], [pose for _, pose in scans[::2]])
    rng = np.random.default_rng(7)
    asked = scans[1::2][:: max(1, len(scans) // 500)][:250]
    errors = []
    for points, true in asked:
        direction, side = rng.uniform(0, 2 * math.pi), rng.choice([-1, 1])
        guess = Pose2(
            true.x + 0.6 * math.cos(direction), true.y + 0.6 * math.sin(direction), true.theta + side * math.radians(10)
        )
        errors.append(error_of(match_scan(scan_map, points, guess).pose_map_base, true))
    found = [error for error in errors if error[0] < 0.10 and error[1] < math.radians(2.0)]

    assert len(found) >= 0.95 * len(asked)
    distance_m, heading_rad = np.median(found, axis=0)
    assert distance_m <= 0.022
    assert heading_rad <= math.radians(0.5)


def test_a_pose_beside_a_corridor_is_held_along_it_at_what_was_guessed() -> None:
    corridor = ((-50.0, 0.0, 50.0, 0.0), (-50.0, 2.0, 50.0, 2.0))
    scan = Scan(ranges_at(Pose2(0.0, 1.0, 0.0), walls=corridor), 0.0, 2 * math.pi / 360, 0.05, 10.0)
    points = scan.points()[np.hypot(*scan.points().T) < 4.0]
    scan_map = ScanMap.from_scans([points] * 5, [Pose2(float(x), 1.0, 0.0) for x in range(-4, 6, 2)])

    match = told_fit(scan_map, points, pose=Pose2(1.5, 1.0, 0.0), guess=Pose2(0.2, 1.03, 0.01))

    assert match.pose_map_base.x == pytest.approx(0.2, abs=0.02)
    assert match.pose_map_base.y == pytest.approx(1.0, abs=0.005)
    assert match.pose_map_base.theta == pytest.approx(0.0, abs=0.003)
