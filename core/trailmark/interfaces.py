"""The parts of a pipeline. Plugins implement these; the pipeline runs them.

Every part has the same life: a cheap constructor, `start` (open, load, warm up; again = as new), work,
and `close` (from any thread, in any state, twice). A method added here later has a default, so that
plugins written for an older minor version keep working.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np
import numpy.typing as npt

from trailmark.commands import Command
from trailmark.deprecation import deprecated_name
from trailmark.errors import ConfigError
from trailmark.estimates import Applied, Belief, Estimate, EstimateRecord
from trailmark.frames import Frame, SensorInfo, SensorOrigin
from trailmark.geometry import Pose2, Trajectory
from trailmark.paths import Keyframe, Path, Waypoint

if TYPE_CHECKING:
    from trailmark.config.base import PluginConfig

__all__ = [
    "Access",
    "Controller",
    "Drivable",
    "Estimator",
    "Fault",
    "FrameSource",
    "Localizer",
    "LocalizerMap",
    "Mode",
    "Pace",
    "Part",
    "PathStore",
    "RunEnd",
    "Session",
    "Sink",
]

#: What a run is for: to localize only, to remember a path, or to come back to a remembered one.
Mode = Literal["track", "teach", "replay"]

#: How fast a run goes: as fast as possible and reproducible, or held to the stamps.
Pace = Literal["step", "realtime"]

#: How a path store is opened: ``read`` changes nothing, ``append`` goes on with the path in it.
Access = Literal["read", "create", "append", "overwrite"]


class LocalizerMap(ABC):
    """One localizer's own place in the path store; usable from any thread, writable in teach."""

    @abstractmethod
    def add(self, keyframe: Keyframe) -> None:
        """Remember a keyframe; it is committed with the waypoint that follows it.

        Raises
        ------
        StoreError
            If the store is open for reading only.
        """

    @abstractmethod
    def keyframes(self) -> Sequence[Keyframe]:
        """Return all keyframes in the order in which they were added."""

    @abstractmethod
    def save(self, name: str, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Store named arrays under a name, replacing what stood there."""

    @abstractmethod
    def load(self, name: str) -> Mapping[str, npt.NDArray[Any]] | None:
        """Return the arrays saved under a name, or None."""


def _default_rng() -> np.random.Generator:
    return np.random.default_rng(0)


def _no_latency() -> float:
    return 0.0


def _ignore_pose(pose_map_base: Pose2, covariance: npt.NDArray[np.float64] | None = None) -> None:
    """Take a pose that nobody asks for."""


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """What one part is told when it starts. Every field has a default.

    Attributes
    ----------
    name : str
        The part's name in the config.
    mode : {"track", "teach", "replay"}
        Localize only, remember a path, or come back to a remembered one.
    sensors : mapping of str to SensorInfo
        All sensors of the run, by name.
    path : Path or None
        The taught path, in replay (and in track with a store).
    start_pose : Pose2 or None
        Base in the map at the start; None: unknown.
    map : LocalizerMap or None
        This part's own place in the store.
    rng : numpy.random.Generator
        Seeded from (seed, kind, name): adding a part changes no other part's numbers.
    last_latency_s : callable
        Returns the duration of this part's last call: measured in realtime, modelled in step [s].
    tell_pose : callable
        For sources: ``tell_pose(pose_map_base, covariance)`` passes on where a person says that the robot is. From any
        thread; the estimator's `Estimator.set_pose` is told before the next frame.
    """

    name: str = ""
    mode: Mode = "track"
    sensors: Mapping[str, SensorInfo] = field(default_factory=lambda: MappingProxyType({}))
    path: Path | None = None
    start_pose: Pose2 | None = None
    map: LocalizerMap | None = None
    rng: np.random.Generator = field(default_factory=_default_rng)
    last_latency_s: Callable[[], float] = _no_latency
    tell_pose: Callable[[Pose2, npt.NDArray[np.float64] | None], None] = _ignore_pose

    @property
    def drawer(self) -> LocalizerMap | None:
        """The old name of `map`; it goes with version 0.3."""
        warnings.warn("Session.drawer is called Session.map now", DeprecationWarning, stacklevel=2)
        return self.map


class Part(ABC):  # noqa: B024  (each kind of part has abstract methods of its own)
    """Anything that a config can name."""

    def __init__(self, config: Any) -> None:
        """Keep the config. Cheap: opens no file or device and compiles nothing."""
        self.config = config

    def start(self, session: Session) -> None:  # noqa: B027  (a default on purpose)
        """Open, load and warm up. Called before the clock starts; called again, the part is as new."""

    def close(self) -> None:  # noqa: B027
        """Release what `start` took. Any thread, any state, twice."""

    def counters(self) -> Mapping[str, int]:
        """Return what the part counted since `start`, by name: skipped frames, retries, overflows."""
        return {}


class FrameSource(Part):
    """Gives the frames of one or several sensors in the order of their stamps."""

    @property
    @abstractmethod
    def sensors(self) -> Mapping[str, SensorInfo]:
        """The sensors, by name; known after `start`."""

    @abstractmethod
    def frames(self) -> Iterator[Frame]:
        """Yield all frames once, in stamp order; a live source may yield those of several sensors as they come.

        The iterator ends at the end of the recording or after `close`.

        Raises
        ------
        SourceError
            If a frame is missing or unreadable, its size changes, or a stamp goes back.
        """

    def ground_truth(self) -> Trajectory | None:
        """Return the true trajectory of base where it is known; asked after the last frame."""
        return None

    def unread(self) -> Mapping[str, str]:
        """Return what the recording holds and the source does not give, with the reason; known after `start`."""
        return {}

    def origins(self) -> Mapping[str, SensorOrigin]:
        """Return where the recording says mountings and calibrations, by sensor; known after `start`."""
        return {}

    @classmethod
    def survey(cls, where: str) -> Sequence[Mapping[str, str]]:
        """Return what is on a network, for ``trailmark inspect NAME://WHERE``: rows of a table, by column.

        Raises
        ------
        ConfigError
            If `where` is no such place, or the source reads no network, which is the default.
        """
        raise ConfigError(f"{cls.__name__} reads no network: {where!r} cannot be looked at")

    #: True for devices: frames come when they come, and what is not taken is lost.
    is_live: ClassVar[bool] = False


class Drivable(FrameSource):
    """A source that is a robot: it can be driven. It may also drive itself (a person, a scripted route)."""

    @property
    @abstractmethod
    def accepts(self) -> frozenset[type[Command]]:
        """The commands it understands; `Stop` always is one of them."""

    @abstractmethod
    def drive(self, command: Command) -> None:
        """Take a command. It holds from the last frame yielded until the next command."""

    #: True when it drives itself, so that a run needs no controller.
    drives_itself: bool = False


class Fault(Part):
    """Makes what one sensor gives worse, on purpose, as a wrapper around it: faults can be put around faults.

    One is made for each sensor that it befalls: its state is of that sensor alone, and so are its random numbers, which
    come from (seed, source, sensor, fault). `start` gets a session whose `Session.sensors` is that sensor, and whose
    `Session.rng` is for what stays as it is over the run, such as where dirt sits on a lens.
    """

    #: Kinds of sensor that it can befall; empty: any.
    kinds: ClassVar[frozenset[str]] = frozenset()

    @abstractmethod
    def apply(self, frame: Frame, rng: np.random.Generator, since_s: float) -> Frame | None:
        """Return a frame as the fault leaves it.

        Parameters
        ----------
        frame : Frame
            The next frame of the sensor; its arrays are read-only.
        rng : numpy.random.Generator
            For this frame alone: what is drawn for one frame does not depend on the frames before it.
        since_s : float
            Time since the first frame of the source [s].

        Returns
        -------
        Frame or None
            Of the same sensor and of the same size. A later stamp delays it: other frames may pass. None: it is lost.
        """

    def believed(self, info: SensorInfo) -> SensorInfo:
        """Return what the run is told of the sensor: the truth, unless the fault is a wrong calibration."""
        return info


class Localizer(Part):
    """Turns frames into estimates."""

    #: Format of what it keeps in its map. Raise it when an older version could not read that any more: the pipeline
    #: keeps it beside the map, and a localizer is never started on a map of a newer format than its own.
    map_format: ClassVar[int] = 1

    @abstractmethod
    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Look at a frame of a sensor that the config subscribes to.

        Parameters
        ----------
        frame : Frame
            The frame; its arrays are read-only.
        belief : Belief
            What is believed at the frame's stamp, with the estimates of the localizers before this one.

        Returns
        -------
        sequence of Estimate
            Empty: it did not look. `Lost`: it looked and cannot say.
        """

    def latency_s(self) -> float | None:
        """Return how long the last call takes by the localizer's own model [s]; None: it has none."""
        return None

    def finish(self) -> None:
        """End of teaching: select, train, index; works from the localizer map alone and may be repeated."""


class Estimator(Part):
    """Makes one belief of many estimates, whatever order they come in."""

    #: True when it can integrate the `Motion` of one localizer only: a second one needs ``use``.
    takes_one_motion: ClassVar[bool] = False

    @abstractmethod
    def apply(self, source: str, estimate: Estimate) -> Applied:
        """Take an estimate of a localizer and say what became of it.

        The estimate may be about a past stamp: the estimator keeps a history and replays it.
        """

    @abstractmethod
    def belief(self, stamp_s: float | None = None) -> Belief:
        """Return the belief at a stamp: interpolated in the history, or predicted beyond it.

        None asks for the newest stamp it has heard of.
        """

    def set_pose(
        self,
        pose_map_base: Pose2,
        covariance: npt.NDArray[np.float64] | None = None,
        stamp_s: float | None = None,
    ) -> Applied:
        """Be told where base is, by a person or a program that knows, whatever was believed.

        Parameters
        ----------
        pose_map_base : Pose2
            Base in the map.
        covariance : (3, 3) float64, optional
            Of (x, y, theta); left out, that of a known start.
        stamp_s : float, optional
            When; left out, at the newest stamp heard of [s].

        Returns
        -------
        Applied
            ``accepted``; ``late``, if it is about an instant older than the history; or why it is ``refused``. An
            estimator that cannot be told a pose, which is the default, refuses.

        Raises
        ------
        ShapeError
            If the covariance is not (3, 3).
        """
        return Applied("refused", f"{type(self).__name__} cannot be told a pose")


class Controller(Part):
    """Turns beliefs into commands. Path, goal and direction come with the session and the config."""

    @property
    @abstractmethod
    def gives(self) -> frozenset[type[Command]]:
        """The commands it may give."""

    @abstractmethod
    def step(self, belief: Belief) -> Command:
        """Return the command for a belief that is predicted to now."""


class PathStore(Part):
    """Keeps a taught path. It belongs to the pipeline; localizers see their `LocalizerMap` only."""

    @classmethod
    def open(cls, config: PluginConfig, access: Access | None, base_dir: FilePath | None) -> Self | None:
        """Return a store for one access, constructed and not started; None if the config does not say which one.

        This default is for a config with the keys ``path`` (empty: not said) and ``access``; of a config that lacks
        one of them it leaves that alone.

        Parameters
        ----------
        config : PluginConfig
            The store's own keys.
        access : {"read", "create", "append", "overwrite"} or None
            How it is opened; None: for teaching, as the config says, or else ``create``.
        base_dir : Path or None
            Where a relative path starts; None: where we work.
        """
        from trailmark.config.files import resolved  # the config stands above the interfaces, and pydantic is slow

        keys = dict(config)
        if keys.get("path") == "":
            return None
        changes: dict[str, Any] = {}
        if keys.get("path"):
            changes["path"] = str(resolved(keys["path"], base_dir))
        if "access" in keys:
            changes["access"] = access or ("create" if keys["access"] == "read" else keys["access"])
        return cls(config.model_copy(update=changes))

    @abstractmethod
    def append(self, waypoint: Waypoint) -> None:
        """Add a waypoint to the open transaction."""

    @abstractmethod
    def path(self) -> Path | None:
        """Return the committed path, or None while there is none."""

    @abstractmethod
    def localizer_map(self, owner: str) -> LocalizerMap:
        """Return the map of one localizer."""

    def drawer(self, owner: str) -> LocalizerMap:
        """Call `localizer_map` by its old name; it goes with version 0.3."""
        warnings.warn("PathStore.drawer is called localizer_map now", DeprecationWarning, stacklevel=2)
        return self.localizer_map(owner)

    @abstractmethod
    def commit(self) -> None:
        """Make everything so far durable: when this returns, a kill at any instant loses none of it."""

    def is_finished(self, owner: str) -> bool:
        """Return whether `Localizer.finish` ran for this owner, or has nothing to work from.

        A store that keeps no book of it answers True: it cannot ask for what it cannot record.
        """
        return True

    def mark_finished(self, owner: str) -> None:
        """Write down that `Localizer.finish` ran for this owner; part of the open transaction."""

    def set_sensors(self, sensors: Mapping[str, SensorInfo]) -> None:
        """Keep what is known of the sensors the path is taught with; part of the open transaction."""

    def sensors(self) -> Mapping[str, SensorInfo]:
        """Return the sensors that the path was taught with, by name; empty where none were kept."""
        return {}

    def set_meta(self, meta: Mapping[str, Any]) -> None:
        """Keep provenance (JSON-able: versions, git, config); part of the open transaction."""


@dataclass(frozen=True, slots=True)
class RunEnd:
    """How a run ended, told to the sinks.

    Attributes
    ----------
    status : {"done", "stopped", "interrupted", "failed"}
        At the end of the frames or the goal; by the guard; by the user; by an error.
    reason : str
        One line, empty for a plain end.
    counters : mapping of str to int
        Frames, drops, late, gated, lost ..., by dotted name.
    """

    status: Literal["done", "stopped", "interrupted", "failed"]
    reason: str = ""
    counters: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))


class Sink(Part):
    """Is told what happens: a recorder, a viewer, a bridge. Each method does nothing unless overridden.

    Only methods that a sink overrides are called.
    """

    def on_frame(self, frame: Frame) -> None:
        """A frame was taken from a source."""

    def on_estimate_record(self, record: EstimateRecord) -> None:
        """An estimate was applied: when it arrived, whose it is, what it says, and what became of it."""
        self.on_estimate(record.source, record.estimate, record.outcome)

    def on_estimate(self, source: str, estimate: Estimate, applied: Applied) -> None:
        """An estimate was applied; `on_estimate_record` also says when, and calls this unless it is overridden."""

    def on_belief(self, belief: Belief) -> None:
        """The belief after all localizers saw a frame."""

    def on_command(self, stamp_s: float, command: Command) -> None:
        """A command was given."""

    def on_end(self, end: RunEnd) -> None:
        """The run is over."""


_OLD_NAMES = {"Drawer": LocalizerMap}


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, _OLD_NAMES)
