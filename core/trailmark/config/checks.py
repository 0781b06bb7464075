"""Checks across the parts of a config: motion that counts twice, names of localizers, classes, files that are written.

A config may come from a stranger: the files that it lets its parts write stay within its folder. What is given on the
command line (``--set``) or by a program may lie anywhere.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, get_args

from trailmark.config.base import UNNAMED, IsLocalizer, PluginConfig, sensor_roles
from trailmark.config.document import Document, Problems
from trailmark.config.files import IsWritten
from trailmark.config.run import EstimatorEntry, LocalizerEntry, PartEntry
from trailmark.errors import PluginError
from trailmark.plugins import Kind
from trailmark.plugins.hints import nearest_or_all

__all__ = [
    "check_classes",
    "check_motion",
    "check_use",
    "notices_of_strangers",
    "refuse_one_sensor_twice",
    "refuse_outputs_elsewhere",
    "sensors_of",
]


def check_use(localizers: Iterable[str], estimator: EstimatorEntry, problems: Problems) -> None:
    """Note names under ``estimator.use`` that no localizer has."""
    known = list(localizers)
    for index, name in enumerate(estimator.options.use or ()):
        if name not in known:
            hint = nearest_or_all(name, known, "localizers")
            problems.add(("estimator", "use", index), f"no localizer is called {name!r}{hint}")


def check_motion(localizers: Mapping[str, LocalizerEntry], estimator: EstimatorEntry, problems: Problems) -> None:
    """Note two localizers whose motion would be counted twice: 10 m would become 20.

    Under dead reckoning only one of those used may give motion. Under other estimators two may, if they look at
    different sensors or ``use`` says that both are meant.
    """
    use = estimator.options.use
    used = [name for name in localizers if use is None or name in use]
    moving = {name: localizers[name].config for name in used if "motion" in localizers[name].spec.gives}
    if estimator.spec.name == "dead_reckoning":
        if len(moving) > 1:
            first, second = list(moving)[:2]
            problems.add(
                ("localizers", second),
                f"{first!r} and {second!r} both give motion, and dead_reckoning takes it from one: "
                f"say which with estimator: {{use: [{first}]}}, or choose an estimator that weighs them",
            )
    elif use is None:
        refuse_one_sensor_twice(moving, problems)


def refuse_one_sensor_twice(moving: Mapping[str, PluginConfig], problems: Problems) -> None:
    """Note two localizers that give motion from the same sensor; sensors not named yet are not compared."""
    seen: dict[str, str] = {}
    for name, config in moving.items():
        for sensor in sensors_of(config):
            if seen.setdefault(sensor, name) != name:
                problems.add(
                    ("localizers", name),
                    f"{seen[sensor]!r} and {name!r} both give motion of the sensor {sensor!r}, which would count "
                    f"twice: say which with estimator: {{use: [{seen[sensor]}, ...]}}",
                )
                break


def sensors_of(config: PluginConfig) -> list[str]:
    """Return the sensors that a localizer's config names, in the order of its roles."""
    names: list[str] = []
    for role in sensor_roles(type(config)):
        value = getattr(config, role)
        names += [value] if isinstance(value, str) else list(value or ())
    return [name for name in names if name != UNNAMED]


def check_classes(parts: Iterable[PartEntry[Any]], problems: Problems) -> None:
    """Import the class of every part, and note those that cannot be had or are of the wrong kind."""
    from trailmark import interfaces

    wanted: dict[Kind, type] = {
        "source": interfaces.FrameSource,
        "fault": interfaces.Fault,
        "localizer": interfaces.Localizer,
        "estimator": interfaces.Estimator,
        "path_store": interfaces.PathStore,
        "controller": interfaces.Controller,
        "sink": interfaces.Sink,
    }
    for part in parts:
        keys = part.keys if part.spec.kind == "fault" else (*part.keys, "plugin")  # a fault's key is its name
        try:
            found = part.spec.load()
        except PluginError as error:
            problems.add(keys, str(error))
            continue
        base = wanted[part.spec.kind]
        if not (isinstance(found, type) and issubclass(found, base)):
            problems.add(keys, f"{part.spec.target} of {part.spec.origin} is no {base.__name__}")


def notices_of_strangers(
    parts: Iterable[PartEntry[Any]], localizers: Collection[str], document: Document
) -> Iterator[str]:
    """Yield a line for each name in a config that no localizer has."""
    for part in parts:
        for name, field in type(part.config).model_fields.items():
            value = getattr(part.config, name)
            if not isinstance(value, Mapping) or not _names_localizers(field.annotation):
                continue
            for key in value:
                if key not in localizers:
                    place = document.place((*part.keys, name, key))
                    hint = nearest_or_all(key, localizers, "localizers")
                    yield f"{place}: no localizer is called {key!r}{hint}, so this changes nothing"


def _names_localizers(annotation: object) -> bool:
    keys = get_args(annotation)[:1]
    return any(isinstance(mark, IsLocalizer) for key in keys for mark in getattr(key, "__metadata__", ()))


def refuse_outputs_elsewhere(parts: Iterable[PartEntry[Any]], document: Document, problems: Problems) -> None:
    """Note every `OutputPath` of a config file that leads out of the file's folder, by links too."""
    home = document.base_dir.resolve()
    for part in parts:
        for name, path in _outputs(part.config):
            keys = (*part.keys, name)
            is_in_file = document.line(keys) is not None
            if is_in_file and not path.resolve().is_relative_to(home):
                problems.add(
                    keys,
                    f"{path} lies outside of the config's folder; to write there, say --set {_key_path(keys)}=...",
                )


def _outputs(config: PluginConfig) -> Iterator[tuple[str, Path]]:
    for name, field in type(config).model_fields.items():
        value = getattr(config, name)
        if isinstance(value, Path) and any(_is_output(part) for part in (*field.metadata, field.annotation)):
            yield name, value


def _is_output(annotation: Any) -> bool:
    """Return whether a type, or one of those that it is made of, is an `OutputPath`."""
    if isinstance(annotation, IsWritten):
        return True
    return any(_is_output(part) for part in (*get_args(annotation), *getattr(annotation, "__metadata__", ())))


def _key_path(keys: Iterable[object]) -> str:
    return ".".join(map(str, keys))
