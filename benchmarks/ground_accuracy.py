"""Accuracy of the downward camera on photographs of real floors, through the localizers as a robot would run them.

Frames are rendered exactly (`trailmark.testing.ground`): 512 x 480 pixels of 0.39 mm at 70 Hz and 0.26 m/s, noise of
3 grey levels, a vignette of 30 % that a flat field from noisy reference pictures takes away. A seed is a place and
direction on the floor, and the noise.

    python benchmarks/ground_accuracy.py [--what straight curve course covered] [--floors wood_floor ...]
                                         [--seeds 5] [--modes refined paper] [--quick] [--json]

* straight: 10 m. Errors of end position [% of the way], odometer [%] and heading [deg/m]; rms of the seeds.
* curve: 3 m, up to 20 px and 1.5 deg per picture; errors over 1 m.
* course: 13.4 m taught, then driven again with an offset of 5.5 mm and 0.75 deg (1 sigma). What the search detects,
  and what is left of the pose relative to the taught place, truth known; with a latency of 1 and of 14 pictures.
* covered: 2 m of which 0.5 m are covered with another floor; 30 % blobs; 10 % speckle: false corrections, acceptance.

The photographs are not shipped (``TRAILMARK_DATA``, or ``../shared/data``); without them procedural floors are used.
"""

from __future__ import annotations

import argparse
import json
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.estimates import Belief, Estimate, Fix, Lost, Motion
from trailmark.estimation.dead_reckoning import DeadReckoning
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.experiments import Row
from trailmark.frames import Frame, GroundPlane, SensorInfo
from trailmark.geometry import Pose2, wrap_angle
from trailmark.interfaces import Drawer, Session
from trailmark.paths import Keyframe
from trailmark.testing.ground import Ground, GroundCamera, GroundRun, MotionLaw, ground_run, straight
from trailmark_ground_vo.config import GroundMapConfig, GroundVOConfig
from trailmark_ground_vo.localizer import GroundVO
from trailmark_ground_vo.map_localizer import GroundMap

SCALE_M, RATE_HZ, SPEED_MPS = 3.9e-4, 70.0, 0.26
FLOORS = (
    "wood_floor", "planks", "tiles_1k", "pavers", "asphalt", "asphalt_cracked_1k", "warehouse_concrete_1k", "grass_1k",
    "wood_dark", "artificial_turf_1k",
)  # fmt: skip
COURSE_FLOORS = ("wood_floor", "asphalt", "warehouse_concrete_1k", "planks")
#: Bars and stretches: position [%], odometer [%], heading [deg/m]; the last two floors have bars of their own.
STRAIGHT_BARS = ((0.15, 0.05), (0.02, 0.005), (0.03, 0.01))
POSITION_BARS = {"wood_dark": (0.3, 0.1), "artificial_turf_1k": (0.5, 0.1)}
CAMERA: dict[str, Any] = {"camera": "floor"}

Poses = list[Pose2]


