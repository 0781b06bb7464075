"""Localizers of an RGB-D camera where the world is unkind: errors, answers, and what their covariances promise.

    python benchmarks/kinect_honest.py [--places 3 4 5 6 7] [--seeds 0 1] [--conditions straight ...] [--json]

Every condition shows the same pictures to all methods, each of which believes itself alone. The lab and the hallway are
simulated (0.3 m/s, 10 pictures a second); `CHOSEN_ON` are the places that constants were chosen on, the others are what
is reported. The last condition is a real recording, which is not shipped (``TRAILMARK_DATA``).

* rms, largest: distance from the truth, both from the start of the drive [m];
* answered: share of the pictures but the first with an estimate;
* NEES: mean of squared error by stated covariance, per degree of freedom: of fixes as they are, of motions one by one;
* silent: share of the answers that are wrong by more than 5 of their own sigmas and more than a floor (20 mm or 1 deg
  for fixes, 0.5 mm or 0.05 deg for motions), the largest of single answers, and of motions over 1 s and 1 m.
"""

from __future__ import annotations

import argparse
import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import trailmark
from trailmark.arrays import Floats
from trailmark.estimates import Belief, Estimate, Fix, Motion
from trailmark.evaluation.chaining import chain_windows, windows
from trailmark.evaluation.relative import between
from trailmark.evaluation.silent import FLOORS, are_silently_wrong
from trailmark.frames import RGBD, DepthCamera, Frame, Image, Scalar, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, Session
from trailmark_papers.kit import Watcher, show, sim_source, started_source

#: Places that constants were chosen on; the others are what is reported.
CHOSEN_ON, REPORTED = (1, 2), (3, 4, 5, 6, 7)
WORLDS = ("lab", "hallway")
CAMERA, LIGHT = "rgbd", "light"
SPEED_MPS = 0.3
SEQUENCE = "fr1_rpy_0_5s"

LANDMARKS: Mapping[str, Any] = {"plugin": "kinect_landmarks", "camera": CAMERA, "light": LIGHT}
METHODS: Mapping[str, Mapping[str, Any]] = {
    "kinect_landmarks": LANDMARKS,
    "two + one in reserve": {**LANDMARKS, "solve": "plane", "landmarks": 3, "min_landmarks": 2},
    "kinect_flow": {"plugin": "kinect_flow", "camera": CAMERA},
    "orb_rgbd": {"plugin": "orb_rgbd", "camera": CAMERA},
}


@dataclass(frozen=True)
class Condition:
    """What a drive meets.

    Attributes
    ----------
    options : mapping
        Of the simulated world.
    length_m : float
        Of the drive [m].
    is_registered : bool
        False: depth is that of a camera 25 mm beside, of another lens, and the calibration says that it is the colour
        camera's.
    rate_hz : float
        Pictures a second [Hz].
    """

    options: Mapping[str, Any]
    length_m: float = 3.0
    is_registered: bool = True
    rate_hz: float = 10.0


CONDITIONS: Mapping[str, Condition] = {
    "straight": Condition({"registered": True}),
    "a box is carried past": Condition({"registered": True, "crate": "walks_off", "crate_s": 2.0}, 1.8),
    "carried past, 30 pictures a second": Condition(
        {"registered": True, "crate": "walks_off", "crate_s": 2.0}, 1.8, rate_hz=30.0
    ),
    "not registered": Condition({"registered": False}, is_registered=False),
}
REAL = "fr1_rpy"


@dataclass(frozen=True)
class Scene:
    """Pictures of a drive, and the true poses from its start, by stamp."""

    frames: Sequence[Frame]
    sensors: Mapping[str, SensorInfo]
    true: Mapping[float, Pose2]


@dataclass(frozen=True)
class Told:
    """What a localizer said of a drive, judged.

    Attributes
    ----------
    position_m, heading_rad : (N,) float64
        Of the pose after each answer, from the truth [m, rad].
    nees : (N,) float64
        Of each answer, per degree of freedom.
    n_silent, n_judged : (3,) float64
        Answers that are silently wrong, and all: one by one, over 1 s, over 1 m.
    answered : float
        Share of the pictures.
    """

    position_m: Floats
    heading_rad: Floats
    nees: Floats
    n_silent: Floats
    n_judged: Floats
    answered: float


class _Keeper(Watcher):
    def __init__(self) -> None:
        self.frames: list[Frame] = []

    def see(self, frame: Frame) -> None:
        """Keep a frame."""
        if isinstance(frame.payload, RGBD | Scalar | Image):
            self.frames.append(frame)


