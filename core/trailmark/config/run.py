"""A run as it was configured, and its parts: validated, resolved, frozen, and not yet constructed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Generic, Self, TypeVar

import trailmark.frames
from trailmark.config.base import Mounting, PluginConfig, SourceConfig
from trailmark.config.document import Document, Key, Keys
from trailmark.config.host import (
    DEFAULT_PLUGINS,
    EstimatorOptions,
    LocalizerOptions,
    NoOptions,
    PathStoreOptions,
    RunSettings,
)
from trailmark.interfaces import Access, Mode, PathStore
from trailmark.plugins import Plugins
from trailmark.plugins.spec import Spec

__all__ = [
    "EstimatorEntry",
    "FaultEntry",
    "LocalizerEntry",
    "PartEntry",
    "PathStoreEntry",
    "RunConfig",
    "SensorOverride",
    "SourceEntry",
]

Options = TypeVar("Options", bound=PluginConfig, covariant=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class PartEntry(Generic[Options]):
    """A part of a run, from its section of the config to the running object.

    Attributes
    ----------
    name : str
        Its name in the config; for a part that has none there, its section, and for a sink its plugin
        (a second one of the same plugin gets ``_2``).
    spec : Spec
        Its plugin.
    config : PluginConfig
        The plugin's own keys.
    options : PluginConfig
        The keys that the host adds for every part of this kind.
    keys : tuple of str and int
        Where it stands in the config.
    place : str
        The same for messages: ``config.yaml line 7: localizers.floor``.
    document : dict
        The part as a config would give it, every default filled in.
    """

    name: str
    spec: Spec
    config: PluginConfig
    options: Options
    keys: Keys = field(default=(), compare=False)
    place: str = field(default="", compare=False)
    document: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def construct(self) -> Any:
        """Return the part, not started.

        Raises
        ------
        PluginLoadError
            If its class cannot be imported or constructed; the message says where the part stands in the config.
        """
        return self.spec.construct(self.config, self.place)


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultEntry(PartEntry[NoOptions]):
    """A fault of a source's sensors."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceEntry(PartEntry[NoOptions]):
    """A frame source; its calibration and its faults are read already.

    Attributes
    ----------
    calibration : Calibration or None
        Of the source's only sensor, from ``config.calibration``.
    faults : tuple of FaultEntry
        From ``config.perturb``, in the order in which they are applied.
    perturbed : tuple of str or None
        The sensors that the faults befall; None: all that they can.
    """

    config: SourceConfig
    calibration: trailmark.frames.Calibration | None = None
    faults: tuple[FaultEntry, ...] = ()
    perturbed: tuple[str, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalizerEntry(PartEntry[LocalizerOptions]):
    """A localizer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimatorEntry(PartEntry[EstimatorOptions]):
    """The estimator."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PathStoreEntry(PartEntry[PathStoreOptions]):
    """The path store."""

    def open(self, access: Access | None, base_dir: Path | None) -> PathStore | None:
        """Return the store for one access, not started; None if the config does not say which store it is.

        Parameters
        ----------
        access : {"read", "create", "append", "overwrite"} or None
            How it is opened; None: for teaching, as the config says.
        base_dir : Path or None
            Where relative paths start.
        """
        store_class: type[PathStore] = self.spec.load()
        with self.spec.naming_what_fails(self.place):
            return store_class.open(self.config, access, base_dir)


@dataclass(frozen=True, slots=True)
class SensorOverride:
    """What the config says about a sensor; None: what the source says.

    Attributes
    ----------
    mounting : Mounting or None
        Where the sensor is on the robot.
    calibration : Calibration or None
        Its intrinsic parameters.
    """

    mounting: Mounting | None = None
    calibration: trailmark.frames.Calibration | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RunConfig:
    """A run, ready to be built.

    Attributes
    ----------
    settings : RunSettings
        Mode, start, pace, seed and the like; its sections of parts are as they were written.
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

    settings: RunSettings
    sources: Mapping[str, SourceEntry]
    sensors: Mapping[str, SensorOverride]
    localizers: Mapping[str, LocalizerEntry]
    estimator: EstimatorEntry
    path_store: PathStoreEntry | None
    controller: PartEntry[NoOptions] | None
    sinks: tuple[PartEntry[NoOptions], ...]
    base_dir: Path
    plugins: Plugins
    document: dict[str, Any] = field(repr=False)
    notices: tuple[str, ...] = ()
    written: Document = field(default_factory=lambda: Document({}), repr=False)

    def __post_init__(self) -> None:
        for name in ("sources", "sensors", "localizers"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def with_mode(self, mode: Mode) -> Self:
        """Return the run in another mode."""
        settings = self.settings.model_copy(update={"mode": mode})
        return replace(self, settings=settings, document=self.document | {"mode": mode})

    def with_store(self, path: Path) -> Self:
        """Return the run with another path store file; where the config names no plugin, of the default one."""
        entry = self.path_store
        if entry is None:
            spec = self.plugins.registry.find("path_store", DEFAULT_PLUGINS["path_store"])
            config, options = spec.load_config()(), PathStoreOptions()
            entry = PathStoreEntry(name="path_store", spec=spec, config=config, options=options)
        entry = replace(entry, config=entry.config.model_copy(update={"path": str(path)}))
        document = (self.document.get("path_store") or {"plugin": entry.spec.name}) | {"path": str(path)}
        return replace(self, path_store=entry, document=self.document | {"path_store": document})

    def locate(self, *keys: Key) -> str:
        """Return where a key stands, for messages: ``config.yaml line 7: localizers.floor``."""
        return self.written.place(keys)

    def yaml(self) -> str:
        """Return `document` as YAML."""
        from trailmark.config.yaml_text import dump_yaml

        return dump_yaml(self.document)
