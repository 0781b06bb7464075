"""Reading the parts of a config: each with the model of the plugin that it names."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeVar

import trailmark.frames
from trailmark.config.base import UNNAMED, PluginConfig, SourceConfig, sensor_roles
from trailmark.config.calibrations import read_calibration, with_absolute_files
from trailmark.config.document import Document, Keys, Problems, kind_at
from trailmark.config.explain import key_names, validate_at
from trailmark.config.host import DEFAULT_PLUGINS, HOST_OPTIONS, RESERVED_NAMES, NoOptions
from trailmark.config.run import LocalizerEntry, PartEntry, SourceEntry
from trailmark.errors import ConfigError, PluginError
from trailmark.plugins import Kind, Registry, Spec

__all__ = ["PartReader", "part_document"]

Entry = TypeVar("Entry", bound=PartEntry[Any])

_NAME = re.compile(r"[a-z][a-z0-9_]*")


class PartReader:
    """Reads parts and notes what is wrong with them.

    Validation starts from the plugin's name, so that an error speaks of that plugin's keys alone.

    Parameters
    ----------
    document : Document
        The config.
    registry : Registry
        The parts that there are.
    problems : Problems
        Collects what is wrong.
    """

    def __init__(self, document: Document, registry: Registry, problems: Problems) -> None:
        self._document = document
        self._registry = registry
        self._problems = problems

    def sources(self) -> dict[str, SourceEntry]:
        """Read the frame sources, with the calibrations and the faults that they name."""
        entries = self._entries_by_name("sources", SourceEntry)
        return {name: self._with_faults(self._with_calibration(entry)) for name, entry in entries.items()}

    def localizers(self) -> dict[str, LocalizerEntry]:
        """Read the localizers."""
        return self._entries_by_name("localizers", LocalizerEntry)

    def sinks(self) -> list[PartEntry[NoOptions]]:
        """Read the list of sinks; each is called like its plugin, a second one of the same plugin ``NAME_2``."""
        raw = self._document.data.get("sinks")
        if not isinstance(raw, list | tuple):
            return []
        read = [self._one(("sinks", index), "", item, PartEntry) for index, item in enumerate(raw)]
        count: Counter[str] = Counter()
        entries = []
        for entry in (entry for entry in read if entry is not None):
            plugin = entry.spec.name
            count[plugin] += 1
            entries.append(replace(entry, name=plugin if count[plugin] == 1 else f"{plugin}_{count[plugin]}"))
        return entries

    def single(self, kind: Kind, entry_class: type[Entry], is_needed: bool = False) -> Entry | None:
        """Read a section that is one part; None where it is left out and not needed."""
        raw = self._document.data.get(kind)
        if raw is None and not is_needed:
            return None
        return self._one((kind,), kind, {} if raw is None else raw, entry_class)

    def _entries_by_name(self, section: str, entry_class: type[Entry]) -> dict[str, Entry]:
        raw = self._document.data.get(section)
        if not isinstance(raw, Mapping):
            return {}
        entries = {str(name): self._one((section, name), str(name), item, entry_class) for name, item in raw.items()}
        for name in entries:
            self.check_name((section, name), name)
        return {name: entry for name, entry in entries.items() if entry is not None}

    def _one(self, keys: Keys, name: str, raw: Any, entry_class: type[Entry]) -> Entry | None:
        """Read one part; None if anything is wrong with it."""
        kind = kind_at(keys)
        assert kind is not None
        if not isinstance(raw, Mapping):
            self._problems.add(keys, "must be a mapping with the key 'plugin', or the name of a plugin")
            return None
        spec = self._spec(keys, kind, raw)
        model = None if spec is None else self._model(keys, kind, spec)
        if spec is None or model is None:
            return None
        host = HOST_OPTIONS[kind]
        theirs = ["plugin", *key_names(host)]
        given = {key: value for key, value in raw.items() if key in theirs and key != "plugin"}
        own = {key: value for key, value in raw.items() if key not in theirs}
        options = validate_at(host, given, keys, self._problems, self._document.base_dir)
        config = validate_at(model, own, keys, self._problems, self._document.base_dir, also=theirs)
        if options is None or config is None:
            return None
        return entry_class(
            name=name,
            spec=spec,
            config=config,
            options=options,
            keys=keys,
            place=self._document.place(keys),
            document=part_document(str(raw.get("plugin", spec.name)), config, options, self._document),
        )

    def _with_calibration(self, entry: SourceEntry) -> SourceEntry:
        return replace(entry, calibration=self.calibration((*entry.keys, "calibration"), entry.config.calibration))

    def _with_faults(self, entry: SourceEntry) -> SourceEntry:
        if entry.config.perturb is None:
            return entry
        from trailmark.config.faults import FaultReader  # most sources are as good as they come

        reader = FaultReader(self._document, self._registry, self._problems)
        found = reader.read((*entry.keys, "perturb"), entry.config.perturb)
        if found is None:
            return entry
        document = entry.document | {"perturb": found.document}
        return replace(entry, faults=found.entries, perturbed=found.sensors, document=document)

    def calibration(self, keys: Keys, value: Any) -> trailmark.frames.Calibration | None:
        """Read a calibration; None where none is given or it cannot be read."""
        if value is None:
            return None
        try:
            return read_calibration(value, self._document.base_dir)
        except ConfigError as error:
            self._problems.add(keys, str(error))
            return None

    def check_name(self, keys: Keys, name: str) -> None:
        """Note a name that files or messages could not carry."""
        if not _NAME.fullmatch(name):
            self._problems.add(keys, f"the name {name!r} must be lower-case letters, digits and _, a letter first")
        elif name in RESERVED_NAMES:
            self._problems.add(keys, f"the name {name!r} is reserved: a run's files use it")

    def _spec(self, keys: Keys, kind: Kind, raw: Mapping[str, Any]) -> Spec | None:
        name = raw.get("plugin", DEFAULT_PLUGINS.get(kind))
        if name is None:
            available = ", ".join(self._registry.names(kind)) or "none"
            self._problems.add(keys, f"missing key 'plugin'; {kind}s: {available}")
            return None
        if not isinstance(name, str):
            self._problems.add((*keys, "plugin"), f"must be the name of a plugin, not {name!r}")
            return None
        try:
            return self._registry.find(kind, name)
        except PluginError as error:
            self._problems.add((*keys, "plugin"), str(error))
            return None

    def _model(self, keys: Keys, kind: Kind, spec: Spec) -> type[PluginConfig] | None:
        wanted: type[PluginConfig] = SourceConfig if kind == "source" else PluginConfig
        try:
            model = spec.load_config() if spec.config or kind != "source" else SourceConfig
        except PluginError as error:
            self._problems.add((*keys, "plugin"), str(error))
            return None
        clash = {"plugin", *key_names(HOST_OPTIONS[kind])} & set(key_names(model))
        if clash or not issubclass(model, wanted):
            why = f"uses the host's own keys {sorted(clash)}" if clash else f"is no {wanted.__name__}"
            self._problems.add((*keys, "plugin"), f"the config of {spec.name!r} of {spec.origin} {why}")
            return None
        return model


def part_document(plugin: str, config: PluginConfig, options: PluginConfig, written: Document) -> dict[str, Any]:
    """Return a part as a config would give it: every default filled in, roles left to the host left out."""
    own = config.model_dump(mode="json", by_alias=True)
    unnamed = [name for name in sensor_roles(type(config)) if getattr(config, name) == UNNAMED]
    kept = {key: value for key, value in own.items() if key not in unnamed}
    if isinstance(config, SourceConfig) and config.calibration is not None:
        kept["calibration"] = with_absolute_files(kept["calibration"], written.base_dir)
    return {"plugin": plugin, **kept, **options.model_dump(mode="json", by_alias=True)}
