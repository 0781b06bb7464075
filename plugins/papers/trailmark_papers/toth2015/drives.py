"""Drives through simulated rooms: several localizers see the same pictures, beside the exact truth."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.estimates import Belief, Estimate, Fix, Lost, Motion
from trailmark.experiments import Row
from trailmark.frames import RGBD, Frame
from trailmark.geometry import Pose2
from trailmark.interfaces import FrameSource, Localizer, Session

__all__ = ["FLOW", "LANDMARKS", "ORB", "Driven", "Outcome", "Plan", "drive", "error_rows", "rms", "seeds_of"]

Floats = npt.NDArray[np.float64]
Method = Mapping[str, Any]

#: Everything on, whatever it costs: what is timed is what is named.
LANDMARKS: Method = {"plugin": "kinect_landmarks", "light": "light", "solve": "plane", "adapt": False}
#: The paper's second mode.
FLOW: Method = {"plugin": "kinect_flow", "solve": "plane"}
#: What people would use instead.
ORB: Method = {"plugin": "orb_rgbd", "far_m": 6.0}

_CAMERA = "rgbd"


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
        Localizers by the name in the rows; their keys as in a config.
    options : mapping
        Of the world.
    route, speed_mps, length_m : str, float, float
        Where, how fast and how far [m/s, m].
    rate_hz : float
        Of the camera [Hz].
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


@dataclass(frozen=True)
class Outcome:
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
    outcomes: Mapping[str, Outcome]


def seeds_of(first: int, n: int) -> list[int]:
    """Return seeds that follow from the first."""
    return [first + i for i in range(n)]


def drive(plan: Plan) -> Driven:
    """Drive, and let every localizer look at every picture."""
    import cv2

    cv2.setNumThreads(1)
    source = _source(plan)
    watchers = {name: _Watcher(source, method, plan.seed) for name, method in plan.methods.items()}
    stamps_s = []
    for frame in source.frames():
        if isinstance(frame.payload, RGBD):
            stamps_s.append(frame.stamp_s)
        for watcher in watchers.values():
            watcher.see(frame)
    truth = source.ground_truth()
    assert truth is not None
    start = Pose2.from_array(truth.poses[0])
    true = {stamp_s: start.between(pose) for stamp_s, pose in truth.at(np.array(stamps_s))}
    source.close()
    return Driven(plan, {name: watcher.outcome(true) for name, watcher in watchers.items()})


def _source(plan: Plan) -> FrameSource:
    from trailmark.api import create

    source: FrameSource = create(
        "source",
        "sim",
        world=plan.world,
        route=plan.route,
        speed_mps=plan.speed_mps,
        duration_s=plan.length_m / plan.speed_mps + 0.5 / plan.rate_hz,
        sensors=["light", _CAMERA],
        rates_hz={_CAMERA: plan.rate_hz},
        options={"registered": True, **plan.options},
        vehicle={"kind": "skid_steer", "max_speed_mps": max(plan.speed_mps, 0.3)},
        threads=1,
    )
    source.start(Session(name="robot", rng=np.random.default_rng(plan.seed)))
    return source


class _Watcher:
    """One localizer and what it said."""

    def __init__(self, source: FrameSource, method: Method, seed: int) -> None:
        from trailmark.api import create

        keys = {key: value for key, value in method.items() if key != "plugin"}
        self._localizer: Localizer = create("localizer", method["plugin"], camera=_CAMERA, **keys)
        self._sensors = {_CAMERA, keys.get("light"), keys.get("scan")}
        self._localizer.start(
            Session(sensors=source.sensors, start_pose=Pose2(), rng=np.random.default_rng(seed), mode="track")
        )
        self._pose = Pose2()
        self._poses: list[tuple[float, Pose2]] = []
        self._times_ms: list[float] = []
        self._n_agree: list[float] = []

    def see(self, frame: Frame) -> None:
        if frame.sensor not in self._sensors:
            return
        began_ns = time.thread_time_ns()
        answers = self._localizer.observe(frame, Belief(frame.stamp_s, self._pose))
        if isinstance(frame.payload, RGBD):
            self._times_ms.append((time.thread_time_ns() - began_ns) / 1e6)
        for answer in answers:
            self._take(answer)

    def _take(self, answer: Estimate) -> None:
        if isinstance(answer, Lost) or not isinstance(answer, Fix | Motion):
            return
        self._pose = answer.pose_map_base if isinstance(answer, Fix) else self._pose @ answer.pose_since_now
        self._poses.append((answer.stamp_s, self._pose))
        self._n_agree.append(answer.details.get("n_agree", math.nan))

    def outcome(self, true: Mapping[float, Pose2]) -> Outcome:
        misses = [true[stamp_s].between(pose) for stamp_s, pose in self._poses]
        errors = np.array([miss.array() for miss in misses]).reshape(-1, 3)
        n_agree = float(np.mean(self._n_agree)) if self._n_agree else math.nan
        stamps_s = np.array([stamp_s for stamp_s, _ in self._poses])
        return Outcome(stamps_s, errors, len(self._times_ms) - 1, np.array(self._times_ms[1:]), n_agree)


def rms(values: Floats) -> float:
    """Return the root mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else math.nan


def error_rows(name: str, method: str, outcomes: Sequence[Outcome], is_ours: bool) -> list[Row]:
    """Return pose share, position and heading errors of one method over seeds; bars where it is ours."""
    position = [rms(outcome.position_m) for outcome in outcomes]
    heading = [math.degrees(rms(outcome.errors[:, 2])) for outcome in outcomes]
    count: dict[str, Any] = {"n": sum(len(outcome.errors) for outcome in outcomes), "seeds": len(outcomes)}
    bars: list[dict[str, Any]] = [{"bar": 90.0, "stretch": 98.0}, {"bar": 0.03, "stretch": 0.01}]
    bars = [*bars, {"bar": 1.0, "stretch": 0.3}] if is_ours else [{}, {}, {}]
    share = float(np.mean([outcome.pose_percent for outcome in outcomes]))
    return [
        Row(name, f"{method}: pictures with a pose", "%", share, better="higher", **bars[0], **count),
        Row(name, f"{method}: position, rms", "m", float(np.mean(position)), spread=_std(position), **bars[1], **count),
        Row(name, f"{method}: heading, rms", "deg", float(np.mean(heading)), spread=_std(heading), **bars[2], **count),
    ]


def _std(values: Sequence[float]) -> float | None:
    return float(np.std(values)) if len(values) > 1 else None
