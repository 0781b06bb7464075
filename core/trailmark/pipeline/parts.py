"""The parts of a run: constructed, and not started."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

from trailmark.config import (
    LocalizerEntry,
    LocalizerOptions,
    PathStoreEntry,
    RunConfig,
    RunSettings,
    SensorOverride,
    SourceEntry,
)
from trailmark.config.checks import sensors_of
from trailmark.config.roles import refuse_duplicate_sensors, resolve_all_roles
from trailmark.frames import SensorInfo
from trailmark.interfaces import Access, Controller, Drivable, Estimator, Localizer, Sink
from trailmark.pipeline.sources.stream import SourceStream

__all__ = ["LocalizerPart", "Parts", "build_parts", "build_sources"]

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class LocalizerPart:
    """A localizer of a run.

    Attributes
    ----------
    name : str
        In the config.
    localizer : Localizer
        The part itself.
    sensors : frozenset of str
        The sensors that it subscribes to.
    options : LocalizerOptions
        What the config says of every localizer: async, latency, what to do when it raises.
    """

    name: str
    localizer: Localizer
    sensors: frozenset[str]
    options: LocalizerOptions = LocalizerOptions()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Parts:
    """A run, made of parts that have not started.

    Attributes
    ----------
    estimator : Estimator
        Makes the belief.
    sources : sequence of SourceStream
        Give the frames; empty: frames are pushed with `Pipeline.feed`.
    localizers : sequence of LocalizerPart
        In the order in which they are asked.
    controller : Controller or None
        What drives.
    sinks : mapping of str to Sink
        By name, in the order in which they are told.
    path_store : PathStoreEntry or None
        Opens the path store; how is settled when the run starts.
    access : {"create", "append", "overwrite"} or None
        How teaching opens the path store; None: as its config says.
    settings : RunSettings
        Mode, start, pace, seed and the like.
    use : frozenset of str or None
        The localizers whose estimates the estimator takes; None: all.
    sensors : mapping of str to SensorOverride
        What the config says about sensors.
    base_dir : pathlib.Path or None
        Folder of the config: relative paths start there, and the repository that it lies in is written down.
    document : mapping
        The resolved config, for the record; loaded again it gives the same run.
    call_hook : callable
        Calls a lifecycle hook of all plugins, each by itself: ``call_hook(name, **arguments)``.
    """

    estimator: Estimator
    sources: Sequence[SourceStream] = ()
    localizers: Sequence[LocalizerPart] = ()
    controller: Controller | None = None
    sinks: Mapping[str, Sink] = field(default_factory=lambda: MappingProxyType({}))
    path_store: PathStoreEntry | None = None
    access: Access | None = None
    settings: RunSettings = RunSettings()
    use: frozenset[str] | None = None
    sensors: Mapping[str, SensorOverride] = field(default_factory=lambda: MappingProxyType({}))
    base_dir: Path | None = None
    document: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    call_hook: Callable[..., None] = lambda name, **arguments: None

    @property
    def is_realtime(self) -> bool:
        """Whether frames are held to their stamps, or taken as they come."""
        return self.settings.pace == "realtime" or (self.settings.pace is None and self.is_live)

    @property
    def is_live(self) -> bool:
        """Whether a source is a device."""
        return any(source.is_live for source in self.sources)

    @property
    def robot(self) -> Drivable | None:
        """The source that can be driven, if there is one."""
        return next((source.drivable for source in self.sources if source.drivable is not None), None)

    def fitted_to(self, sensors: Mapping[str, SensorInfo]) -> Self:
        """Return the parts for the sensors that the started sources have.

        Raises
        ------
        ConfigError
            If a sensor's name is taken twice, or a localizer does not find its sensor.
        """
        return self


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _ConfiguredParts(Parts):
    """Parts of a config: its localizers can be constructed when it is known which sensors there are."""

    config: RunConfig

    def fitted_to(self, sensors: Mapping[str, SensorInfo]) -> Self:
        """Return the parts with the localizers constructed, each with the sensors of its roles in its config."""
        refuse_duplicate_sensors(self.config, {source.name: tuple(source.sensors) for source in self.sources})
        config = resolve_all_roles(self.config, sensors)
        localizers = [_localizer(entry) for entry in config.localizers.values()]
        return replace(self, localizers=localizers, document=config.document)


def build_parts(config: RunConfig, access: Access | None = None) -> Parts:
    """Return the parts of a run, constructed and not started.

    Parameters
    ----------
    config : RunConfig
        As loaded.
    access : {"create", "append", "overwrite"}, optional
        How teaching opens the path store; default: as its config says, or ``create``.

    Raises
    ------
    PluginLoadError
        If a part cannot be imported or constructed.
    """
    use = config.estimator.options.use
    return _ConfiguredParts(
        config=config,
        estimator=config.estimator.construct(),
        sources=build_sources(config),
        controller=None if config.controller is None else config.controller.construct(),
        sinks={entry.name: entry.construct() for entry in config.sinks},
        path_store=config.path_store,
        access=access,
        settings=config.settings,
        use=None if use is None else frozenset(use),
        sensors=config.sensors,
        base_dir=config.base_dir,
        call_hook=config.plugins.call_isolated,
    )


def build_sources(config: RunConfig) -> list[SourceStream]:
    """Return the sources of a run, constructed and not started.

    Raises
    ------
    PluginLoadError
        If one cannot be imported or constructed.
    """
    return [_source(entry) for entry in config.sources.values()]


def _source(entry: SourceEntry) -> SourceStream:
    perturber = None
    if entry.faults:
        from trailmark.pipeline.sources.perturbing import Perturber  # most sources are as good as they come

        perturber = Perturber(entry.name, {fault.name: fault.construct for fault in entry.faults}, entry.perturbed)
    return SourceStream(entry.name, entry.construct(), entry.config, entry.calibration, perturber)


def _localizer(entry: LocalizerEntry) -> LocalizerPart:
    _warn_of_no_effect(entry)
    return LocalizerPart(entry.name, entry.construct(), frozenset(sensors_of(entry.config)), entry.options)


def _warn_of_no_effect(entry: LocalizerEntry) -> None:
    """Warn of options that have no effect on a localizer that is waited for."""
    options = entry.options
    for key, is_given in (("latency_ms", options.latency_ms is not None), ("keep", options.keep != "newest")):
        if is_given and not options.is_async:
            logger.warning("localizers.%s.%s has no effect without async: true: it is waited for", entry.name, key)