def data_folder() -> Path:
    """Return the folder of the photographs, which may be missing."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    return Path(os.environ.get("TRAILMARK_DATA", beside)) / "ground"


@lru_cache(maxsize=4)
def floor(name: str) -> Ground:
    """Return a photographed floor, or a procedural one where there is none of that name."""
    file = data_folder() / f"{name}.jpg"
    if file.is_file():
        return Ground(np.asarray(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), np.uint8), SCALE_M)
    return Ground.procedural(sum(name.encode()), grain_px=1.2, contrast=10.0)


def camera() -> GroundCamera:
    """Return the camera of all runs."""
    return GroundCamera(metres_per_pixel=(SCALE_M, SCALE_M), noise_sigma=3.0, vignette=0.3)


@lru_cache(maxsize=1)
def sensor() -> SensorInfo:
    """Return the camera as it is calibrated: the flat field is the mean of 32 noisy pictures of grey card."""
    card, true = Ground(np.full((64, 64), 180.0, np.float32)), camera()
    pictures = [true.image(card, Pose2(), seed=999, index=index) for index in range(32)]
    mean = cv2.GaussianBlur(np.mean(pictures, axis=0, dtype=np.float32), (0, 0), 8.0)
    plane = GroundPlane(true.metres_per_pixel, flat_field=np.asarray(mean / mean.mean(), np.float32))
    return replace(true.sensor_info("floor", RATE_HZ), calibration=plane)


def start_of(seed: int) -> Pose2:
    """Return where a run of this seed begins."""
    rng = np.random.default_rng([1, seed])
    return Pose2(float(rng.uniform(0, 5)), float(rng.uniform(0, 5)), float(rng.uniform(-math.pi, math.pi)))


def driven(name: str, law: MotionLaw, n_frames: int, seed: int) -> GroundRun:
    """Return a run over a floor from the start of its seed."""
    start = start_of(seed)
    return ground_run(
        lambda time_s: start @ law(time_s), n_frames, rate_hz=RATE_HZ, ground=floor(name), camera=camera(), seed=seed
    )


class DictDrawer(Drawer):
    """A drawer that forgets with the process."""

    def __init__(self) -> None:
        self._keyframes: list[Keyframe] = []
        self._saved: dict[str, Mapping[str, npt.NDArray[Any]]] = {}

    def add(self, keyframe: Keyframe) -> None:
        """Remember a keyframe."""
        self._keyframes.append(keyframe)

    def keyframes(self) -> Sequence[Keyframe]:
        """Return all of them."""
        return tuple(self._keyframes)

    def save(self, name: str, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Store named arrays."""
        self._saved[name] = dict(arrays)

    def load(self, name: str) -> Mapping[str, npt.NDArray[Any]] | None:
        """Return them."""
        return self._saved.get(name)


# --- motion alone ------------------------------------------------------------------------------------------------


@dataclass
class Tracked:
    """Integrated motions, one pose per frame, and how often the track was lost."""

    poses: Poses
    n_lost: int = 0


def tracked(run: GroundRun, mode: str) -> Tracked:
    """Run ground_vo over a run."""
    localizer = GroundVO(GroundVOConfig.model_validate(CAMERA | {"mode": mode}))
    localizer.start(Session(sensors={"floor": sensor()}))
    out = Tracked([])
    pose = Pose2()
    for frame in run.frames:
        for estimate in localizer.observe(frame, Belief(frame.stamp_s)):
            if isinstance(estimate, Motion):
                pose = pose @ estimate.pose_since_now
            out.n_lost += isinstance(estimate, Lost)
        out.poses.append(pose)
    return out


def truth_of(run: GroundRun) -> Poses:
    """Return the true poses, as seen from the first."""
    first = run.truth[0][1]
    return [first.between(run.truth[index][1]) for index in range(len(run.truth))]


def odometer_m(poses: Poses, spacing_m: float = 0.05) -> float:
    """Return the way through poses that lie `spacing_m` apart: noise of single pictures is no way."""
    total, last = 0.0, poses[0]
    for pose in poses:
        step = last.distance_to(pose)
        if step >= spacing_m:
            total, last = total + step, pose
    return total + last.distance_to(poses[-1])


def straight_errors(name: str, mode: str, seed: int, metres: float) -> tuple[float, float, float, int]:
    """Return errors of position [%], odometer [%] and heading [deg/m], and how often the track was lost."""
    law = straight(SPEED_MPS, sway_m=0.003, sway_s=3.0, shake_rad=math.radians(0.05))
    run = driven(name, law, int(metres / SPEED_MPS * RATE_HZ) + 1, seed)
    ours, true = tracked(run, mode), truth_of(run)
    way_m = odometer_m(true)
    miss_m = ours.poses[-1].distance_to(true[-1])
    turn_deg = math.degrees(wrap_angle(ours.poses[-1].theta - true[-1].theta))
    return 100 * miss_m / way_m, 100 * (odometer_m(ours.poses) / way_m - 1), turn_deg / way_m, ours.n_lost


