"""A run as it was configured: validated, resolved, frozen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from trailmark.config.base import PluginConfig
from trailmark.config.document import Document, Key
from trailmark.config.host import StopWhen
from trailmark.config.source import Mounting, SourceConfig
from trailmark.frames import Calibration
from trailmark.geometry import Pose2
from trailmark.plugins import Plugins, Spec

__all__ = [
    "EstimatorEntry",
    "LocalizerEntry",
    "PartEntry",
    "PathStoreEntry",
    "RunConfig",
    "SensorOverride",
    "SourceEntry",
]


@dataclass(frozen=True, slots=True)
class PartEntry:
    """A part of a run.

    Attributes
    ----------
    name : str
        Its name in the config; for a part that has none there, its section, and for a sink its plugin
        (a second one of the same plugin gets ``_2``).
    spec : Spec
        Its plugin; ``spec.load()`` gives the class.
    config : PluginConfig
        The plugin's own keys: ``spec.load()(config)`` makes the part.
    """

    name: str
    spec: Spec
    config: PluginConfig


@dataclass(frozen=True, slots=True)
class SourceEntry(PartEntry):
    """A frame source; its calibration is read already.

    Attributes
    ----------
    calibration : Calibration or None
        Of the source's only sensor, from ``config.calibration``.
    """

    config: SourceConfig
    calibration: Calibration | None = None


@dataclass(frozen=True, slots=True)
class LocalizerEntry(PartEntry):
    """A localizer.

    Attributes
    ----------
    is_async : bool
        Works beside the run; its estimates arrive late.
    latency_s : float or None
        How late, in step pace; None: by its own model [s].
    on_error : {"fail", "disable"}
        When it raises: end the run, or switch it off and go on.
    """

    is_async: bool = False
    latency_s: float | None = None
    on_error: Literal["fail", "disable"] = "fail"


@dataclass(frozen=True, slots=True)
class EstimatorEntry(PartEntry):
    """The estimator. `use` names the localizers whose estimates it takes; None: all."""

    use: tuple[str, ...] | None = None


@dataclass(frozen=True, slots=True)
class PathStoreEntry(PartEntry):
    """The path store; `spacing_m` is the way between two waypoints while teaching [m]."""

    spacing_m: float = 0.05


@dataclass(frozen=True, slots=True)
class SensorOverride:
    """What the config says about a sensor; None: what the source says."""

    mounting: Mounting | None = None
    calibration: Calibration | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RunConfig:
    """A run, ready to be built.

    Attributes
    ----------
    mode : {"track", "teach", "replay"}
        What the run is for.
    sources, sensors, localizers : mapping
        By name, in the order of the config.
    estimator : EstimatorEntry
        Never missing: the default is dead reckoning of all localizers.
    path_store : PathStoreEntry or None
        None where the config names none and the mode needs none.
    controller : PartEntry or None
        None: nothing is driven.
    sinks : tuple of PartEntry
        In the order of the config.
    start : {"first", "last", "unknown"} or Pose2
        Where the robot starts.
    control_hz : float
        The controller is asked at most this often [Hz].
    stop_when : StopWhen
        ``fix_age_m`` and ``motion_age_s``; None: off.
    pace : {"step", "realtime"} or None
        None: realtime for live sources only.
    seed : int
        Of every part's random numbers.
    base_dir : Path
        Where relative paths of the config start.
    plugins : Plugins
        Those that the run may use.
    document : dict
        The config with every default filled in and every path absolute, as plain values.
        Loaded again it gives the same run.
    notices : tuple of str
        What the reader should know: keys that an override dropped.
    written : Document
        The config as it was written.
    """

    mode: Literal["track", "teach", "replay"]
    sources: Mapping[str, SourceEntry]
    sensors: Mapping[str, SensorOverride]
    localizers: Mapping[str, LocalizerEntry]
    estimator: EstimatorEntry
    path_store: PathStoreEntry | None
    controller: PartEntry | None
    sinks: tuple[PartEntry, ...]
    start: Literal["first", "last", "unknown"] | Pose2
    control_hz: float
    stop_when: StopWhen
    pace: Literal["step", "realtime"] | None
    seed: int
    base_dir: Path
    plugins: Plugins
    document: dict[str, Any] = field(repr=False)
    notices: tuple[str, ...] = ()
    written: Document = field(default_factory=lambda: Document({}), repr=False)

    def __post_init__(self) -> None:
        for name in ("sources", "sensors", "localizers"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def locate(self, *keys: Key) -> str:
        """Return where a key stands, for messages: ``config.yaml line 7: localizers.floor``."""
        return self.written.place(keys)

    def yaml(self) -> str:
        """Return `document` as YAML."""
        from trailmark.config.yaml_text import dump_yaml

        return dump_yaml(self.document)
