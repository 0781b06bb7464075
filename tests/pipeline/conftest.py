"""Parts for runs without plugins: recordings, localizers, a store in memory, a robot, a clock that does not wait."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trailmark.commands import Command, Stop, Velocity
from trailmark.config import LocalizerOptions, PathStoreOptions, RunSettings, SourceConfig
from trailmark.estimates import Belief, Estimate, Motion, information_from_sigmas
from trailmark.estimation.dead_reckoning import DeadReckoning
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.frames import Frame, Image, Scalar, SensorInfo, payload_kind
from trailmark.geometry import Pose2, Trajectory
from trailmark.interfaces import Controller, Drivable, FrameSource, Localizer, LocalizerMap, PathStore, Session
from trailmark.paths import Keyframe, Path, Waypoint
from trailmark.pipeline import Clock, LocalizerPart, Parts, SourceStream

GOOD = information_from_sigmas(1e-3, 1e-3, 1e-3)
PIXELS = np.zeros((2, 3), np.uint8)


def image_frames(sensor: str, stamps: Iterable[float]) -> list[Frame]:
    """Return pictures that differ, as those of a camera do."""
    return [Frame(sensor, stamp_s, Image(PIXELS + np.uint8(k % 251))) for k, stamp_s in enumerate(stamps)]


def scalar_frames(sensor: str, stamps: Iterable[float]) -> list[Frame]:
    return [Frame(sensor, stamp_s, Scalar(0.0)) for stamp_s in stamps]


def press_ctrl_c() -> None:
    """Do what the user's Ctrl-C does; also in a process that was started with SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)


class Recording(FrameSource):
    """Frames from a list; an exception in it is raised, a function called."""

    def __init__(self, frames: Sequence[Any], sensors: Iterable[SensorInfo] = (), truth=None) -> None:
        super().__init__(None)
        self.log: list[str] = []
        self._frames = frames
        self._sensors = {info.name: info for info in sensors}
        self._truth = truth
        if not self._sensors:
            payloads = {frame.sensor: frame.payload for frame in frames if isinstance(frame, Frame)}
            self._sensors = {name: SensorInfo(name, payload_kind(payload)) for name, payload in payloads.items()}

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        return self._sensors

    def start(self, session: Session) -> None:
        self.session = session
        self.log.append("start")

    def close(self) -> None:
        self.log.append("close")

    def frames(self) -> Iterator[Frame]:
        for frame in self._frames:
            if isinstance(frame, BaseException):
                raise frame
            if not isinstance(frame, Frame):
                frame()
                continue
            self.log.append(f"pull {frame.stamp_s:g}")
            yield frame

    def ground_truth(self) -> Trajectory | None:
        return self._truth


class Scripted(Localizer):
    """Says what a function says; remembers what it was asked with."""

    def __init__(self, say: Callable[[Frame, Belief], Sequence[Estimate]] = lambda frame, belief: ()) -> None:
        super().__init__(None)
        self._say = say
        self.seen: list[tuple[Frame, Belief]] = []
        self.log: list[str] = []
        self.latency: float | None = None
        self.session = Session()

    def start(self, session: Session) -> None:
        self.session = session
        self.log.append(f"start {session.mode}")
        self.seen.clear()

    def close(self) -> None:
        self.log.append("close")

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        self.seen.append((frame, belief))
        return self._say(frame, belief)

    def latency_s(self) -> float | None:
        return self.latency

    def finish(self) -> None:
        self.log.append("finish")