def straight_rows(floors: Sequence[str], modes: Sequence[str], seeds: Sequence[int], metres: float) -> Iterator[Row]:
    """Yield position, odometer and heading for every floor and mode: root mean square of the seeds."""
    for mode in modes:
        for name in floors:
            errors = np.array([straight_errors(name, mode, seed, metres) for seed in seeds])
            for item, unit, column in (("position", "%", 0), ("odometer", "%", 1), ("heading", "deg/m", 2)):
                bar, stretch = STRAIGHT_BARS[column]
                if name in POSITION_BARS:
                    bar, stretch = POSITION_BARS[name] if item == "position" else (math.nan, math.nan)
                has_bar = mode == "refined" and math.isfinite(bar)
                value, spread = float(np.sqrt(np.mean(errors[:, column] ** 2))), float(errors[:, column].std())
                yield _row(f"{metres:g} m straight, {name}, {mode}: {item}", unit, value, spread=spread, n=len(seeds),
                           bar=bar if has_bar else None, stretch=stretch if has_bar else None)  # fmt: skip
            yield _row(f"{metres:g} m straight, {name}, {mode}: frames lost", "", float(errors[:, 3].sum()),
                       bar=0.0 if mode != "paper" else None, n=len(seeds))  # fmt: skip


def curve_law(time_s: float) -> Pose2:
    """Return a pose on a line that winds: up to 20 px and 1.5 deg per picture."""
    step_m, pose = 20 * SCALE_M, Pose2()
    for index in range(round(time_s * RATE_HZ)):
        ease = min(1.0, index / 30)
        turn_rad = math.radians(1.5) * math.sin(2 * math.pi * index / 160)
        pose = pose @ Pose2.exp(ease * step_m, 0.0, ease * turn_rad)
    return pose


def curve_rows(floors: Sequence[str], modes: Sequence[str], seeds: Sequence[int]) -> Iterator[Row]:
    """Yield errors over 1 m of the winding line, and their geometric mean over the floors."""
    n_frames, stride = 400, round(1.0 / (20 * SCALE_M))
    winding = [curve_law(index / RATE_HZ) for index in range(n_frames)]
    for mode in modes:
        means = []
        for name in floors:
            errors = []
            for seed in seeds:
                run = driven(name, lambda time_s: winding[round(time_s * RATE_HZ)], n_frames, seed)
                ours, true = tracked(run, mode), truth_of(run)
                for first in range(30, n_frames - stride, 10):
                    moved = ours.poses[first].between(ours.poses[first + stride])
                    should = true[first].between(true[first + stride])
                    error = should.between(moved)
                    errors.append([100 * math.hypot(error.x, error.y), abs(math.degrees(error.theta))])
            mean = np.mean(errors, axis=0)
            means.append(mean)
            yield _row(f"curve, {name}, {mode}: position over 1 m", "%", float(mean[0]), n=len(errors))
            yield _row(f"curve, {name}, {mode}: heading over 1 m", "deg", float(mean[1]), n=len(errors))
        for item, unit, value in zip(("position", "heading"), ("%", "deg"), np.exp(np.log(means).mean(axis=0))):
            yield _row(f"curve, geometric mean, {mode}: {item} over 1 m", unit, float(value), n=len(floors))


# --- teach and replay --------------------------------------------------------------------------------------------


def course(metres: float) -> Callable[[float], Pose2]:
    """Return base on a course of gentle bends, radius 0.75 m at least, by the way driven."""
    step_m, poses = 0.002, [Pose2()]
    for index in range(int(metres / step_m) + 2):
        curvature = math.sin(2 * math.pi * index * step_m / 3.35) / 0.8
        poses.append(poses[-1] @ Pose2.exp(step_m, 0.0, step_m * curvature))

    def at(way_m: float) -> Pose2:
        index = min(int(way_m / step_m), len(poses) - 2)
        return poses[index].interpolate(poses[index + 1], way_m / step_m - index)

    return at


