"""What a run consists of: parts, and how they work together. The runner knows this, and no config."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from trailmark.config import SensorOverride, StopWhen
from trailmark.frames import SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Access, Controller, Estimator, Localizer, Mode, Pace, PathStore, Sink
from trailmark.pipeline.sources import Feed

__all__ = ["Access", "Pace", "Plan", "PlannedLocalizer", "Settled", "Start", "StorePlan"]

Start = Literal["first", "last", "unknown"] | Pose2


@dataclass(frozen=True, slots=True, eq=False)
class PlannedLocalizer:
    """A localizer of a run.

    Attributes
    ----------
    name : str
        In the config.
    localizer : Localizer
        The part.
    sensors : frozenset of str
        The sensors that it subscribes to.
    is_async : bool
        Whether it works beside the run.
    latency_s : float or None
        How long a call takes in step pace; None: as its own model says [s].
    on_error : {"fail", "disable"}
        What to do when it raises.
    """

    name: str
    localizer: Localizer
    sensors: frozenset[str]
    is_async: bool = False
    latency_s: float | None = None
    on_error: Literal["fail", "disable"] = "fail"


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """What is settled when the sensors are known.

    Attributes
    ----------
    localizers : sequence of PlannedLocalizer
        In the order in which they are asked.
    document : mapping
        The resolved config, for the record; loaded again it gives the same run.
    """

    localizers: Sequence[PlannedLocalizer]
    document: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))


@dataclass(frozen=True, slots=True, eq=False)
class StorePlan:
    """The path store of a run.

    Attributes
    ----------
    build : callable
        Makes the store for an access; ``read`` changes nothing, ``append`` goes on.
    teach_access : {"create", "append", "overwrite"}
        How teaching opens it.
    spacing_m : float
        Way between two waypoints [m].
    """

    build: Callable[[Access | None], PathStore]
    teach_access: Access | None = None
    spacing_m: float = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A run, made of parts that have not started.

    Attributes
    ----------
    settle : callable
        ``settle(sensors, names_of)`` returns the localizers, given the sensors of the run and the names of those of
        each source; raises ConfigError if a name is taken twice or a localizer does not find its sensor.
    estimator : Estimator
        Makes the belief.
    feeds : sequence of Feed
        The sources; empty: frames are pushed with `Pipeline.feed`.
    mode : {"track", "teach", "replay"}
        What the run is for.
    use : frozenset of str or None
        The localizers that the estimator hears; None: all.
    sensors : mapping of str to SensorOverride
        What the config says about sensors.
    store : StorePlan or None
        The path store.
    controller : Controller or None
        What drives.
    sinks : mapping of str to Sink
        By name, in the order in which they are told.
    start : {"first", "last", "unknown"} or Pose2
        Where the robot starts.
    control_hz : float
        The controller is asked at most this often [Hz].
    stop_when : StopWhen
        When the robot is stopped whatever the controller says.
    pace : {"step", "realtime"} or None
        None: realtime for live sources only.
    seed : int
        Of all random numbers.
    config_dir : pathlib.Path or None
        Folder of the config: the repository that it lies in is written down.
    call_hook : callable
        Calls a lifecycle hook of all plugins, each by itself: ``call_hook(name, **arguments)``.
    """

    settle: Callable[[Mapping[str, SensorInfo], Mapping[str, Sequence[str]]], Settled]
    estimator: Estimator
    feeds: Sequence[Feed] = ()
    mode: Mode = "track"
    use: frozenset[str] | None = None
    sensors: Mapping[str, SensorOverride] = field(default_factory=lambda: MappingProxyType({}))
    store: StorePlan | None = None
    controller: Controller | None = None
    sinks: Mapping[str, Sink] = field(default_factory=lambda: MappingProxyType({}))
    start: Start = "first"
    control_hz: float = 70.0
    stop_when: StopWhen = StopWhen()
    pace: Pace | None = None
    seed: int = 0
    config_dir: Path | None = None
    call_hook: Callable[..., None] = lambda name, **arguments: None

    @property
    def is_realtime(self) -> bool:
        """Whether frames are held to their stamps, or taken as they come."""
        return self.pace == "realtime" or (self.pace is None and self.is_live)

    @property
    def is_live(self) -> bool:
        """Whether a source is a device."""
        return any(feed.is_live for feed in self.feeds)
