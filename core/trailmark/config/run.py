"""A run as it was configured: validated, resolved, frozen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

from trailmark.config.document import Document, Key
from trailmark.config.entries import EstimatorEntry, LocalizerEntry, PartEntry, PathStoreEntry, SourceEntry
from trailmark.config.host import DEFAULT_PLUGINS, NoOptions, PathStoreOptions, RunSettings
from trailmark.config.source import Mounting
from trailmark.frames import Calibration
from trailmark.interfaces import Mode
from trailmark.plugins import Plugins

__all__ = ["RunConfig", "SensorOverride"]


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
    calibration: Calibration | None = None


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