def beside(way_m: float, seed: int) -> Pose2:
    """Return how the replay deviates: 5.5 mm and 0.75 deg (1 sigma), with the way."""
    lateral = 5.5e-3 * (math.sin(way_m / 0.31 + seed) + math.sin(way_m / 0.83 + 2 * seed))
    turn = math.radians(0.75) * (math.cos(way_m / 0.31 + seed) + math.sin(way_m / 0.57 + 3 * seed))
    return Pose2(0.0, lateral, turn)


@dataclass
class Replay:
    """Every search of a replay: what it said and what was true."""

    accepted: list[tuple[float, float, float]]  # detected [m], position error after correction [m], heading [rad]
    n_rejected: int = 0
    false_m: float = 0.0
    every_frame_m: float = 0.0
    when_applied_m: float = 0.0
    n_places: int = 0

    def column(self, index: int) -> npt.NDArray[np.float64]:
        """Return one number of every accepted correction."""
        return np.array(self.accepted).reshape(-1, 3)[:, index]


class Robot:
    """ground_vo, ground_map and dead reckoning, driven over frames."""

    def __init__(self, drawer: DictDrawer, mode: str, is_teaching: bool, latency: int = 0, **keys: Any) -> None:
        motion = GroundVOConfig.model_validate(CAMERA | {"mode": "paper" if mode == "paper" else "refined"})
        paper = {"high_pass": False, "refined": False, "min_groups": 4, "max_attempts": 1} if mode == "paper" else {}
        self.motion, self.map = GroundVO(motion), GroundMap(GroundMapConfig.model_validate(CAMERA | paper | keys))
        session = Session(mode="teach" if is_teaching else "replay", sensors={"floor": sensor()}, drawer=drawer)
        self.motion.start(session)
        self.map.start(session)
        self.estimator = DeadReckoning(DeadReckoningConfig())
        self.has_applied = False
        self._latency = latency
        self._pending: list[tuple[int, Estimate]] = []

    def start_at(self, pose: Pose2) -> None:
        """Begin at a known pose."""
        self.estimator.start(Session(start_pose=pose))

    def see(self, index: int, frame: Frame) -> Sequence[Estimate]:
        """Take a frame; the answers of the map count `latency` frames later."""
        self.has_applied = False
        for due, estimate in [item for item in self._pending if item[0] <= index]:
            self.estimator.apply("map", estimate)
            self._pending.remove((due, estimate))
            self.has_applied = self.has_applied or isinstance(estimate, Fix)
        for estimate in self.motion.observe(frame, self.estimator.belief(frame.stamp_s)):
            self.estimator.apply("motion", estimate)
        said = self.map.observe(frame, self.estimator.belief(frame.stamp_s)) if not self._pending else ()
        for estimate in said:
            if self._latency:
                self._pending.append((index + self._latency, estimate))
            else:
                self.estimator.apply("map", estimate)
        return said


def taught(name: str, mode: str, metres: float, seed: int, **keys: Any) -> tuple[DictDrawer, Poses]:
    """Teach the course; returns the drawer and the true poses of its places."""
    at, drawer = course(metres), DictDrawer()
    n_frames = int(metres / SPEED_MPS * RATE_HZ)
    run = driven(name, lambda time_s: at(SPEED_MPS * time_s), n_frames, seed)
    robot = Robot(drawer, mode, is_teaching=True, **keys)
    robot.start_at(Pose2())
    for index, frame in enumerate(run.frames):
        robot.see(index, frame)
    truth = {stamp_s: run.truth[index][1] for index, stamp_s in enumerate(run.truth.stamps_s.tolist())}
    return drawer, [truth[keyframe.stamp_s] for keyframe in drawer.keyframes()]


