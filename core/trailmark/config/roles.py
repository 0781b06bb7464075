"""Which sensor a localizer looks at: settled when the sources have started, before the first frame."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from copy import deepcopy
from dataclasses import replace
from typing import Any

from trailmark.config.base import UNNAMED, SensorRole, sensor_roles
from trailmark.config.checks import refuse_one_sensor_twice
from trailmark.config.document import Keys, Problems
from trailmark.config.run import LocalizerEntry, RunConfig
from trailmark.errors import SensorMismatchError
from trailmark.frames import SensorInfo
from trailmark.plugins.hints import nearest_or_all

__all__ = ["refuse_duplicate_sensors", "resolve_all_roles", "resolve_roles"]


def resolve_all_roles(run_config: RunConfig, sensors: Mapping[str, SensorInfo]) -> RunConfig:
    """Return the run with every role of every localizer filled; `document` says the same.

    Parameters
    ----------
    run_config : RunConfig
        As loaded.
    sensors : mapping of str to SensorInfo
        The sensors of all sources.

    Raises
    ------
    SensorMismatchError
        With one line for every role that cannot be filled, for every name under ``sensors:`` that is no sensor,
        and for two localizers that would tell the motion of one sensor twice.
    """
    problems = Problems(run_config.written)
    for name in run_config.sensors:
        if name not in sensors:
            problems.add(("sensors", name), _unknown(name, sensors))
    entries = {name: _fill_roles(entry, sensors, problems) for name, entry in run_config.localizers.items()}
    problems.raise_if_any(SensorMismatchError)
    _refuse_motion_twice(run_config, entries, problems)
    problems.raise_if_any(SensorMismatchError)
    document = deepcopy(run_config.document)
    for name, entry in entries.items():
        written = document["localizers"][name]
        roles = {role: getattr(entry.config, role) for role in sensor_roles(type(entry.config))}
        document["localizers"][name] = {"plugin": written["plugin"]} | roles | {**written, **roles}
    return replace(run_config, localizers=entries, document=document)


def resolve_roles(entry: LocalizerEntry, sensors: Mapping[str, SensorInfo], run_config: RunConfig) -> LocalizerEntry:
    """Return one localizer with every role filled: as named, or by the only sensor that fits.

    Parameters
    ----------
    entry : LocalizerEntry
        The localizer, as the config has it.
    sensors : mapping of str to SensorInfo
        The sensors of all started sources, by name.
    run_config : RunConfig
        The run, for the place of what is wrong in its file.

    Returns
    -------
    LocalizerEntry
        The entry with the name of a sensor in every role.

    Raises
    ------
    SensorMismatchError
        If a sensor is unknown or of a wrong kind, or if no sensor or several fit a role that names none.
    """
    problems = Problems(run_config.written)
    filled = _fill_roles(entry, sensors, problems)
    problems.raise_if_any(SensorMismatchError)
    return filled


def refuse_duplicate_sensors(run_config: RunConfig, sensors_of: Mapping[str, Iterable[str]]) -> None:
    """Refuse two sources that bring a sensor of the same name.

    Parameters
    ----------
    run_config : RunConfig
        For the place in the message.
    sensors_of : mapping of str to names
        The sensors of each source, after `rename`.

    Raises
    ------
    SensorMismatchError
        With a line for every such sensor, naming both sources.
    """
    problems = Problems(run_config.written)
    owner: dict[str, str] = {}
    for source, names in sensors_of.items():
        for name in names:
            first = owner.setdefault(name, source)
            if first != source:
                problems.add(
                    ("sources", source),
                    f"duplicate sensor {name!r}: the source {first!r} has one of that name; "
                    f"write rename: {{{name}: {source}_{name}}}",
                )
    problems.raise_if_any(SensorMismatchError)


def _fill_roles(entry: LocalizerEntry, sensors: Mapping[str, SensorInfo], problems: Problems) -> LocalizerEntry:
    roles = sensor_roles(type(entry.config))
    values = {role: getattr(entry.config, role) for role in roles}
    taken = {name for value in values.values() for name in _names(value)}
    found: dict[str, str] = {}
    for role, mark in roles.items():
        keys = ("localizers", entry.name, role)
        if values[role] == UNNAMED:
            free = {name: info for name, info in sensors.items() if name not in taken}
            if sensor := _only_fitting(role, mark, free, keys[:2], problems):
                found[role] = sensor
                taken.add(sensor)
        for name in _names(values[role]):
            _check_named(name, mark, sensors, keys, problems)
    return replace(entry, config=entry.config.model_copy(update=found)) if found else entry


def _names(value: Any) -> tuple[str, ...]:
    if value is None or value == UNNAMED:
        return ()
    return (value,) if isinstance(value, str) else tuple(value)


def _check_named(
    name: str, role: SensorRole, sensors: Mapping[str, SensorInfo], keys: Keys, problems: Problems
) -> None:
    if name not in sensors:
        problems.add(keys, _unknown(name, sensors))
    elif role.kinds and sensors[name].kind not in role.kinds:
        wanted = " or ".join(role.kinds)
        fitting = _fitting(role, sensors)
        hint = f"; fitting: {', '.join(fitting)}" if fitting else "; no sensor fits"
        problems.add(keys, f"needs a sensor of kind {wanted}, but {name!r} is of kind {sensors[name].kind}{hint}")


def _only_fitting(
    role: str, mark: SensorRole, free: Mapping[str, SensorInfo], keys: Keys, problems: Problems
) -> str | None:
    fitting = _fitting(mark, free)
    if len(fitting) == 1:
        return fitting[0]
    wanted = f"of kind {' or '.join(mark.kinds)} " if mark.kinds else ""
    if fitting:
        problems.add(keys, f"several sensors fit {role!r}: {', '.join(fitting)}; name one, as {role}: {fitting[0]}")
    else:
        have = ", ".join(f"{name} ({info.kind})" for name, info in free.items()) or "none"
        problems.add(keys, f"no sensor {wanted}for {role!r}; free sensors: {have}")
    return None


def _fitting(role: SensorRole, sensors: Mapping[str, SensorInfo]) -> list[str]:
    return [name for name, info in sensors.items() if not role.kinds or info.kind in role.kinds]


def _unknown(name: str, sensors: Mapping[str, SensorInfo]) -> str:
    return f"no sensor is called {name!r}{nearest_or_all(name, sensors, 'sensors')}"


def _refuse_motion_twice(run_config: RunConfig, entries: Mapping[str, LocalizerEntry], problems: Problems) -> None:
    if run_config.estimator.options.use is None:
        moving = {name: entry.config for name, entry in entries.items() if "motion" in entry.spec.gives}
        refuse_one_sensor_twice(moving, problems)