def render(condition: Condition, world: str, place: int, seed: int) -> Scene:
    """Drive straight ahead through a place."""
    config = sim_source(
        world,
        route="straight",
        world_seed=place,
        speed_mps=SPEED_MPS,
        duration_s=condition.length_m / SPEED_MPS + 0.5 / condition.rate_hz,
        sensors=[LIGHT, CAMERA],
        rates_hz={CAMERA: condition.rate_hz},
        options=condition.options,
        vehicle={"kind": "skid_steer", "max_speed_mps": SPEED_MPS},
        threads=1,
    )
    with started_source(config, seed) as source:
        keeper = _Keeper()
        truth = show(source, [keeper], RGBD)
        sensors = dict(source.sensors)
        ways = source.ground_truth()
    assert ways is not None
    start = Pose2.from_array(ways.poses[0])
    if not condition.is_registered:
        colour = sensors[CAMERA].calibration
        assert isinstance(colour, DepthCamera)
        sensors[CAMERA] = replace(sensors[CAMERA], calibration=DepthCamera(colour.colour, depth_kind="z"))
    return Scene(keeper.frames, sensors, {stamp_s: start.between(pose) for stamp_s, pose in truth})


def recording() -> Scene | None:
    """Return the hand-held recording; None where it is missing."""
    shared = Path(__file__).parents[2] / "shared" / "data"
    folder = Path(os.environ.get("TRAILMARK_DATA", shared)) / "rgbd" / SEQUENCE
    if not folder.is_dir():
        return None
    source = trailmark.create("source", "tum_rgbd", path=folder)
    source.start(Session(name=CAMERA))
    frames = list(source.frames())
    truth = source.ground_truth().at(np.array([frame.stamp_s for frame in frames]))
    poses = list(truth)
    start = poses[0][1]
    return Scene(frames, dict(source.sensors), {stamp_s: start.between(pose) for stamp_s, pose in poses})


def play(method: Mapping[str, Any], scene: Scene, seed: int) -> Told:
    """Show all pictures to a localizer, and judge what it says."""
    keys = {key: value for key, value in method.items() if key != "plugin"}
    if LIGHT not in scene.sensors:
        keys.pop("light", None)
    localizer: Localizer = trailmark.create("localizer", method["plugin"], **keys)
    localizer.start(Session(sensors=scene.sensors, start_pose=Pose2(), rng=np.random.default_rng(seed), mode="track"))
    pose, told, stamps_s, n_pictures = Pose2(), [], [], -1
    errors = []
    listens = {CAMERA, keys.get("light")}
    for frame in scene.frames:
        if frame.sensor not in listens:
            continue
        n_pictures += isinstance(frame.payload, RGBD)
        for answer in localizer.observe(frame, Belief(frame.stamp_s, pose)):
            if isinstance(answer, Fix | Motion):
                pose = answer.pose_map_base if isinstance(answer, Fix) else pose @ answer.pose_since_now
                told.append(answer)
                stamps_s.append(answer.stamp_s)
                errors.append(scene.true[answer.stamp_s].between(pose).array())
    localizer.close()
    return judge(told, np.array(errors).reshape(-1, 3), scene, max(n_pictures, 1))


def judge(told: Sequence[Estimate], errors: Floats, scene: Scene, n_pictures: int) -> Told:
    """Return errors, NEES and what is silently wrong."""
    kind = "motion" if told and isinstance(told[0], Motion) else "fix"
    covariances = np.array([np.linalg.inv(answer.information) for answer in told]).reshape(-1, 3, 3)
    own = np.array([_miss(answer, scene) for answer in told]).reshape(-1, 3)
    nees = np.array([e @ np.linalg.solve(C, e) / 3.0 for e, C in zip(own, covariances)])
    wrong = are_silently_wrong(own, covariances, FLOORS[kind]) if len(own) else np.zeros(0, bool)
    n_silent, n_judged = np.zeros(3), np.zeros(3)
    n_silent[0], n_judged[0] = wrong.sum(), len(wrong)
    motions = [answer for answer in told if isinstance(answer, Motion)]
    if motions:
        since_s, stamp_s = (np.array([getattr(m, name) for m in motions]) for name in ("since_s", "stamp_s"))
        before, now = (np.array([scene.true[s].array() for s in stamps]) for stamps in (since_s, stamp_s))
        moved = np.array([m.pose_since_now.array() for m in motions])
        ways = stamp_s - since_s, np.linalg.norm(now[:, :2] - before[:, :2], axis=1)
        for row, way in enumerate(ways, 1):
            pieces = list(windows(since_s, stamp_s, way, 1.0))
            chained, spreads, first, last = chain_windows(moved, covariances, pieces)
            if len(chained):
                off = chained - between(before[first], now[last])
                n_silent[row] = are_silently_wrong(off, spreads, FLOORS["motion"]).sum()
                n_judged[row] = len(chained)
    position_m = np.hypot(errors[:, 0], errors[:, 1])
    return Told(position_m, errors[:, 2], nees, n_silent, n_judged, len(told) / n_pictures)