def replayed(
    name: str, mode: str, metres: float, seed: int, drawer: DictDrawer, places: Poses, latency: int = 1,
    ground: Ground | None = None, other: str | None = None, covered: tuple[float, float] = (0.0, 0.0), **keys: Any,
) -> Replay:  # fmt: skip
    """Drive the taught course again, beside it, and compare every correction with the truth."""
    at, robot = course(metres), Robot(drawer, mode, is_teaching=False, latency=latency, **keys)
    n_frames = int(metres / SPEED_MPS * RATE_HZ)
    law = lambda time_s: at(SPEED_MPS * time_s) @ beside(SPEED_MPS * time_s, seed)  # noqa: E731
    run = driven(name, law, n_frames, seed)
    run = replace(run, frames=replace(run.frames, seed=seed + 500, ground=ground or run.frames.ground))
    cover = run.over(floor(other)).frames if other else None
    keyframes = drawer.keyframes()
    robot.start_at(keyframes[0].pose_map_base @ places[0].between(run.truth[0][1]))
    out, misses, applied = Replay([], n_places=len(keyframes)), [], []
    for index in range(n_frames):
        way_m = SPEED_MPS * index / RATE_HZ
        frame = cover[index] if cover is not None and covered[0] <= way_m < covered[1] else run.frames[index]
        said = robot.see(index, frame)
        out.n_rejected += sum(isinstance(estimate, Lost) for estimate in said)
        true = run.truth[index][1]
        for fix in (estimate for estimate in said if isinstance(estimate, Fix)):
            place = round(fix.details["place"])
            should = keyframes[place].pose_map_base @ places[place].between(true)
            error = should.between(fix.pose_map_base)
            detected_m = SCALE_M * fix.details["shift_px"]
            out.accepted.append((detected_m, math.hypot(error.x, error.y), abs(error.theta)))
            out.false_m = max(out.false_m, math.hypot(error.x, error.y))
        nearest = min(range(len(places)), key=lambda n: places[n].distance_to(true))
        should = keyframes[nearest].pose_map_base @ places[nearest].between(true)
        now = robot.estimator.belief(frame.stamp_s).pose_map_base
        assert now is not None
        misses.append(should.distance_to(now))
        if robot.has_applied:
            applied.append(misses[-1])
    out.every_frame_m, out.when_applied_m = float(np.mean(misses)), float(np.mean(applied or [math.nan]))
    return out


def course_rows(floors: Sequence[str], modes: Sequence[str], metres: float) -> Iterator[Row]:
    """Yield what the search detects and what is left, for every floor and mode."""
    for mode in modes:
        for name in floors:
            drawer, places = taught(name, mode, metres, seed=3)
            label = f"{metres:g} m course, {name}, {mode}"
            for latency in (1, 14):
                out = replayed(name, mode, metres, 3, drawer, places, latency)
                if latency == 1:
                    yield from _course_figures(label, out, mode == "refined")
                yield _row(f"{label}: left when it counts, latency {latency}, mean", "mm", 1e3 * out.when_applied_m)
                yield _row(f"{label}: error in every picture, latency {latency}, mean", "mm", 1e3 * out.every_frame_m)


def _course_figures(label: str, out: Replay, is_refined: bool) -> Iterator[Row]:
    detected, left, heading = (out.column(i) for i in range(3))
    bars = ((0.25, 0.1), (1.0, 0.5)) if is_refined else ((0.75, None), (None, None))
    n = len(detected)
    yield _row(f"{label}: places / accepted / rejected searches", "", n, n=out.n_places, spread=out.n_rejected)
    yield _row(f"{label}: detected, mean", "mm", 1e3 * detected.mean(), 0.63, 0.63, 0.2, n=n)
    yield _row(f"{label}: detected, max", "mm", 1e3 * detected.max(), 4.6, 4.6, 1.5, n=n)
    yield _row(f"{label}: left, mean", "mm", 1e3 * left.mean(), None, *bars[0], n=n)
    yield _row(f"{label}: left, p99", "mm", 1e3 * float(np.quantile(left, 0.99)), None, *bars[1], n=n)
    yield _row(f"{label}: left, max", "mm", 1e3 * left.max(), None, None if is_refined else 4.6, n=n)
    yield _row(f"{label}: heading left, mean", "deg", math.degrees(heading.mean()), n=n)


