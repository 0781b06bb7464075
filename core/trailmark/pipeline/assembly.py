"""From a config to the parts of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from trailmark.config import RunConfig, SourceEntry, load_run_config
from trailmark.config.checks import sensors_of
from trailmark.config.roles import refuse_duplicate_sensors, resolve_all_roles
from trailmark.frames import SensorInfo
from trailmark.interfaces import Access, Mode, PathStore
from trailmark.pipeline.perturbing import Perturber
from trailmark.pipeline.plan import Plan, PlannedLocalizer, Settled, StorePlan
from trailmark.pipeline.sources import Feed
from trailmark.plugins import Plugins, load_plugins

__all__ = ["plan_of", "read_config"]


def read_config(
    config: RunConfig | str | Path | Mapping[str, Any],
    *,
    plugins: Plugins | None = None,
    overrides: Sequence[Any] = (),
    mode: Mode | None = None,
    store: str | Path | None = None,
) -> RunConfig:
    """Return a config, loaded where it is not yet, with the path store that a command names.

    Raises
    ------
    ConfigError
        If the config is wrong; one line for each thing.
    """
    if isinstance(config, RunConfig):
        config = config if mode is None else config.with_mode(mode)
        return config if store is None else config.with_store(Path(store).absolute())
    changes = [*overrides, *([] if store is None else [("path_store.path", str(Path(store).absolute()))])]
    return load_run_config(config, plugins=plugins or load_plugins(), overrides=changes, mode=mode)


def plan_of(config: RunConfig, access: Access | None = None) -> Plan:
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
    settings, controller, use = config.settings, config.controller, config.estimator.options.use
    return Plan(
        settle=partial(_settled, config),
        estimator=config.estimator.construct(),
        feeds=[_feed(entry) for entry in config.sources.values()],
        mode=settings.mode,
        use=None if use is None else frozenset(use),
        sensors=config.sensors,
        store=_store_plan(config, access),
        controller=None if controller is None else controller.construct(),
        sinks={entry.name: entry.construct() for entry in config.sinks},
        start=settings.start if isinstance(settings.start, str) else settings.start_pose or "first",
        control_hz=settings.control_hz,
        stop_when=settings.stop_when,
        pace=settings.pace,
        seed=settings.seed,
        config_dir=config.base_dir,
        call_hook=config.plugins.call_isolated,
    )


def _feed(entry: SourceEntry) -> Feed:
    makers = {fault.name: fault.construct for fault in entry.faults}
    perturber = Perturber(entry.name, makers, entry.perturbed) if makers else None
    return Feed(entry.name, entry.construct(), entry.config, entry.calibration, perturber)


def _settled(config: RunConfig, sensors: Mapping[str, SensorInfo], names_of: Mapping[str, Sequence[str]]) -> Settled:
    refuse_duplicate_sensors(config, names_of)
    resolved_config = resolve_all_roles(config, sensors)
    localizers = [
        PlannedLocalizer(
            entry.name,
            entry.construct(),
            frozenset(sensors_of(entry.config)),
            entry.options.is_async,
            entry.options.latency_s,
            entry.options.on_error,
        )
        for entry in resolved_config.localizers.values()
    ]
    return Settled(localizers, resolved_config.document)


def _store_plan(config: RunConfig, access: Access | None) -> StorePlan | None:
    entry = config.path_store
    if entry is None or entry.open("read", config.base_dir) is None:
        return None

    def build(access: Access | None) -> PathStore:
        store = entry.open(access, config.base_dir)
        assert store is not None
        return store

    return StorePlan(build, access, entry.options.spacing_m)
