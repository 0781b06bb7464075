"""What ground_map corrects, what it refuses and where it starts: teach and replay in open loop, truth known.

    python benchmarks/ground_map.py [--what course spoilt start] [--floors wood_floor ...] [--metres 13.4]
                                    [--quick] [--json | --markdown]

* course: a winding course is taught, then driven again beside it by 5.5 mm and 0.75 deg (1 sigma of each of two
  waves), on another noise. *Detected* is the distance between where a patch was expected and found (the
  paper's Fig. 13); *left* is the true error of the pose, relative to the taught place, in the picture in which
  the correction counts: one picture after it was taken, or 14 (the paper's 196 ms), by Eq. (5).
* spoilt: 2 m, of which 0.5 m are covered with another floor, or 30 % of the ground with blobs of 8 to 23 mm, or 10 %
  with specks of 0.4 to 1.6 mm (radii). False: accepted and more than 5 mm off the truth.
  Places that the cover touches are not counted among those that could be found.
* start: the pose is unknown at random places of the course, 5 mm and 1.5 deg beside it (1 sigma). The robot stands
  until every place was tried, then drives on for 0.5 m; its first `Fix`, and its error. The simulator makes an
  endless floor of a photograph by showing pieces of it again: there places look alike that are not the same.

The camera and the floors are those of ground_accuracy.py.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from ground_scenes import RATE_HZ, SPEED_MPS, Drive, floor, photographs, scale_m, sensor

from trailmark.estimates import Estimate, Fix, Lost
from trailmark.estimation.dead_reckoning import DeadReckoning
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.experiments import Row
from trailmark.frames import Frame
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.testing import MemoryMap
from trailmark_ground_vo.config import GroundMapConfig, GroundVOConfig
from trailmark_ground_vo.localizer import GroundVO
from trailmark_ground_vo.map_localizer import GroundMap
from trailmark_sim.ground.ground import GroundTexture, Zone

FLOORS = ("wood_floor", "asphalt", "warehouse_concrete_1k")
START_FLOORS = ("sim:asphalt", "sim:wood", "wood_floor", "asphalt", "warehouse_concrete_1k")
CAMERA: dict[str, Any] = {"camera": "floor"}
NO_CONSENSUS = {"min_groups": 1, "tolerance_px": 1000.0, "min_correlation": 0.0}
_FALSE_M, _DRIVE_ON_M = 5e-3, 0.5

Poses = Sequence[Pose2]


class Spotted(GroundTexture):
    """A ground on which round spots of any grey lie, the same from every place.

    Parameters
    ----------
    ground : GroundTexture
        What is below.
    share : float
        Of the ground that is covered.
    radii_m : (float, float)
        Smallest and largest radius of a spot [m].
    """

    _CELL_M = 0.1

    def __init__(self, ground: GroundTexture, share: float, radii_m: tuple[float, float]) -> None:
        super().__init__(ground.zones, ground.seed, ground.weather, ground.texel_m)
        self._radii_m = radii_m
        low, high = radii_m
        mean_area_m2 = math.pi * (low * low + low * high + high * high) / 3.0
        self._per_cell = -math.log(1.0 - share) * self._CELL_M**2 / mean_area_m2  # spots overlap

    def paint(self, x_m: float, y_m: float, n_texels: int) -> npt.NDArray[np.float32]:
        """Return the greys of a square of texels, spots included."""
        grey, side_m, rim_m = super().paint(x_m, y_m, n_texels), n_texels * self.texel_m, self._radii_m[1]
        low = [math.floor((start - rim_m) / self._CELL_M) for start in (x_m, y_m)]
        high = [math.floor((start + side_m + rim_m) / self._CELL_M) for start in (x_m, y_m)]
        for i in range(low[0], high[0] + 1):
            for j in range(low[1], high[1] + 1):
                rng = np.random.default_rng([self.seed, i + 10**6, j + 10**6])
                for _ in range(rng.poisson(self._per_cell)):
                    x, y, radius = (*((np.array([i, j]) + rng.random(2)) * self._CELL_M), rng.uniform(*self._radii_m))
                    centre = [round(16 * (place - start) / self.texel_m) for place, start in ((x, x_m), (y, y_m))]
                    level = float(rng.integers(0, 256))
                    cv2.circle(grey, centre, round(16 * radius / self.texel_m), level, -1, cv2.LINE_8, 4)
        return grey


@dataclass(frozen=True)
class OpenDrive(Drive):
    """A drive from the origin of the map along x, over ground that may be spotted."""

    spots: tuple[float, tuple[float, float]] | None = None

    def pose(self, index: int) -> Pose2:
        """Return the true pose of a picture, in the map."""
        return self.law(index / RATE_HZ)

    def ground(self) -> GroundTexture:
        """Return the floor of this drive."""
        below = super().ground()
        return below if self.spots is None else Spotted(below, *self.spots)


class Robot:
    """ground_vo, ground_map and dead reckoning, driven over pictures."""

    def __init__(self, localizer_map: MemoryMap, mode: str, is_teaching: bool, latency: int = 0, **keys: Any) -> None:
        paper = {"preset": "paper"} if mode == "paper" else {}
        motion = GroundVOConfig.model_validate(CAMERA | paper)
        self.motion, self.map = GroundVO(motion), GroundMap(GroundMapConfig.model_validate(CAMERA | paper | keys))
        session = Session(mode="teach" if is_teaching else "replay", sensors={"floor": sensor()}, map=localizer_map)
        self.motion.start(session)
        self.map.start(session)
        self.estimator = DeadReckoning(DeadReckoningConfig())
        self.applied: Fix | None = None
        self._latency = latency
        self._pending: list[tuple[int, Estimate]] = []

    def start_at(self, pose: Pose2 | None) -> None:
        """Begin at a known pose, or at an unknown one."""
        self.estimator.start(Session(start_pose=pose))

    def see(self, index: int, frame: Frame) -> Sequence[Estimate]:
        """Take a picture; the answers of the map count `latency` pictures later, and none is asked until then."""
        self.applied = None
        for estimate in self.motion.observe(frame, self.estimator.belief(frame.stamp_s)):
            self.estimator.apply("motion", estimate)
        for due, estimate in [item for item in self._pending if item[0] <= index]:
            self.estimator.apply("map", estimate)
            self._pending.remove((due, estimate))
            self.applied = estimate if isinstance(estimate, Fix) else self.applied
        if self._pending:
            return ()
        said = self.map.observe(frame, self.estimator.belief(frame.stamp_s))
        for estimate in said:
            if self._latency:
                self._pending.append((index + self._latency, estimate))
            else:
                self.estimator.apply("map", estimate)
        return said

    def pose(self, stamp_s: float) -> Pose2:
        """Return what is believed."""
        pose = self.estimator.belief(stamp_s).pose_map_base
        assert pose is not None
        return pose


def course(metres: float) -> Callable[[float], Pose2]:
    """Return base by the way driven, on a course of bends with a radius of 0.8 m at least."""
    step_m, poses = 0.002, [Pose2()]
    for index in range(int(metres / step_m) + 100):
        curvature = math.sin(2 * math.pi * index * step_m / 3.35) / 0.8
        poses.append(poses[-1] @ Pose2.exp(step_m, 0.0, step_m * curvature))

    def at(way_m: float) -> Pose2:
        index = min(int(way_m / step_m), len(poses) - 2)
        return poses[index].interpolate(poses[index + 1], way_m / step_m - index)

    return at


def beside(way_m: float, seed: int) -> Pose2:
    """Return how the replay deviates from the course, with the way."""
    lateral_m = 5.5e-3 * (math.sin(way_m / 0.31 + seed) + math.sin(way_m / 0.83 + 2 * seed))
    turn_rad = math.radians(0.75) * (math.cos(way_m / 0.31 + seed) + math.sin(way_m / 0.57 + 3 * seed))
    return Pose2(0.0, lateral_m, turn_rad)


@dataclass
class Taught:
    """A course that was driven once."""

    floor: str
    mode: str
    metres: float
    seed: int
    localizer_map: MemoryMap
    places: Poses  # true poses where patches were registered

    def poses_at(self, place: int, true: Pose2) -> Pose2:
        """Return the pose that a robot at `true` should believe: that of the place, and the true way from it."""
        return self.localizer_map.keyframes()[place].pose_map_base @ self.places[place].between(true)


def teach(name: str, mode: str, metres: float, seed: int, **keys: Any) -> Taught:
    """Teach the course."""
    at, localizer_map = course(metres), MemoryMap()
    n_frames = int(metres / SPEED_MPS * RATE_HZ)
    drive = OpenDrive(name, lambda time_s: at(SPEED_MPS * time_s), n_frames, seed)
    robot = Robot(localizer_map, mode, is_teaching=True, **keys)
    robot.start_at(Pose2())
    for index, frame in enumerate(drive.frames()):
        robot.see(index, frame)
    places = [drive.pose(round(keyframe.stamp_s * RATE_HZ)) for keyframe in localizer_map.keyframes()]
    return Taught(name, mode, metres, seed, localizer_map, places)


@dataclass
class Replay:
    """What the map said on a replay, and what was true."""

    detected_m: list[float] = field(default_factory=list)
    fix_m: list[float] = field(default_factory=list)
    left_m: list[float] = field(default_factory=list)
    left_rad: list[float] = field(default_factory=list)
    places: list[int] = field(default_factory=list)
    every_m: list[float] = field(default_factory=list)
    n_rejected: int = 0

    @property
    def n_false(self) -> int:
        """Corrections that were wrong."""
        return sum(miss_m > _FALSE_M for miss_m in self.fix_m)


def replay(
    taught: Taught, latency: int, zones: tuple[Zone, ...] = (), spots: tuple[float, tuple[float, float]] | None = None,
    **keys: Any,
) -> Replay:  # fmt: skip
    """Drive the taught course again, beside it, and compare every correction with the truth."""
    at, robot = (
        course(taught.metres),
        Robot(taught.localizer_map, taught.mode, is_teaching=False, latency=latency, **keys),
    )
    n_frames = int(taught.metres / SPEED_MPS * RATE_HZ)

    def law(time_s: float) -> Pose2:
        return at(SPEED_MPS * time_s) @ beside(SPEED_MPS * time_s, taught.seed)

    drive = OpenDrive(taught.floor, law, n_frames, taught.seed, 1, zones, spots)
    robot.start_at(taught.poses_at(0, drive.pose(0)))
    out = Replay()
    for index, frame in enumerate(drive.frames()):
        said, true = robot.see(index, frame), drive.pose(index)
        out.n_rejected += sum(isinstance(estimate, Lost) for estimate in said)
        for fix in (estimate for estimate in said if isinstance(estimate, Fix)):
            place = round(fix.details["place"])
            out.places.append(place)
            out.detected_m.append(scale_m() * fix.details["shift_px"])
            out.fix_m.append(taught.poses_at(place, true).distance_to(fix.pose_map_base))
        now = robot.pose(frame.stamp_s)
        if robot.applied is not None:
            error = taught.poses_at(round(robot.applied.details["place"]), true).between(now)
            out.left_m.append(math.hypot(error.x, error.y))
            out.left_rad.append(abs(error.theta))
        nearest = min(range(len(taught.places)), key=lambda n: taught.places[n].distance_to(true))
        out.every_m.append(taught.poses_at(nearest, true).distance_to(now))
    return out


# --- rows --------------------------------------------------------------------------------------------------------


def course_rows(name: str, mode: str, metres: float) -> Iterator[Row]:
    """Yield what the search detects and what is left, with a latency of 1 and of 14 pictures."""
    taught, means = teach(name, mode, metres, seed=3), {}
    n_places, is_refined = len(taught.places), mode == "refined"
    label = f"{metres:g} m course, {mode if is_refined else 'as printed'}"
    n_bytes = {sum(array.nbytes for array in k.arrays.values()) + 24 for k in taught.localizer_map.keyframes()}
    bar = 1960.0
    yield Row(label, f"{name}: registrations", "", n_places, 268.0 if metres == 13.4 else None, n=n_places)
    yield Row(label, f"{name}: bytes of a registration", "B", max(n_bytes), 1960.0, bar, n=n_places)
    for latency in (1, 14):
        out = replay(taught, latency)
        left_mm, when = 1e3 * np.array(out.left_m), f"{latency} picture{'s' * (latency > 1)} late"
        means[latency] = float(left_mm.mean())
        if latency == 1:
            detected_mm = 1e3 * np.array(out.detected_m)
            bars = ((0.63, 0.2), (4.6, 1.5)) if is_refined else ((None, None), (None, None))
            n = len(detected_mm)
            yield Row(label, f"{name}: detected, mean", "mm", float(detected_mm.mean()), 0.63, *bars[0], n=n)
            yield Row(label, f"{name}: detected, max", "mm", float(detected_mm.max()), 4.6, *bars[1], n=n)
            share = 100.0 * len(set(out.places)) / n_places
            yield Row(label, f"{name}: places found", "%", share, None, 95.0, 99.0, better="higher", n=n_places)
            yield Row(label, f"{name}: searches rejected", "", out.n_rejected, n=out.n_rejected + len(out.places))
        mean_bar = ((0.25, 0.1) if is_refined else (0.75, None)) if latency == 1 else (None, None)
        yield Row(label, f"{name}: left, {when}, mean", "mm", means[latency], None, *mean_bar, n=len(left_mm))
        if latency == 1:
            high = (1.0, 0.5) if is_refined else (None, None)
            yield Row(
                label,
                f"{name}: left, {when}, p99",
                "mm",
                float(np.quantile(left_mm, 0.99)),
                None,
                *high,
                n=len(left_mm),
            )
        most = 4.6 if not is_refined and latency == 1 else None
        yield Row(label, f"{name}: left, {when}, max", "mm", float(left_mm.max()), None, most, n=len(left_mm))
        heading_deg = math.degrees(float(np.mean(out.left_rad)))
        yield Row(label, f"{name}: heading left, {when}, mean", "deg", heading_deg, n=len(left_mm))
        yield Row(
            label, f"{name}: every picture, {when}, mean", "mm", 1e3 * float(np.mean(out.every_m)), n=len(out.every_m)
        )
        yield Row(label, f"{name}: false corrections, {when}", "", out.n_false, None, 0.0, n=len(out.places))
    most_late = (2.0, 1.2) if is_refined else (None, None)
    late = means[14] / means[1]
    yield Row(label, f"{name}: left, 14 pictures late / 1 picture", "", late, None, *most_late, n=n_places)


def spoilt_rows(name: str, metres: float) -> Iterator[Row]:
    """Yield false corrections and what is found on spoilt ground."""
    taught = teach(name, "refined", metres, seed=4)
    other = "planks" if "planks" in photographs() and name != "planks" else "sim:terrazzo"
    middle_m = taught.places[len(taught.places) // 2].x
    box = (middle_m - 0.25, middle_m + 0.25, -np.inf, np.inf)
    cases: dict[str, dict[str, Any]] = {
        "clean": {},
        "0.5 m of another floor": {"zones": (Zone(floor(other), box),)},
        "0.5 m of another floor, no consensus": {"zones": (Zone(floor(other), box),)} | NO_CONSENSUS,
        "10 % specks": {"spots": (0.1, (4e-4, 1.6e-3))},
        "30 % blobs": {"spots": (0.3, (8e-3, 23e-3))},
        "30 % blobs, all four groups": {"spots": (0.3, (8e-3, 23e-3)), "min_groups": 4},
    }
    for case, how in cases.items():
        out = replay(taught, 1, **how)
        # the patch reaches 24 mm from its middle, the search for it 25 mm further
        reach_m = 0.05 if "zones" in how else -1.0
        open_places = {
            n for n, place in enumerate(taught.places) if not box[0] - reach_m < place.x < box[1] + reach_m
        } if "zones" in how else set(range(len(taught.places)))  # fmt: skip
        has_bar = "no consensus" not in case
        yield Row("spoilt ground", f"{name}, {case}: false corrections > 5 mm", "", out.n_false, None,
                   0.0 if has_bar else None, n=len(out.places))  # fmt: skip
        found = 100.0 * len(open_places & set(out.places)) / len(open_places)
        bars = {"clean": (95.0, 99.0), "10 % specks": (70.0, 90.0)}.get(case, (None, None))
        yield Row("spoilt ground", f"{name}, {case}: places found", "%", found, None, *bars,
                   better="higher", n=len(open_places))  # fmt: skip
        yield Row("spoilt ground", f"{name}, {case}: worst correction", "mm", 1e3 * max(out.fix_m, default=0.0),
                   n=len(out.places))  # fmt: skip


@dataclass(frozen=True)
class Start:
    """How one start without a pose went."""

    is_standing: bool
    n_pictures: int
    driven_m: float
    miss_m: float


def find_start(taught: Taught, way_m: float, seed: int) -> Start | None:
    """Put the robot down beside the course, let it stand, then drive on; return its first `Fix`."""
    at, rng = course(taught.metres), np.random.default_rng([6, seed])
    x, y = rng.normal(0.0, 5e-3, 2).tolist()
    aside = Pose2(x, y, math.radians(float(rng.normal(0.0, 1.5))))
    n_still = 4 + len(taught.places) // 20  # every place is tried, and a little more

    def law(time_s: float) -> Pose2:
        return at(way_m + SPEED_MPS * max(0.0, time_s - n_still / RATE_HZ)) @ aside

    drive = OpenDrive(taught.floor, law, n_still + int(_DRIVE_ON_M / SPEED_MPS * RATE_HZ), taught.seed, 2 + seed)
    robot = Robot(taught.localizer_map, taught.mode, is_teaching=False)
    robot.start_at(None)
    for index, frame in enumerate(drive.frames()):
        for fix in (estimate for estimate in robot.see(index, frame) if isinstance(estimate, Fix)):
            truth = taught.poses_at(round(fix.details["place"]), drive.pose(index))
            driven_m = SPEED_MPS * max(0, index - n_still) / RATE_HZ
            return Start(index < n_still, index + 1, driven_m, truth.distance_to(fix.pose_map_base))
    return None


def start_rows(name: str, metres: float, n_starts: int) -> Iterator[Row]:
    """Yield how long it takes to find the start anywhere on the course, and how right it is."""
    taught = teach(name, "refined", metres, seed=5)
    ways_m = np.random.default_rng(6).uniform(0.1, metres - 0.2 - _DRIVE_ON_M, n_starts)
    starts = [find_start(taught, float(way_m), n) for n, way_m in enumerate(ways_m)]
    found = [start for start in starts if start is not None]
    right = [start for start in found if start.miss_m <= _FALSE_M]
    standing = [start for start in right if start.is_standing]
    label, n = f"start anywhere, {metres:g} m", n_starts
    yield Row(label, f"{name}: wrong by more than 5 mm", "", len(found) - len(right), None, 0.0, n=n)
    yield Row(label, f"{name}: found standing still", "%", 100.0 * len(standing) / n, better="higher", n=n)
    yield Row(label, f"{name}: found within {_DRIVE_ON_M} m", "%", 100.0 * len(right) / n, better="higher", n=n)
    yield Row(label, f"{name}: driven until found, largest", "m", max((s.driven_m for s in right), default=math.nan),
               n=len(right))  # fmt: skip
    yield Row(label, f"{name}: error, mean", "mm", 1e3 * float(np.mean([s.miss_m for s in right] or [math.nan])),
               n=len(right))  # fmt: skip


def measure(options: argparse.Namespace) -> Iterator[Row]:
    """Yield the rows that were asked for."""
    names = options.floors or [name for name in FLOORS if name in photographs()] or ["sim:wood", "sim:asphalt"]
    names = names[:1] if options.quick else names
    metres = options.metres or (1.0 if options.quick else 13.4)
    for name in names:
        if "course" in options.what:
            for mode in ("refined",) if options.quick else ("refined", "paper"):
                yield from course_rows(name, mode, metres)
        if "spoilt" in options.what:
            yield from spoilt_rows(name, min(metres, 2.0))
    if "start" in options.what:
        there = [name for name in START_FLOORS if name.startswith("sim:") or name in photographs()]
        for name in there[: 1 if options.quick else None]:
            yield from start_rows(name, min(metres, 5.0), 3 if options.quick else 20)


def markdown(rows: Sequence[Row]) -> str:
    """Return the rows as a table."""
    lines = ["| | | unit | paper | ours | bar | stretch | n | |", "|---|---|---|---|---|---|---|---|---|"]
    for row in rows:
        numbers = ["" if value is None else f"{value:.4g}" for value in (row.paper, row.ours, row.bar, row.stretch)]
        met = "" if row.met is None else "met" if row.met else "not met"
        lines.append(f"| {row.experiment} | {row.item} | {row.unit} | {' | '.join(numbers)} | {row.n} | {met} |")
    return "\n".join(lines)


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    kinds = ["course", "spoilt", "start"]
    parser.add_argument("--what", nargs="+", default=kinds, choices=kinds)
    parser.add_argument("--floors", nargs="+")
    parser.add_argument("--metres", type=float, help="length of the course; default: 13.4")
    parser.add_argument("--quick", action="store_true", help="1 m on one floor")
    parser.add_argument("--json", action="store_true", help="a list of rows")
    parser.add_argument("--markdown", action="store_true", help="the table of the page")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    rows = []
    for row in measure(options):
        rows.append(row)
        if not (options.json or options.markdown):
            bar = "" if row.bar is None else f"bar {row.bar:g}  {'met' if row.met else 'NOT MET'}"
            print(f"{row.experiment:24}{row.item:72}{row.ours or 0.0:10.3f} {row.unit:4}{bar:20} n={row.n}", flush=True)
    if options.markdown:
        print(markdown(rows))
    if options.json:
        print(json.dumps([row.document() for row in rows], indent=2))


if __name__ == "__main__":
    main()
