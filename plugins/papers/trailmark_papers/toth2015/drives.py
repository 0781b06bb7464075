"""Drives through simulated rooms: several localizers see the same pictures, beside the exact truth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Belief, Estimate, Fix, Motion
from trailmark.frames import RGBD, Frame, Scalar
from trailmark.geometry import Pose2
from trailmark.interfaces import FrameSource, Localizer, Session
from trailmark_papers.kit import Table, Watcher, observe_timed, rms, show, sim_source, spread_of, started_source

__all__ = [
    "CROP",
    "FAITHFUL",
    "FAITHFUL_FLOW",
    "FLOW",
    "LANDMARKS",
    "ORB",
    "TWO_AND_RESERVE",
    "TWO_NAME",
    "UNREGISTERED",
    "DriveOutcome",
    "Driven",
    "Plan",
    "covered",
    "drive",
    "error_rows",
]

Method = Mapping[str, Any]

#: Everything on, whatever it costs: what is timed is what is named.
LANDMARKS: Method = {"plugin": "kinect_landmarks", "light": "light", "solve": "plane", "adapt": False}
#: "Only two landmarks are enough", and "another one for reserve"; all else as it is.
TWO_NAME = "two landmarks, one in reserve"
TWO_AND_RESERVE: Method = {**LANDMARKS, "landmarks": 3, "min_landmarks": 2}
#: The paper's second mode.
FLOW: Method = {"plugin": "kinect_flow", "solve": "plane"}
#: A depth camera beside the colour camera, as the paper's: nobody has brought one onto the other.
UNREGISTERED: Mapping[str, Any] = {"registered": False}
#: What the simulated depth camera (585 px) does not see of the colour picture (525 px), without regard to the 25 mm
#: between them: ``(640 - 640 * 525 / 585) / 2`` columns at each side, rows alike; the calibration of Eqs. 3 to 6.
CROP = {"left": 33, "right": 33, "top": 25, "bottom": 25}
#: Both modes as printed, on such a camera.
FAITHFUL: Method = {"plugin": "kinect_landmarks", "light": "light", "preset": "paper", "crop": CROP}
FAITHFUL_FLOW: Method = {"plugin": "kinect_flow", "preset": "paper", "crop": CROP}
#: What people would use instead.
ORB: Method = {"plugin": "orb_rgbd", "far_m": 6.0}

_CAMERA = "rgbd"
_BLACK = 8  # grey level of something dark
#: What is asked of positions, and what would be better still [m]; few landmarks are asked for less.
_POSITION_M, _POSITION_OF_FEW_M = (0.03, 0.01), (0.05, 0.02)


@dataclass(frozen=True)
class Plan:
    """One drive.

    Attributes
    ----------
    name : str
        By which its rows find it.
    world : str
        Of the simulator.
    seed : int
        Of noise, people, and of what the localizers draw.
    methods : mapping of str to mapping
        Localizers by the name in the rows; their keys as in a config, and ``light: same`` for a sensor of light that
        says the same whatever happens: nothing is made up for then.
    options : mapping
        Of the world.
    route, speed_mps, length_m : str, float, float
        Where, how fast and how far [m/s, m].
    rate_hz : float
        Of the camera [Hz].
    world_seed : int
        Which of the worlds of that kind.
    covered_s : float or None
        From then on half of every picture is black and has no depth [s]; None: never.
    """

    name: str
    world: str
    seed: int
    methods: Mapping[str, Method]
    options: Mapping[str, Any] = field(default_factory=dict)
    route: str = "straight"
    speed_mps: float = 0.3
    length_m: float = 3.0
    rate_hz: float = 10.0
    world_seed: int = 1
    covered_s: float | None = None


@dataclass(frozen=True)
class DriveOutcome:
    """What one localizer did.

    Attributes
    ----------
    stamps_s : (N,) float64
        Of its poses [s].
    errors : (N, 3) float64
        Ahead, left and turn of each pose from the truth, both from the start [m, m, rad].
    n_pictures : int
        Pictures after the first, which begins.
    times_ms : (M,) float64
        Thread CPU time of every call after the first [ms].
    n_agree : float
        Mean number of landmarks, points or features that agreed.
    """

    stamps_s: Floats
    errors: Floats
    n_pictures: int
    times_ms: Floats
    n_agree: float

    @property
    def pose_percent(self) -> float:
        """Share of the pictures with a pose."""
        return 100.0 * len(self.errors) / max(self.n_pictures, 1)

    @property
    def position_m(self) -> Floats:
        """Distances from the truth, (N,) [m]."""
        return np.hypot(self.errors[:, 0], self.errors[:, 1])

    @property
    def jump_m(self) -> float:
        """Largest change of the position error from one pose to the next [m]."""
        steps = np.diff(self.errors[:, :2], axis=0)
        return float(np.hypot(*steps.T).max()) if len(steps) else math.nan


@dataclass(frozen=True)
class Driven:
    """A plan and what its localizers did."""

    plan: Plan
    outcomes: Mapping[str, DriveOutcome]


def drive(plan: Plan) -> Driven:
    """Drive, and let every localizer look at every picture."""
    import cv2

    cv2.setNumThreads(1)
    with started_source(_source(plan), plan.seed) as source:
        watchers = {name: _LocalizerDrive(source, method, plan) for name, method in plan.methods.items()}
        truth = show(source, watchers.values(), RGBD)
        ways = source.ground_truth()
    assert ways is not None
    start = Pose2.from_array(ways.poses[0])
    true = {stamp_s: start.between(pose) for stamp_s, pose in truth}
    return Driven(plan, {name: watcher.outcome(true) for name, watcher in watchers.items()})


def covered(frame: Frame) -> Frame:
    """Return a picture of which the left half is black, as by a thing close before the camera: too near for depth."""
    if not isinstance(frame.payload, RGBD):
        return frame
    bgr, depth_m = frame.payload.bgr.copy(), frame.payload.depth_m.copy()
    half = bgr.shape[1] // 2
    bgr[:, :half], depth_m[:, :half] = _BLACK, np.nan
    return replace(frame, payload=RGBD(bgr, depth_m))


def _source(plan: Plan) -> dict[str, Any]:
    return sim_source(
        plan.world,
        route=plan.route,
        world_seed=plan.world_seed,
        speed_mps=plan.speed_mps,
        duration_s=plan.length_m / plan.speed_mps + 0.5 / plan.rate_hz,
        sensors=["light", _CAMERA],
        rates_hz={_CAMERA: plan.rate_hz},
        options={"registered": True, **plan.options},
        vehicle={"kind": "skid_steer", "max_speed_mps": max(plan.speed_mps, 0.3)},
        threads=1,
    )


class _LocalizerDrive(Watcher):
    """One localizer that believes itself alone, and what it said."""

    def __init__(self, source: FrameSource, method: Method, plan: Plan) -> None:
        from trailmark.api import create

        self._covered_s = math.inf if plan.covered_s is None else plan.covered_s
        self._is_same_light = method.get("light") == "same"
        keys = {key: value for key, value in method.items() if key != "plugin"}
        keys |= {"light": "light"} if self._is_same_light else {}
        self._localizer: Localizer = create("localizer", method["plugin"], camera=_CAMERA, **keys)
        self._sensors = {_CAMERA, keys.get("light"), keys.get("scan")}
        self._localizer.start(
            Session(
                sensors=source.sensors,
                start_pose=Pose2(),
                rng=np.random.default_rng(plan.seed),
                mode="track",
                # As a run in step pace: by the localizer's own model, so that what it chooses does not hang on the
                # machine.
                last_latency_s=lambda: self._localizer.latency_s() or 0.0,
            )
        )
        self._pose = Pose2()
        self._poses: list[tuple[float, Pose2]] = []
        self._times_ms: list[float] = []
        self._n_agree: list[float] = []

    def see(self, frame: Frame) -> None:
        """Answer a frame of one of its sensors."""
        if frame.sensor not in self._sensors:
            return
        if self._is_same_light and isinstance(frame.payload, Scalar):
            frame = replace(frame, payload=Scalar(1.0))
        if frame.stamp_s >= self._covered_s:
            frame = covered(frame)
        answers, took_ms = observe_timed(self._localizer, frame, Belief(frame.stamp_s, self._pose))
        if isinstance(frame.payload, RGBD):
            self._times_ms.append(took_ms)
        for answer in answers:
            self._take(answer)

    def _take(self, answer: Estimate) -> None:
        if not isinstance(answer, Fix | Motion):
            return
        self._pose = answer.pose_map_base if isinstance(answer, Fix) else self._pose @ answer.pose_since_now
        self._poses.append((answer.stamp_s, self._pose))
        self._n_agree.append(answer.details.get("n_agree", math.nan))

    def outcome(self, true: Mapping[float, Pose2]) -> DriveOutcome:
        """Return what it did, beside the true poses from the start, by stamp."""
        misses = [true[stamp_s].between(pose) for stamp_s, pose in self._poses]
        errors = np.array([miss.array() for miss in misses]).reshape(-1, 3)
        n_agree = float(np.mean(self._n_agree)) if self._n_agree else math.nan
        stamps_s = np.array([stamp_s for stamp_s, _ in self._poses])
        return DriveOutcome(stamps_s, errors, len(self._times_ms) - 1, np.array(self._times_ms[1:]), n_agree)


def error_rows(name: str, method: str, outcomes: Sequence[DriveOutcome], is_judged: bool) -> Table:
    """Return pose share, position and heading errors of one method over seeds; bars where it is judged."""
    position = [rms(outcome.position_m) for outcome in outcomes]
    heading = [math.degrees(rms(outcome.errors[:, 2])) for outcome in outcomes]
    table = Table(name, sum(len(outcome.errors) for outcome in outcomes), len(outcomes))
    position_m = _POSITION_OF_FEW_M if method == TWO_NAME else _POSITION_M
    share, near, straight = (
        {"bar": bar, "stretch": stretch} if is_judged else {} for bar, stretch in ((90.0, 98.0), position_m, (1.0, 0.3))
    )
    percent = float(np.mean([outcome.pose_percent for outcome in outcomes]))
    table.add_higher(f"{method}: pictures with a pose", "%", percent, **share)
    table.add(f"{method}: position, rms", "m", float(np.mean(position)), spread=spread_of(position), **near)
    table.add(f"{method}: heading, rms", "deg", float(np.mean(heading)), spread=spread_of(heading), **straight)
    return table
