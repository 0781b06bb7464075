"""A plugin of one file: a part of every kind, each of whose methods may be told to misbehave."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

import trailmark
from trailmark.commands import Command, Stop, Velocity
from trailmark.config import PluginConfig, Sensor, SourceConfig
from trailmark.estimates import Applied, Belief, Estimate, EstimateRecord, Fix, Lost, Motion
from trailmark.estimation.dead_reckoning import DeadReckoning
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.frames import Frame, Scalar, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Controller, Drivable, Fault, Localizer, LocalizerMap, PathStore, RunEnd, Session, Sink
from trailmark.paths import Keyframe, Path, Waypoint

N_FRAMES = 12

#: What has happened: "source start", "sink close" ...
LOG: list[str] = []


class NoException(BaseException):
    """What a plugin may derive from by mistake."""


class Speechless(Exception):
    """An exception that cannot even say what it is."""

    def __str__(self) -> str:
        raise RuntimeError("no words")


def endless() -> int:
    """Call itself for ever."""
    return endless() + 1


def raising(error: type[BaseException], *words: object) -> Callable[[], Any]:
    """Return what raises an exception."""

    def misdeed() -> Any:
        raise error(*words)

    return misdeed


#: What a method may do instead of its work.
RAISES: dict[str, Callable[[], Any]] = {
    "error": raising(ValueError, "no texture"),
    "no words": raising(RuntimeError),
    "no str": raising(Speechless),
    "exit": raising(SystemExit, 0),
    "exit 3": raising(SystemExit, 3),
    "interrupt": raising(KeyboardInterrupt),
    "cancelled": raising(asyncio.CancelledError),
    "generator": raising(GeneratorExit),
    "stop": raising(StopIteration),
    "base": raising(NoException, "mine"),
    "plain": raising(trailmark.errors.TrailmarkError),
    "shape": raising(trailmark.errors.ShapeError, "information is of real numbers"),
    "endless": endless,
    "disk full": raising(OSError, errno.ENOSPC, "No space left on device"),
}


def wait() -> None:
    """Wait for what never comes."""
    threading.Event().wait(30.0)


def spin() -> None:
    """Work for ever, catching what it can."""
    until_s = time.monotonic() + 30.0
    while time.monotonic() < until_s:
        with contextlib.suppress(Exception):
            sum(range(1000))


#: What a method may do instead of coming back.
HANGS: dict[str, Callable[[], Any]] = {"wait": wait, "spin": spin}

#: What a method may answer instead of what it should.
ANSWERS: dict[str, Callable[[], Any]] = {
    "none": lambda: None,
    "object": object,
    "text": lambda: "three",
    "list": lambda: [object()],
    "counts": lambda: {"x": float("nan"), 3: "y"},
    "class": lambda: Fix,
    "complex": lambda: [Fix(0.0, Pose2(), np.eye(3) * 1j)],
    "complex belief": lambda: Belief(0.0, Pose2(), np.eye(3) * 1j),
    "far belief": lambda: Belief(0.0, Pose2(1e300)),
    "mute": lambda: [Lost(0.0, 3)],
    "bare": lambda: [Lost(0.0, "dark", [1.0])],
    "many": lambda: [Fix(0.0, Pose2(), np.eye(3))] * 200_000,
}


class WickedConfig(PluginConfig):
    """Which method misbehaves, and how; none: the part is good."""

    method: str = ""
    deed: str = ""
    at: int = 1
    """From which call of the method on it misbehaves."""


class WickedSourceConfig(SourceConfig):
    """The same, of a source."""

    method: str = ""
    deed: str = ""
    at: int = 1
    """From which call of the method on it misbehaves."""


class Wicked:
    """What all the parts below have in common."""

    kind = ""
    config: WickedConfig | WickedSourceConfig

    def act(self, method: str, good: Any = None) -> Any:
        """Return what the method should return, unless it is the one that misbehaves."""
        LOG.append(f"{self.kind} {method}")
        if self.config.method != method:
            return good
        self._n_calls = getattr(self, "_n_calls", 0) + 1
        if self._n_calls < self.config.at:
            return good
        return (RAISES | ANSWERS | HANGS)[self.config.deed]()

    def start(self, session: Session) -> None:
        self.act("start")

    def close(self) -> None:
        self.act("close")

    def counters(self) -> Mapping[str, int]:
        counts: Mapping[str, int] = self.act("counters", {"lost": 3})
        return counts


class WickedSource(Wicked, Drivable):
    """A robot on a line; it says how far it has come."""

    kind = "source"

    def __init__(self, config: WickedSourceConfig) -> None:
        super().__init__(config)
        self.act("__init__")
        self._x, self._speed = 0.0, 0.0

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        sensors: Mapping[str, SensorInfo] = self.act("sensors", {"robot": SensorInfo("robot", "scalar")})
        return sensors

    @property
    def accepts(self) -> frozenset[type[Command]]:
        accepted: frozenset[type[Command]] = self.act("accepts", frozenset({Velocity, Stop}))
        return accepted

    def drive(self, command: Command) -> None:
        self.act("drive")
        self._speed = command.forward_mps if isinstance(command, Velocity) else 0.0

    def frames(self) -> Iterator[Frame]:
        frames: Iterator[Frame] = self.act("frames", self._frames())
        return frames

    def _frames(self) -> Iterator[Frame]:
        for index in range(N_FRAMES):
            frame = Frame("robot", index / 10, Scalar(self._x))
            yield self.act("next", frame) if index == N_FRAMES // 2 else frame
            self._x += 0.1 * self._speed

    def ground_truth(self) -> Any:
        return self.act("ground_truth")


class WickedFault(Wicked, Fault):
    """Changes nothing."""

    kind = "fault"

    def __init__(self, config: WickedConfig) -> None:
        super().__init__(config)
        self.act("__init__")

    def apply(self, frame: Frame, rng: np.random.Generator, since_s: float) -> Frame | None:
        left: Frame | None = self.act("apply", frame)
        return left

    def believed(self, info: SensorInfo) -> SensorInfo:
        believed: SensorInfo = self.act("believed", info)
        return believed


class WickedLocalizer(Wicked, Localizer):
    """Says how far the robot has come since the frame before."""

    kind = "localizer"

    def __init__(self, config: LocalizerConfig) -> None:
        super().__init__(config)
        self.act("__init__")
        self._last: Frame | None = None

    def start(self, session: Session) -> None:
        super().start(session)
        self._map = session.map

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        last, self._last = self._last, frame
        if last is None:
            return ()
        if self._map is not None:
            self._map.add(Keyframe(belief.travelled_m, frame.stamp_s, belief.pose_map_base or Pose2(), {}))
        step = Pose2(frame.payload.value - last.payload.value)
        answer: Sequence[Estimate] = self.act("observe", [Motion(last.stamp_s, frame.stamp_s, step, np.eye(3) * 1e6)])
        return answer

    def latency_s(self) -> float | None:
        latency_s: float | None = self.act("latency_s", 0.01)
        return latency_s

    def finish(self) -> None:
        self.act("finish")


class LocalizerConfig(WickedConfig):
    """The sensor besides."""

    sensor: Sensor["scalar"]


class WickedEstimator(Wicked, DeadReckoning):
    """Dead reckoning."""

    kind = "estimator"

    def __init__(self, config: WickedConfig) -> None:
        DeadReckoning.__init__(self, DeadReckoningConfig())
        self.config = config
        self.act("__init__")

    def start(self, session: Session) -> None:
        Wicked.start(self, session)
        DeadReckoning.start(self, session)

    def apply(self, source: str, estimate: Estimate) -> Applied:
        applied: Applied = self.act("apply", super().apply(source, estimate))
        return applied

    def belief(self, stamp_s: float | None = None) -> Belief:
        belief: Belief = self.act("belief", super().belief(stamp_s))
        return belief


class WickedController(Wicked, Controller):
    """Drives on at 1 m/s."""

    kind = "controller"

    def __init__(self, config: WickedConfig) -> None:
        super().__init__(config)
        self.act("__init__")

    @property
    def gives(self) -> frozenset[type[Command]]:
        given: frozenset[type[Command]] = self.act("gives", frozenset({Velocity}))
        return given

    def step(self, belief: Belief) -> Command:
        command: Command = self.act("step", Velocity(1.0))
        return command


class WickedMap(LocalizerMap):
    """Remembers keyframes."""

    def __init__(self, store: WickedStore) -> None:
        self._store, self._keyframes = store, list[Keyframe]()

    def add(self, keyframe: Keyframe) -> None:
        self._store.act("add")
        self._keyframes.append(keyframe)

    def keyframes(self) -> Sequence[Keyframe]:
        return self._keyframes

    def save(self, name: str, arrays: Mapping[str, Any]) -> None:
        self._store.act("save")

    def load(self, name: str) -> None:
        return None


class WickedStore(Wicked, PathStore):
    """Keeps a path in memory."""

    kind = "path_store"

    def __init__(self, config: WickedConfig) -> None:
        super().__init__(config)
        self.act("__init__")

    def append(self, waypoint: Waypoint) -> None:
        self.act("append")

    def path(self) -> Path | None:
        path: Path | None = self.act("path")
        return path

    def localizer_map(self, owner: str) -> LocalizerMap:
        localizer_map: LocalizerMap = self.act("localizer_map", WickedMap(self))
        return localizer_map

    def commit(self) -> None:
        self.act("commit")

    def mark_finished(self, owner: str) -> None:
        self.act("mark_finished")

    def set_sensors(self, sensors: Mapping[str, SensorInfo]) -> None:
        self.act("set_sensors")

    def set_meta(self, meta: Mapping[str, Any]) -> None:
        self.act("set_meta")


class WickedSink(Wicked, Sink):
    """Hears everything."""

    kind = "sink"

    def __init__(self, config: WickedConfig) -> None:
        super().__init__(config)
        self.act("__init__")

    def on_frame(self, frame: Frame) -> None:
        self.act("on_frame")

    def on_estimate_record(self, record: EstimateRecord) -> None:
        self.act("on_estimate_record")

    def on_belief(self, belief: Belief) -> None:
        self.act("on_belief")

    def on_command(self, stamp_s: float, command: Command) -> None:
        self.act("on_command")

    def on_end(self, end: RunEnd) -> None:
        self.act("on_end")


@trailmark.hookimpl
def trailmark_register(registry: Any) -> None:
    """Register all of them as ``wicked``."""
    registry.source("wicked", WickedSource, WickedSourceConfig)
    registry.fault("wicked", WickedFault, WickedConfig)
    registry.localizer("wicked", WickedLocalizer, LocalizerConfig)
    registry.estimator("wicked", WickedEstimator, WickedConfig)
    registry.path_store("wicked", WickedStore, WickedConfig)
    registry.controller("wicked", WickedController, WickedConfig)
    registry.sink("wicked", WickedSink, WickedConfig)