@lru_cache(maxsize=2)
def dirty(name: str, share: float, radii_px: tuple[int, int]) -> Ground:
    """Return a floor with round spots of any grey on this share of it."""
    clean, rng = floor(name), np.random.default_rng(7)
    texture, spots = clean.texture.copy(), np.zeros(clean.texture.shape, np.uint8)
    while np.mean(spots > 0) < share:
        for _ in range(50):
            centre = (int(rng.integers(texture.shape[1])), int(rng.integers(texture.shape[0])))
            cv2.circle(spots, centre, int(rng.integers(*radii_px)), int(rng.integers(1, 256)), -1)
    texture[spots > 0] = spots[spots > 0]
    return replace(clean, texture=texture)


def covered_rows(floors: Sequence[str], metres: float) -> Iterator[Row]:
    """Yield false corrections and acceptance on spoilt ground."""
    for name in floors:
        drawer, places = taught(name, "refined", metres, seed=4)
        other = "planks" if name != "planks" else "asphalt"
        middle = (metres / 2 - 0.25, metres / 2 + 0.25)
        cases: dict[str, dict[str, Any]] = {
            "clean": {},
            "0.5 m of another floor": {"other": other, "covered": middle},
            "10 % speckle": {"ground": dirty(name, 0.1, (1, 4))},
            "30 % blobs": {"ground": dirty(name, 0.3, (20, 60))},
        }
        for label, how in cases.items():
            out = replayed(name, "refined", metres, 4, drawer, places, 1, **how)
            wrong = int(np.count_nonzero(out.column(1) > 5e-3))
            item = f"covered, {name}, {label}"
            yield _row(f"{item}: false corrections > 5 mm", "", float(wrong), bar=0.0, n=len(out.accepted))
            share = 100 * len(out.accepted) / (out.n_places - (10 if "another" in label else 0))
            bars = {"clean": (95.0, 99.0), "10 % speckle": (70.0, 90.0)}.get(label, (None, None))
            yield _row(f"{item}: places accepted", "%", min(share, 100.0), None, *bars, better="higher", n=out.n_places)


def _row(
    item: str, unit: str, ours: float, paper: float | None = None, bar: float | None = None,
    stretch: float | None = None, *, better: Any = "lower", n: int = 1, spread: float | None = None,
) -> Row:  # fmt: skip
    return Row("ground accuracy", item, unit, float(ours), paper, bar, stretch, spread, better, n)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--what", nargs="+", default=["straight"], choices=["straight", "curve", "course", "covered"])
    parser.add_argument("--floors", nargs="+", default=None)
    parser.add_argument("--modes", nargs="+", default=["refined"], choices=["refined", "pyramid", "paper"])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--metres", type=float, default=None, help="way of the straight line or the course")
    parser.add_argument("--quick", action="store_true", help="one metre, one seed, two floors")
    parser.add_argument("--json", action="store_true", help="a list of rows")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    rows = []
    for row in measure(options):
        rows.append(row)
        if not options.json:
            bar = "" if row.bar is None else f"bar {row.bar:g}  {'met' if row.met else 'NOT MET'}"
            print(f"{row.item:82}{row.ours:10.4f} {row.unit:8}{bar:20} n={row.n}", flush=True)
    if options.json:
        print(json.dumps([row.document() for row in rows], indent=2))


def measure(options: argparse.Namespace) -> Iterator[Row]:
    """Yield the rows that were asked for."""
    seeds = [options.first_seed + i for i in range(1 if options.quick else options.seeds)]
    floors = options.floors or (FLOORS[:2] if options.quick else FLOORS)
    places = options.floors or (COURSE_FLOORS[:1] if options.quick else COURSE_FLOORS)
    short = 1.0 if options.quick else None
    if "straight" in options.what:
        yield from straight_rows(floors, options.modes, seeds, options.metres or short or 10.0)
    if "curve" in options.what:
        yield from curve_rows(floors, options.modes, seeds)
    if "course" in options.what:
        yield from course_rows(places, options.modes, options.metres or short or 13.4)
    if "covered" in options.what:
        yield from covered_rows(places, options.metres or short or 2.0)


if __name__ == "__main__":
    main()