def _miss(answer: Estimate, scene: Scene) -> Floats:
    """Return by how much an estimate is off, in the axes of its covariance."""
    if isinstance(answer, Fix):
        told, true = answer.pose_map_base.array(), scene.true[answer.stamp_s].array()
    else:
        assert isinstance(answer, Motion)
        told = answer.pose_since_now.array()
        true = scene.true[answer.since_s].between(scene.true[answer.stamp_s]).array()
    off = told - true
    off[2] = math.remainder(off[2], math.tau)
    return np.asarray(off)


def scenes(condition: str, places: Iterable[int], seeds: Iterable[int]) -> Iterator[tuple[str, int, Scene]]:
    """Yield the drives of a condition with a name and a seed."""
    if condition == REAL:
        scene = recording()
        if scene is not None:
            yield from ((REAL, seed, scene) for seed in seeds)
        return
    for world in WORLDS:
        for place in places:
            for seed in seeds:
                yield f"{world} {place}", seed, render(CONDITIONS[condition], world, place, seed)


def row_of(condition: str, method: str, told: Sequence[Told]) -> dict[str, Any]:
    """Return the figures of one method in one condition."""
    position_m, heading, nees = (
        np.concatenate([getattr(one, name) for one in told]) for name in ("position_m", "heading_rad", "nees")
    )
    n_silent, n_judged = (np.sum([getattr(one, name) for one in told], axis=0) for name in ("n_silent", "n_judged"))
    if not len(position_m):
        position_m = heading = nees = np.full(1, np.nan)
    return {
        "condition": condition,
        "method": method,
        "drives": len(told),
        "answered": float(np.mean([one.answered for one in told])),
        "least_answered": float(min(one.answered for one in told)),
        "rms_m": float(np.sqrt(np.mean(position_m**2))),
        "largest_m": float(position_m.max()),
        "rms_deg": float(np.degrees(np.sqrt(np.mean(heading**2)))),
        "nees": float(nees.mean()),
        "nees_median": float(np.median(nees)),
        "silent": float(np.max(np.where(n_judged > 0, n_silent / np.maximum(n_judged, 1), 0.0))),
    }


def measure(
    condition: str, methods: Sequence[str], places: Sequence[int], seeds: Sequence[int]
) -> list[dict[str, Any]]:
    """Return the rows of one condition."""
    told: dict[str, list[Told]] = {method: [] for method in methods}
    for _name, seed, scene in scenes(condition, places, seeds):
        for method in methods:
            told[method].append(play(METHODS[method], scene, seed))
    return [row_of(condition, method, some) for method, some in told.items() if some]


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows as a table in Markdown."""
    columns = (
        "condition",
        "method",
        "drives",
        "answered",
        "least",
        "rms [m]",
        "largest [m]",
        "rms [deg]",
        *_NEES,
        "silent",
    )
    lines = [f"| {' | '.join(columns)} |", "|---|---|" + "--:|" * (len(columns) - 2)]
    lines += [f"| {' | '.join(_cells(row))} |" for row in rows]
    return "\n".join(lines)


_NEES = "NEES", "median NEES"


def _cells(row: Mapping[str, Any]) -> list[str]:
    shares = [f"{100 * row[name]:.0f} %" for name in ("answered", "least_answered")]
    errors = [f"{row['rms_m']:.4f}", f"{row['largest_m']:.3f}", f"{row['rms_deg']:.3f}"]
    nees = [f"{row[name]:.2f}" for name in ("nees", "nees_median")]
    return [
        row["condition"],
        row["method"],
        str(row["drives"]),
        *shares,
        *errors,
        *nees,
        f"{100 * row['silent']:.1f} %",
    ]


def main() -> None:
    """Measure, and print a table or JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--places", type=int, nargs="+", default=list(REPORTED), help="simulated places")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--conditions", nargs="+", default=[*CONDITIONS, REAL], choices=[*CONDITIONS, REAL])
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=list(METHODS))
    parser.add_argument("--json", action="store_true", help="print rows as JSON")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    rows = []
    for condition in options.conditions:
        rows += measure(condition, options.methods, options.places, options.seeds)
    print(json.dumps(rows, indent=1) if options.json else table(rows))


if __name__ == "__main__":
    main()