class Mover(Scripted):
    """Says that base moved by `step` since the last frame."""

    def __init__(self, step: Pose2) -> None:
        super().__init__(self._moved)
        self._step = step

    def _moved(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        if len(self.seen) == 1:
            return ()
        return (Motion(self.seen[-2][0].stamp_s, frame.stamp_s, self._step, GOOD),)


class MemoryMap(LocalizerMap):
    """A localizer map of a `MemoryStore`."""

    def __init__(self, store: MemoryStore, owner: str) -> None:
        self._store, self._owner = store, owner

    def add(self, keyframe: Keyframe) -> None:
        self._store.open_keyframes.append((self._owner, keyframe))

    def keyframes(self) -> Sequence[Keyframe]:
        return [keyframe for owner, keyframe in self._store.disk["keyframes"] if owner == self._owner]

    def save(self, name: str, arrays: Mapping[str, Any]) -> None:
        self._store.disk["arrays"][self._owner, name] = arrays

    def load(self, name: str) -> Mapping[str, Any] | None:
        return self._store.disk["arrays"].get((self._owner, name))


class MemoryStore(PathStore):
    """A path store on a dict; `commits` lists what each commit made durable."""

    def __init__(self, disk: dict[str, Any], access: str) -> None:
        super().__init__(None)
        self.disk, self.access = disk, access
        disk.setdefault("log", []).append(access)
        for key, empty in (
            ("waypoints", []),
            ("keyframes", []),
            ("arrays", {}),
            ("commits", []),
            ("unfinished", set()),
        ):
            disk.setdefault(key, empty)
        self._open_waypoints: list[Waypoint] = []
        self.open_keyframes: list[tuple[str, Keyframe]] = []

    def append(self, waypoint: Waypoint) -> None:
        self._open_waypoints.append(waypoint)

    def path(self) -> Path | None:
        return Path(self.disk["waypoints"]) if self.disk["waypoints"] else None

    def localizer_map(self, owner: str) -> LocalizerMap:
        return MemoryMap(self, owner)

    def commit(self) -> None:
        self.disk["commits"].append((list(self._open_waypoints), [k.station_m for _, k in self.open_keyframes]))
        self.disk["waypoints"] += self._open_waypoints
        self.disk["keyframes"] += self.open_keyframes
        self._open_waypoints, self.open_keyframes = [], []

    def close(self) -> None:
        self.disk["log"].append("close")

    def is_finished(self, owner: str) -> bool:
        return owner not in self.disk["unfinished"]

    def mark_finished(self, owner: str) -> None:
        self.disk["unfinished"].discard(owner)
        self.disk["log"].append(f"finished {owner}")

    def set_sensors(self, sensors: Mapping[str, SensorInfo]) -> None:
        self.disk["sensors"] = dict(sensors)

    def sensors(self) -> Mapping[str, SensorInfo]:
        return self.disk.get("sensors", {})

    def set_meta(self, meta: Mapping[str, Any]) -> None:
        self.disk["meta"] = dict(meta)


class ToyRobot(Drivable):
    """A point that obeys `Velocity`; it gives its position as a scalar every 0.1 s, for at most `n` frames."""

    def __init__(self, n: int = 100, accepts: frozenset[type[Command]] = frozenset({Velocity, Stop})) -> None:
        super().__init__(None)
        self._n, self._accepts = n, accepts
        self.x, self.speed = 0.0, 0.0
        self.commands: list[Command] = []
        self.log: list[str] = []

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        return {"position": SensorInfo("position", "scalar")}

    @property
    def accepts(self) -> frozenset[type[Command]]:
        return self._accepts

    def frames(self) -> Iterator[Frame]:
        for i in range(self._n):
            self.log.append(f"frame {i}")
            yield Frame("position", 0.1 * i, Scalar(self.x))
            self.x += 0.1 * self.speed

    def drive(self, command: Command) -> None:
        self.log.append("drive")
        self.commands.append(command)
        self.speed = command.forward_mps if isinstance(command, Velocity) else 0.0

    def close(self) -> None:
        self.log.append("close")


class Chaser(Controller):
    """Drives at 1 m/s to `goal_m`."""

    def __init__(self, goal_m: float) -> None:
        super().__init__(None)
        self._goal_m = goal_m
        self.beliefs: list[Belief] = []

    @property
    def gives(self) -> frozenset[type[Command]]:
        return frozenset({Velocity, Stop})

    def step(self, belief: Belief) -> Command:
        self.beliefs.append(belief)
        assert belief.pose_map_base is not None
        return Stop("arrived", done=True) if belief.pose_map_base.x >= self._goal_m - 1e-9 else Velocity(1.0)


class FakeClock(Clock):
    """Time passes when somebody waits for it; what is `scheduled` happens on the way."""

    def __init__(self) -> None:
        self.t = 1000.0
        self.waits: list[float] = []
        self.scheduled: list[tuple[float, Callable[[], None]]] = []

    def now_s(self) -> float:
        return self.t

    def wait(self, timeout_s: float, wake: threading.Event) -> None:
        if wake.is_set():
            return
        until = self.t + timeout_s
        if self.scheduled and self.scheduled[0][0] <= until:
            self.t, action = self.scheduled.pop(0)
            action()
            wake.wait(5.0)
        else:
            assert until < float("inf"), "waiting for nothing"
            self.waits.append(timeout_s)
            self.t = until


class MemoryStoreEntry:
    """Opens a `MemoryStore` as the entry of a config opens a store."""

    def __init__(self, disk: dict[str, Any], spacing_m: float) -> None:
        self.options = PathStoreOptions(spacing_m=spacing_m)
        self._disk = disk

    def open(self, access: str | None, base_dir: object) -> MemoryStore:
        return MemoryStore(self._disk, access or "create")


@dataclass(frozen=True, kw_only=True)
class AllSensorsParts(Parts):
    """Parts whose localizers subscribe to every sensor, unless they name theirs."""

    def fitted_to(self, sensors: Mapping[str, SensorInfo]) -> AllSensorsParts:
        fitted = [part if part.sensors else replace(part, sensors=frozenset(sensors)) for part in self.localizers]
        return replace(self, localizers=fitted, document={"seed": self.settings.seed})


_SETTINGS = frozenset({"mode", "start", "control_hz", "stop_when", "pace", "patience_s", "seed"})


def parts(
    sources: Mapping[str, FrameSource] | None = None,
    localizers: Mapping[str, Localizer] | None = None,
    *,
    options: Mapping[str, SourceConfig] | None = None,
    localizer_options: Mapping[str, Mapping[str, Any]] | None = None,
    subscriptions: Mapping[str, frozenset[str]] | None = None,
    disk: dict[str, Any] | None = None,
    spacing_m: float = 0.05,
    **fields: Any,
) -> Parts:
    """Return a run of these parts; `options` are of its sources, `fields` of Parts or of its settings."""
    settings = {key: fields.pop(key) for key in _SETTINGS & fields.keys()}
    return AllSensorsParts(
        sources=[
            SourceStream(name, source, (options or {}).get(name) or SourceConfig())
            for name, source in (sources or {}).items()
        ],
        localizers=[
            LocalizerPart(
                name,
                localizer,
                (subscriptions or {}).get(name, frozenset()),
                LocalizerOptions.model_validate((localizer_options or {}).get(name, {})),
            )
            for name, localizer in (localizers or {}).items()
        ],
        estimator=fields.pop("estimator", None) or DeadReckoning(DeadReckoningConfig()),
        path_store=None if disk is None else MemoryStoreEntry(disk, spacing_m),
        settings=RunSettings(**settings),
        **fields,
    )


@pytest.fixture(scope="session")
def fakes() -> SimpleNamespace:
    """Everything above."""
    names = (
        *("Chaser", "FakeClock", "GOOD", "MemoryStore", "Mover", "Recording", "Scripted", "ToyRobot"),
        *("image_frames", "parts", "press_ctrl_c", "scalar_frames"),
    )
    return SimpleNamespace(**{name: globals()[name] for name in names})
