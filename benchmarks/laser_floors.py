"""Floors of straight walls for a planar laser, drives through them, and the same from recorded logs.

A floor is walls (W, 4) and what stands there; its map is carved from scans all over it. What a robot then meets may
differ: doors, furniture and people.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

import trailmark
from trailmark.arrays import Bools, Floats
from trailmark.frames import Odometry, Scan
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.kernels import kernel
from trailmark_laser_maps.carving import PlacedScan, carve_grid
from trailmark_laser_maps.grid import OccupancyGrid

FIELD_RAD, N_BEAMS, RANGE_M, NOISE_M, DROPOUT = math.radians(240.0), 241, 12.0, 0.015, 0.01
SPEED_MPS, TURN_RADPS, RATE_HZ = 0.5, math.radians(45.0), 5.0


@dataclass(frozen=True, slots=True, eq=False)
class Instant:
    """One scan of a drive: when, where the odometry says, where in truth, and the scan."""

    stamp_s: float
    odometry: Pose2
    truth: Pose2
    scan: Scan


@dataclass(frozen=True, slots=True, eq=False)
class Floor:
    """Walls that are in the map, walls that the robot meets, and where it may drive."""

    name: str
    mapped: Floats
    met: Floats
    size_m: tuple[float, float]
    n_people: int = 0


@kernel
def cast(walls: Floats, x: float, y: float, angles: Floats, farthest_m: float) -> Floats:
    """Return the range to the nearest wall along each angle; infinite beyond the farthest."""
    ranges = np.full(angles.shape[0], np.inf)
    for a in range(angles.shape[0]):
        cos, sin = math.cos(angles[a]), math.sin(angles[a])
        nearest = farthest_m
        for w in range(walls.shape[0]):
            ax, ay = walls[w, 2] - walls[w, 0], walls[w, 3] - walls[w, 1]
            ox, oy = walls[w, 0] - x, walls[w, 1] - y
            determinant = cos * ay - sin * ax
            if abs(determinant) < 1e-12:
                continue
            length = (ox * ay - oy * ax) / determinant
            share = (ox * sin - oy * cos) / determinant
            if 0.0 < length < nearest and 0.0 <= share <= 1.0:
                nearest = length
                ranges[a] = length
    return ranges


def box(x: float, y: float, width: float, depth: float) -> list[tuple[float, float, float, float]]:
    """Return the four sides of a box with a corner at (x, y)."""
    return [
        (x, y, x + width, y),
        (x + width, y, x + width, y + depth),
        (x + width, y + depth, x, y + depth),
        (x, y + depth, x, y),
    ]


def office(seed: int, *, changed: bool = False, n_people: int = 0) -> Floor:
    """Return rooms of several widths on both sides of a corridor, with doors and furniture."""
    rng = np.random.default_rng([seed, 1])
    length, corridor, depth = 24.0, 2.0, 5.0
    walls = box(0.0, 0.0, length, corridor + 2 * depth)
    doors, furniture = [], []
    for y_wall, y_far in ((depth, 0.0), (depth + corridor, 2 * depth + corridor)):
        x = 0.0
        while x < length - 1e-9:
            width = float(rng.uniform(2.8, 5.5))
            width = length - x if x + width > length - 2.8 else width
            at = x + float(rng.uniform(0.4, width - 1.5))
            walls += [(x, y_wall, at, y_wall), (at + 1.0, y_wall, x + width, y_wall), (x, y_wall, x, y_far)]
            doors.append((at, y_wall, at + 1.0, y_wall))
            for _ in range(int(rng.integers(1, 4))):
                w, d = float(rng.uniform(0.4, 1.6)), float(rng.uniform(0.4, 0.9))
                fx = x + float(rng.uniform(0.1, max(0.2, width - w - 0.1)))
                fy = float(rng.uniform(0.1, depth - 2.2)) if y_far == 0.0 else y_far - d - float(rng.uniform(0.1, 2.0))
                furniture.append(box(fx, fy, w, d))
            x += width
    mapped = [*walls, *(side for piece in furniture for side in piece)]
    met = list(mapped)
    if changed:  # a fifth of the doors is shut, a third of the furniture elsewhere
        shut = [door for door in doors if rng.random() < 0.2]
        moved = []
        for piece in furniture:
            dx, dy = rng.uniform(-0.6, 0.6, 2) if rng.random() < 0.33 else (0.0, 0.0)
            moved += [(a + dx, b + dy, c + dx, d + dy) for a, b, c, d in piece]
        met = [*walls, *shut, *moved]
    size = (length, corridor + 2 * depth)
    return Floor(f"office {seed}" + " changed" * changed, np.array(mapped), np.array(met), size, n_people)


def store_hall(seed: int, *, n_people: int = 0) -> Floor:
    """Return a hall of equal shelves in even rows; only its ends and a few pillars tell one aisle from the next."""
    rng = np.random.default_rng([seed, 2])
    walls = box(0.0, 0.0, 22.0, 14.0)
    for x in (3.0, 8.0, 13.0, 18.0):
        for y in (2.5, 5.0, 7.5, 10.0):
            walls += box(x, y, 2.6, 0.8)
    for _ in range(8):
        walls += box(float(rng.uniform(0.3, 21.2)), float(rng.choice([0.0, 13.4])), 0.6, 0.6)
    walls += box(0.0, 5.0, 0.8, 3.0)
    return Floor(f"hall {seed}", np.array(walls), np.array(walls), (22.0, 14.0), n_people)


def symmetric_corridor(n_doors: int = 4) -> Floor:
    """Return a corridor with niches that looks the same from both ends: nobody can tell where he is in it."""
    walls: list[tuple[float, float, float, float]] = [(0.0, 0.0, 0.0, 2.0), (20.0, 0.0, 20.0, 2.0)]
    edges = np.linspace(0.0, 20.0, n_doors + 1)
    for y, out in ((0.0, -0.4), (2.0, 2.4)):
        for a, b in pairwise(edges.tolist()):
            middle = (a + b) / 2
            walls += [(a, y, middle - 0.5, y), (middle + 0.5, y, b, y), (middle - 0.5, out, middle + 0.5, out)]
            walls += [(middle - 0.5, y, middle - 0.5, out), (middle + 0.5, y, middle + 0.5, out)]
    return Floor("symmetric corridor", np.array(walls), np.array(walls), (20.0, 2.0))


def drivable(floor: Floor, cell_m: float = 0.1, clearance_m: float = 0.4) -> Bools:
    """Return the cells (row = y) of the largest connected part of a floor that keep clear of all walls."""
    width, height = (math.ceil(side / cell_m) for side in floor.size_m)
    blocked = np.zeros((height, width), np.bool_)
    blocked[[0, -1]] = blocked[:, [0, -1]] = True
    for x0, y0, x1, y1 in np.vstack([floor.mapped, floor.met]):
        share = np.linspace(0, 1, max(2, int(math.hypot(x1 - x0, y1 - y0) / (0.3 * cell_m))))
        columns = np.floor((x0 + share * (x1 - x0)) / cell_m).astype(int)
        rows = np.floor((y0 + share * (y1 - y0)) / cell_m).astype(int)
        is_in = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        blocked[rows[is_in], columns[is_in]] = True
    from scipy.ndimage import label

    numbered, count = label(distance_transform_edt(~blocked) * cell_m > clearance_m)
    sizes = np.bincount(numbered.ravel(), minlength=count + 1)
    sizes[0] = 0
    return np.asarray(numbered == int(sizes.argmax()))


def drive(floor: Floor, seed: int, duration_s: float) -> Iterator[Instant]:
    """Yield what a robot sees that drives from one place to the next."""
    rng = np.random.default_rng([seed, 3])
    truth = _walk(floor, rng, duration_s)
    people = [_Person(floor, rng) for _ in range(floor.n_people)]
    odometry, before = Pose2(), truth[0]
    scale, drift = 1.0 + 0.02 * rng.standard_normal(), math.radians(0.5) * rng.standard_normal()
    for index, pose in enumerate(truth):
        step = before.between(pose)
        way_m = math.hypot(step.x, step.y)
        turn = step.theta * (1.0 + 0.03 * rng.standard_normal()) + way_m * drift
        turn += math.radians(1.0) * math.sqrt(way_m) * rng.standard_normal()
        odometry = odometry @ Pose2(step.x * scale + 0.02 * way_m * rng.standard_normal(), step.y * scale, turn)
        before = pose
        stamp_s = index / RATE_HZ
        walls = np.vstack([floor.met, *(person.walls(stamp_s) for person in people)]) if people else floor.met
        yield Instant(stamp_s, odometry, pose, scan_at(walls, pose, rng))


def scan_at(walls: Floats, pose: Pose2, rng: np.random.Generator) -> Scan:
    """Return what the laser, in the middle of the robot, sees."""
    angles = np.linspace(-FIELD_RAD / 2, FIELD_RAD / 2, N_BEAMS)
    ranges = cast(walls, pose.x, pose.y, angles + pose.theta, RANGE_M)
    ranges = ranges + NOISE_M * rng.standard_normal(N_BEAMS)
    ranges[~np.isfinite(ranges) | (rng.random(N_BEAMS) < DROPOUT)] = np.nan
    return Scan(ranges, -FIELD_RAD / 2, FIELD_RAD / (N_BEAMS - 1), 0.05, RANGE_M)


def map_of(floor: Floor) -> OccupancyGrid:
    """Return the grid carved from scans all over a floor, at exact poses."""
    rng = np.random.default_rng(0)
    rows, columns = np.nonzero(drivable(replace(floor, met=floor.mapped)))
    scans = []
    for row, column in list(zip(rows.tolist(), columns.tolist()))[::29]:
        pose = Pose2((column + 0.5) * 0.1, (row + 0.5) * 0.1, float(rng.uniform(-math.pi, math.pi)))
        scan = scan_at(floor.mapped, pose, rng)
        scans.append(PlacedScan.at(pose, scan.points(), (0.0, 0.0)))
    return carve_grid(scans)


class _Person:
    """Walks to and fro between two places."""

    def __init__(self, floor: Floor, rng: np.random.Generator) -> None:
        rows, columns = np.nonzero(drivable(floor))
        chosen = rng.integers(len(rows), size=2)
        self._places = np.stack([columns[chosen], rows[chosen]], axis=1) * 0.1
        self._period_s = max(4.0, 2.0 * float(np.hypot(*(self._places[1] - self._places[0])))) / 1.0
        self._phase = float(rng.random())

    def walls(self, stamp_s: float) -> Floats:
        share = abs(2.0 * ((stamp_s / self._period_s + self._phase) % 1.0) - 1.0)
        x, y = self._places[0] + share * (self._places[1] - self._places[0])
        return np.array(box(x - 0.2, y - 0.2, 0.4, 0.4))


def _walk(floor: Floor, rng: np.random.Generator, duration_s: float) -> list[Pose2]:
    cells = drivable(floor)
    number = np.full(cells.shape, -1)
    number[cells] = np.arange(cells.sum())
    rows, columns = np.nonzero(cells)
    pairs = []
    for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
        r, c = rows + dr, columns + dc
        ok = (r < cells.shape[0]) & (c < cells.shape[1]) & (c >= 0)
        a, b = number[rows[ok], columns[ok]], number[r[ok], c[ok]]
        keep = b >= 0
        pairs.append(np.stack([a[keep], b[keep], np.full(keep.sum(), 1000 * math.hypot(dr, dc))], axis=1))
    a, b, cost = np.concatenate(pairs).T
    graph = coo_array((cost, (a.astype(int), b.astype(int))), shape=(len(rows), len(rows))).tocsr()
    at = int(rng.integers(len(rows)))
    theta = float(rng.uniform(-math.pi, math.pi))
    poses = [Pose2((columns[at] + 0.5) * 0.1, (rows[at] + 0.5) * 0.1, theta)]
    while len(poses) < duration_s * RATE_HZ:
        goal = int(rng.integers(len(rows)))
        _, before = dijkstra(graph, directed=False, indices=goal, return_predecessors=True)
        way = [at]
        while way[-1] != goal:
            way.append(int(before[way[-1]]))
        points = np.stack([columns[way] + 0.5, rows[way] + 0.5], axis=1) * 0.1
        poses += _steer(poses[-1], points)
        at = goal
    return poses[: int(duration_s * RATE_HZ)]


def _steer(pose: Pose2, points: Floats) -> list[Pose2]:
    """Return poses along points: turn towards what lies 0.5 m ahead, then go."""
    poses: list[Pose2] = []
    at = 0
    while at < len(points) - 1:
        ahead = points[min(at + 5, len(points) - 1)]
        wanted = math.atan2(ahead[1] - pose.y, ahead[0] - pose.x)
        turn = math.remainder(wanted - pose.theta, 2 * math.pi)
        turn = min(max(turn, -TURN_RADPS / RATE_HZ), TURN_RADPS / RATE_HZ)
        pose = Pose2(pose.x, pose.y, pose.theta + turn)
        if abs(math.remainder(wanted - pose.theta, 2 * math.pi)) < math.radians(20.0):
            step_m = min(SPEED_MPS / RATE_HZ, math.hypot(ahead[0] - pose.x, ahead[1] - pose.y))
            pose = Pose2(pose.x + step_m * math.cos(wanted), pose.y + step_m * math.sin(wanted), pose.theta)
        poses.append(pose)
        offsets = np.hypot(points[at:, 0] - pose.x, points[at:, 1] - pose.y)
        nearest = at + int(offsets.argmin())
        at = len(points) - 1 if offsets[-1] < 0.12 else nearest
    return poses


def log_instants(path: Path, **options: object) -> list[Instant]:
    """Return the scans of a CARMEN log, its odometry and corrected poses, where it has them, carried to the laser."""
    source = trailmark.create("source", "carmen_log", path=path, on_bad_frame="skip", **options)
    source.start(Session())
    odometry: list[tuple[float, Pose2]] = []
    scans: list[tuple[float, Scan]] = []
    for frame in source.frames():
        if isinstance(frame.payload, Odometry) and frame.payload.pose_start_base is not None:
            odometry.append((frame.stamp_s, frame.payload.pose_start_base))
        elif isinstance(frame.payload, Scan):
            scans.append((frame.stamp_s, frame.payload))
    truth = source.ground_truth()
    mounting = source.sensors["laser"].pose_base_sensor.planar()
    source.close()
    stamps = np.array([stamp for stamp, _ in odometry])
    found = []
    for stamp_s, scan in scans:
        if not stamps[0] < stamp_s < stamps[-1]:
            continue
        at = int(np.searchsorted(stamps, stamp_s))
        (before_s, before), (after_s, after) = odometry[at - 1], odometry[at]
        moved = before.interpolate(after, (stamp_s - before_s) / max(after_s - before_s, 1e-9))
        true = moved if truth is None else truth.at([min(max(stamp_s, truth.stamps_s[0]), truth.stamps_s[-1])])[0][1]
        found.append(Instant(stamp_s, moved @ mounting, true @ mounting, scan))
    return found
