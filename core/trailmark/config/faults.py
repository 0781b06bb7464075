"""Reading ``perturb`` of a source: faults by name, each with the config of the plugin that brings it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import Field

from trailmark.config.base import PluginConfig
from trailmark.config.document import Document, Keys, Problems
from trailmark.config.explain import key_names, validate_at
from trailmark.config.host import DEFAULT_PLUGINS, NoOptions
from trailmark.config.run import FaultEntry
from trailmark.errors import PluginError, PluginLoadError
from trailmark.plugins import Registry, Spec
from trailmark.plugins.hints import nearest_or_all

__all__ = ["FaultReader", "PerturbOptions", "SourceFaults"]

_DEFAULT = DEFAULT_PLUGINS["fault"]


class PerturbOptions(PluginConfig):
    """What ``perturb`` takes besides faults."""

    sensors: tuple[str, ...] | None = Field(default=None, min_length=1)
    """Which sensors of the source; left out: all that a fault can befall."""


@dataclass(frozen=True, slots=True)
class SourceFaults:
    """The faults of one source, read.

    Attributes
    ----------
    sensors : tuple of str or None
        The sensors that they befall; None: all that they can.
    entries : tuple of FaultEntry
        In the order of the config, which is that in which they are applied.
    document : dict
        How they would be written out, with every default.
    """

    sensors: tuple[str, ...] | None
    entries: tuple[FaultEntry, ...]
    document: dict[str, Any]


class FaultReader:
    """Reads the faults of sources and notes what is wrong with them.

    Parameters
    ----------
    document : Document
        The config.
    registry : Registry
        The faults that there are.
    problems : Problems
        Collects what is wrong.
    """

    def __init__(self, document: Document, registry: Registry, problems: Problems) -> None:
        self._document = document
        self._registry = registry
        self._problems = problems

    def read(self, keys: Keys, written: Mapping[str, Any]) -> SourceFaults | None:
        """Return the faults of a source; None where something is wrong with them.

        The keys of the default fault stand directly under ``perturb``; it has its place where the first of them
        stands. Any other key is the name of a fault and holds that one's keys; null leaves it out.

        Parameters
        ----------
        keys : tuple
            Where ``perturb`` stands.
        written : mapping
            What stands there.
        """
        if written is None:
            return None
        own, plain = key_names(PerturbOptions), self._plain_keys()
        given = {key: value for key, value in written.items() if key in own}
        options = validate_at(PerturbOptions, given, keys, self._problems, self._document.base_dir)
        entries: dict[str, FaultEntry | None] = {}
        for name, value in written.items():
            if name in plain and _DEFAULT not in entries:
                flat = {key: inner for key, inner in written.items() if key in plain}
                entries[_DEFAULT] = self._entry(_DEFAULT, self._registry.find("fault", _DEFAULT), flat, keys)
            elif name not in (*own, *plain) and value is not None:
                spec = self._spec(name, (*keys, name), (*own, *plain))
                entries[name] = None if spec is None else self._entry(name, spec, value, (*keys, name))
        found = tuple(entry for entry in entries.values() if entry is not None)
        if options is None or len(found) < len(entries):
            return None
        document = options.model_dump(mode="json")
        for entry in found:
            document |= entry.document if entry.name == _DEFAULT else {entry.name: entry.document}
        return SourceFaults(options.sensors, found, document)

    def _plain_keys(self) -> list[str]:
        """Return the keys of the default fault, where it is installed."""
        try:
            return key_names(self._registry.find("fault", _DEFAULT).load_config())
        except PluginError:
            return []

    def _entry(self, name: str, spec: Spec, value: Any, keys: Keys) -> FaultEntry | None:
        if not isinstance(value, Mapping):
            self._problems.add(keys, f"must be a mapping of its keys, {{}} for its defaults, not {value!r}")
            return None
        try:
            model = spec.load_config()
        except PluginError as error:
            self._problems.add(keys, str(error))
            return None
        config = validate_at(model, value, keys, self._problems, self._document.base_dir)
        if config is None:
            return None
        document = config.model_dump(mode="json", by_alias=True)
        place = self._document.place(keys)
        return FaultEntry(
            name=name, spec=spec, config=config, options=NoOptions(), keys=keys, place=place, document=document
        )

    def _spec(self, name: str, keys: Keys, others: tuple[str, ...]) -> Spec | None:
        """Return the spec of a fault; a name that nothing bears may be a misspelt key as well as a misspelt fault."""
        if name == _DEFAULT:
            self._problems.add(keys, f"the keys of {name!r} stand directly under perturb")
            return None
        try:
            return self._registry.find("fault", name)
        except PluginLoadError as error:
            self._problems.add(keys, str(error))
        except PluginError as error:
            installed = self._registry.names("fault")
            self._problems.add(keys, str(error) if name in installed else _unknown(name, others, installed))
        return None


def _unknown(name: str, keys: tuple[str, ...], installed: tuple[str, ...]) -> str:
    known = (*keys, *(fault for fault in installed if fault != _DEFAULT))
    story = f"unknown key{nearest_or_all(name, known, 'keys and faults')}"
    return (
        story if _DEFAULT in installed else f"{story} (no plugin in use has {_DEFAULT!r}, whose keys would stand here)"
    )
