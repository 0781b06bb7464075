"""From a config to the parts of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from trailmark.config import PartEntry, PathStoreEntry, PluginConfig, RunConfig, load_run_config
from trailmark.config.checks import sensors_of
from trailmark.config.files import resolved
from trailmark.config.host import DEFAULT_PLUGINS
from trailmark.config.roles import refuse_duplicate_sensors, resolve_all_roles
from trailmark.errors import PluginLoadError, TrailmarkError
from trailmark.frames import SensorInfo
from trailmark.interfaces import Mode, PathStore
from trailmark.pipeline.plan import Access, Plan, PlannedLocalizer, Settled, StorePlan
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
        config = config if mode is None else replace(config, mode=mode, document=config.document | {"mode": mode})
        return config if store is None else _with_store(config, Path(store).absolute())
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
    controller = config.controller
    use = config.estimator.use
    return Plan(
        settle=partial(_settled, config),
        estimator=_built(config.estimator, config),
        feeds=[Feed(e.name, _built(e, config), e.config, e.calibration) for e in config.sources.values()],
        mode=config.mode,
        use=None if use is None else frozenset(use),
        sensors=config.sensors,
        store=_store_plan(config, access),
        controller=None if controller is None else _built(controller, config),
        sinks={entry.name: _built(entry, config) for entry in config.sinks},
        start=config.start,
        control_hz=config.control_hz,
        stop_when=config.stop_when,
        pace=config.pace,
        seed=config.seed,
        config_dir=config.base_dir,
        call_hook=config.plugins.call_isolated,
    )


def _settled(config: RunConfig, sensors: Mapping[str, SensorInfo], names_of: Mapping[str, Sequence[str]]) -> Settled:
    refuse_duplicate_sensors(config, names_of)
    resolved_config = resolve_all_roles(config, sensors)
    localizers = [
        PlannedLocalizer(
            entry.name,
            _built(entry, config),
            frozenset(sensors_of(entry.config)),
            entry.is_async,
            entry.latency_s,
            entry.on_error,
        )
        for entry in resolved_config.localizers.values()
    ]
    return Settled(localizers, resolved_config.document)


def _built(entry: PartEntry, config: RunConfig) -> Any:
    return _constructed(entry, config, entry.config)


def _constructed(entry: PartEntry, config: RunConfig, own: PluginConfig) -> Any:
    cls = entry.spec.load()
    try:
        return cls(own)
    except TrailmarkError:
        raise
    except Exception as error:
        raise PluginLoadError(
            f"{config.locate(*_keys(entry))}: {entry.spec.kind} {entry.spec.name!r} of {entry.spec.origin} cannot be"
            f" constructed: {type(error).__name__}: {error}"
        ) from error


def _keys(entry: PartEntry) -> tuple[str, ...]:
    section = {"source": "sources", "localizer": "localizers", "sink": "sinks"}.get(entry.spec.kind)
    return (section, entry.name) if section in ("sources", "localizers") else (section or entry.spec.kind,)


def _store_plan(config: RunConfig, access: Access | None) -> StorePlan | None:
    entry = config.path_store
    if entry is None:
        return None
    path = getattr(entry.config, "path", None)
    if path == "":  # nobody has said which
        return None

    def build(access: Access) -> PathStore:
        known = type(entry.config).model_fields
        own = {"access": access, "path": str(resolved(path, config.base_dir)) if path else path}
        update = {key: value for key, value in own.items() if key in known}
        store: PathStore = _constructed(entry, config, entry.config.model_copy(update=update))
        return store

    configured: Access = getattr(entry.config, "access", "read")
    return StorePlan(build, access or (configured if configured != "read" else "create"), entry.spacing_m)


def _with_store(config: RunConfig, path: Path) -> RunConfig:
    entry = config.path_store
    if entry is None:
        spec = config.plugins.registry.find("path_store", DEFAULT_PLUGINS["path_store"])
        entry = PathStoreEntry("path_store", spec, spec.load_config()())
    entry = replace(entry, config=entry.config.model_copy(update={"path": str(path)}))
    document = (config.document.get("path_store") or {"plugin": entry.spec.name}) | {"path": str(path)}
    return replace(config, path_store=entry, document=config.document | {"path_store": document})
