"""Loading plugins one by one, so that a broken one costs a warning and not the program.

pluggy's own ``load_setuptools_entrypoints`` stops at the first plugin that raises and knows no order;
here every entry point has a try of its own, in the order of (distribution, name).
"""

from __future__ import annotations

import logging
import time
import traceback
from collections.abc import Iterable
from dataclasses import replace
from difflib import get_close_matches
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any

import pluggy

from trailmark import PLUGIN_API
from trailmark.errors import ConfigError, PluginError, PluginLoadError
from trailmark.failures import is_from_user, words_of
from trailmark.plugins.candidates import (
    ALLOW_VARIABLE,
    CORE,
    ENTRY_POINT_GROUP,
    Candidate,
    PluginRecord,
    Selection,
    Status,
    file_candidates,
    installed_candidates,
)
from trailmark.plugins.hookspecs import HookSpecs
from trailmark.plugins.registry import Owner, Registry
from trailmark.plugins.spec import Spec

__all__ = ["ENTRY_POINT_GROUP", "Plugins", "discover_plugins", "load_plugins"]

logger = logging.getLogger(__name__)
logger.addHandler(logging.NullHandler())  # the command line prints the records; without it, logging decides


class Plugins:
    """The plugins of a process, or those of them that a run may use.

    Attributes
    ----------
    registry : Registry
        The parts of all plugins that loaded.
    records : tuple of PluginRecord
        What became of every plugin, broken ones included.
    """

    def __init__(self, manager: pluggy.PluginManager, records: Iterable[PluginRecord]) -> None:
        self._manager = manager
        self.records = tuple(records)
        specs = [spec for record in self.records if record.status == "ok" for spec in record.specs]
        self.registry = Registry(specs=specs, absent=[record for record in self.records if record.status != "ok"])

    @property
    def hook(self) -> pluggy.HookRelay:
        """The hooks, to be called with keyword arguments; one that raises ends the call (see `call_isolated`)."""
        return self._manager.hook

    @property
    def failed(self) -> tuple[PluginRecord, ...]:
        """The plugins that were wanted and did not load."""
        return tuple(record for record in self.records if record.status == "failed")

    def call_isolated(self, hook: str, **arguments: Any) -> None:
        """Call a hook of every plugin by itself: one that raises is a warning, and the others are still called."""
        for record in self.records:
            if record.status == "ok" and hook in record.hooks:
                try:
                    _call_one(self._manager, _key(record), hook, arguments)
                except BaseException as error:
                    if is_from_user(error):
                        raise
                    logger.warning("%s failed in %s: %s", record.origin, hook, words_of(error))
                    logger.debug("%s", traceback.format_exc())

    def restricted(self, enable: Iterable[str] | None = None, block: Iterable[str] = ()) -> Plugins:
        """Return the same plugins without those that a run may not use.

        Parameters
        ----------
        enable : iterable of str, optional
            Only these and core; None: all.
        block : iterable of str
            Not these.

        Raises
        ------
        ConfigError
            If a name means no installed plugin.
        """
        allowed = None if enable is None else frozenset(enable)
        selection = Selection(allowed, frozenset(block))
        for name in sorted((allowed or frozenset()) | selection.blocked):
            self._refuse_unknown(name)
        manager = _new_manager()
        records = []
        for record in self.records:
            verdict = selection.verdict(record.name, record.distribution)
            if record.status == "ok" and verdict == "ok":
                manager.register(self._manager.get_plugin(_key(record)), _key(record))
            is_withheld = record.status == "ok" and verdict != "ok"
            records.append(replace(record, status=verdict) if is_withheld else record)
        return Plugins(manager, records)

    def _refuse_unknown(self, name: str) -> None:
        if any(record.is_called(name) for record in self.records):
            return
        names = sorted({record.name for record in self.records})
        close = get_close_matches(name, names, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        raise ConfigError(f"no plugin named {name!r}{hint}; installed: {', '.join(names) or 'none'}")


def load_plugins(*, block: Iterable[str] = (), files: Iterable[str | Path] = ()) -> Plugins:
    """Return the plugins of this process; loaded once for the same arguments and environment.

    Parameters
    ----------
    block : iterable of str
        Plugins that may not load.
    files : iterable of path
        One-file plugins to load besides.

    Raises
    ------
    ConfigError
        If a file does not exist, or a name to block means no installed plugin.
    PluginLoadError
        With ``TRAILMARK_STRICT_PLUGINS=1``, for the first plugin that does not load.
    """
    selection = Selection.read(block, files)
    plugins = _discover_once(selection)
    for name in sorted(selection.blocked):
        plugins._refuse_unknown(name)
    return plugins


def discover_plugins(selection: Selection, entry_points: Iterable[metadata.EntryPoint] | None = None) -> Plugins:
    """Load the plugins afresh: those of `entry_points`, or of all installed distributions, and the files.

    Parameters
    ----------
    selection : Selection
        Which plugins may load, and which files hold one.
    entry_points : iterable of EntryPoint or None
        Where to look instead of the installed distributions.

    Returns
    -------
    Plugins
        The plugins that loaded, with their registry, and a record of each that did not.

    Raises
    ------
    PluginLoadError
        With a strict selection, for the first plugin that does not load.
    """
    manager = _new_manager()
    records = []
    for candidate in installed_candidates(entry_points):
        verdict = selection.verdict(candidate.name, candidate.distribution)
        records.append(_load(manager, candidate) if verdict == "ok" else _record(candidate, status=verdict))
    records += [_load(manager, candidate) for candidate in file_candidates(selection.files)]
    manager.check_pending()
    _report(records, selection)
    return Plugins(manager, records)


@lru_cache(maxsize=8)
def _discover_once(selection: Selection) -> Plugins:
    return discover_plugins(selection)


def _new_manager() -> pluggy.PluginManager:
    manager = pluggy.PluginManager("trailmark")
    manager.add_hookspecs(HookSpecs)
    return manager


def _load(manager: pluggy.PluginManager, candidate: Candidate) -> PluginRecord:
    """Import, check, register; whatever goes wrong becomes a record and leaves nothing behind."""
    key = _key(candidate)
    began_s = time.perf_counter()
    try:
        plugin = candidate.load()
        import_ms = (time.perf_counter() - began_s) * 1e3
        _refuse_other_api(plugin)
        manager.register(plugin, key)
        hooks = _checked_hooks(manager, plugin)
        specs = _registered_specs(manager, candidate)
    except (Exception, SystemExit) as error:  # a module that calls sys.exit() is broken, not a wish to leave
        if manager.has_plugin(key):
            manager.unregister(name=key)
        return replace(
            _record(candidate, "failed", import_ms=(time.perf_counter() - began_s) * 1e3),
            error=_one_line(error),
            traceback=traceback.format_exc(),
            needs_other_api=isinstance(error, ApiMismatchError),
        )
    return replace(_record(candidate, import_ms=import_ms), hooks=hooks, specs=specs)


class ApiMismatchError(PluginError):
    """The plugin was written for another version of the interfaces."""


def _refuse_other_api(plugin: Any) -> None:
    wanted = str(getattr(plugin, "TRAILMARK_API", PLUGIN_API))
    if wanted.split(".")[0] != PLUGIN_API.split(".")[0]:
        raise ApiMismatchError(
            f"it is written for plugin API {wanted}, this Trailmark has {PLUGIN_API}: upgrade the older of the two"
        )


def _checked_hooks(manager: pluggy.PluginManager, plugin: Any) -> tuple[str, ...]:
    callers = manager.get_hookcallers(plugin) or []
    known = sorted(name for name in dir(HookSpecs) if name.startswith("trailmark_"))
    for caller in callers:
        is_optional = any(impl.optionalhook for impl in caller.get_hookimpls() if impl.plugin is plugin)
        if not caller.has_spec() and not is_optional:
            close = get_close_matches(caller.name, known, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"hooks: {', '.join(known)}"
            raise PluginError(f"unknown hook {caller.name!r}; {hint}")
    if not callers:
        raise PluginError("it implements no hook: mark its functions with @trailmark.hookimpl")
    return tuple(sorted(caller.name for caller in callers))


def _registered_specs(manager: pluggy.PluginManager, candidate: Candidate) -> tuple[Spec, ...]:
    module = candidate.module.partition(":")[0]
    registry = Registry(Owner(candidate.name, candidate.distribution, candidate.version, module))
    _call_one(manager, _key(candidate), "trailmark_register", {"registry": registry})
    return registry.specs()


def _call_one(manager: pluggy.PluginManager, key: str, hook: str, arguments: dict[str, Any]) -> None:
    plugin = manager.get_plugin(key)
    others = [other for other in manager.get_plugins() if other is not plugin]
    manager.subset_hook_caller(hook, others)(**arguments)


def _report(records: list[PluginRecord], selection: Selection) -> None:
    for record in records:
        if record.status == "failed":
            if selection.is_strict:
                raise PluginLoadError(record.warning())
            logger.warning("%s", record.warning())
    for name in sorted(selection.allowed or ()):
        if not any(record.is_called(name) for record in records) and name != CORE[1]:
            logger.warning("%s names the plugin %r, which is not installed", ALLOW_VARIABLE, name)


def _one_line(error: BaseException) -> str:
    is_ours = isinstance(error, PluginError)
    return " ".join((str(error) if is_ours else f"{type(error).__name__}: {error}").split())


def _record(candidate: Candidate, status: Status = "ok", import_ms: float = 0.0) -> PluginRecord:
    return PluginRecord(
        candidate.name, candidate.distribution, candidate.version, candidate.module, status, import_ms=import_ms
    )


def _key(plugin: Candidate | PluginRecord) -> str:
    return f"{plugin.distribution}:{plugin.name}"
