"""From what was written to a `RunConfig`, or to one line for each thing that is wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trailmark.config.calibrations import with_absolute_files
from trailmark.config.checks import (
    check_classes,
    check_motion,
    check_use,
    notices_of_strangers,
    refuse_outputs_elsewhere,
)
from trailmark.config.document import Document, Problems, read_document
from trailmark.config.explain import validate_at
from trailmark.config.host import NoOptions, PluginsSection, RunSettings, SensorSection
from trailmark.config.parts import PartReader
from trailmark.config.requirements import unmet
from trailmark.config.run import (
    EstimatorEntry,
    LocalizerEntry,
    PartEntry,
    PathStoreEntry,
    RunConfig,
    SensorOverride,
    SourceEntry,
)
from trailmark.errors import ConfigError
from trailmark.interfaces import Mode
from trailmark.plugins import Plugins

__all__ = ["load_run_config"]


def load_run_config(
    config: str | Path | Mapping[str, Any] | Document,
    *,
    plugins: Plugins,
    overrides: Sequence[str | tuple[str, Any]] = (),
    mode: Mode | None = None,
    base_dir: Path | None = None,
) -> RunConfig:
    """Read, check and resolve a config.

    Parameters
    ----------
    config : path, mapping or Document
        A YAML or TOML file, or the same as plain data.
    plugins : Plugins
        What may be named.
    overrides : sequence of str or (str, value)
        ``"localizers.floor.plugin=klt"`` with the value in YAML, or keys and a value.
    mode : str, optional
        Set by the commands; wins over the config's.
    base_dir : Path, optional
        Where relative paths start; default: the file's folder, for a mapping the working folder.

    Raises
    ------
    ConfigError
        With one line for everything that is wrong: where it stands, what it is, the nearest right name.
    """
    document = read_document(config, base_dir)
    changes = [*overrides, *([("mode", mode)] if mode else [])]
    problems = Problems(document)
    usable = _usable_plugins(document, plugins, problems)
    notices: tuple[str, ...] = ()
    if changes:
        from trailmark.config.overrides import with_overrides  # of a command line, or of a bench

        document, notices = with_overrides(document, changes, usable.registry)
    else:
        document = document.expanded()
    problems = Problems(document)
    usable = _usable_plugins(document, plugins, problems)
    return _RunReader(document, usable, notices, problems).read()


def _usable_plugins(document: Document, plugins: Plugins, problems: Problems) -> Plugins:
    raw = document.data.get("plugins")
    if not isinstance(raw, Mapping):
        return plugins
    section = validate_at(PluginsSection, raw, ("plugins",), problems, document.base_dir)
    if section is None:
        return plugins
    for index, requirement in enumerate(section.require):
        if story := unmet(requirement):
            problems.add(("plugins", "require", index), story)
    try:
        return plugins.restricted(section.enable, section.block)
    except ConfigError as error:
        problems.add(("plugins",), str(error))
        return plugins


@dataclass(frozen=True, slots=True)
class _Sections:
    """A document's sections, each read and validated by itself; None and missing parts where something is wrong."""

    settings: RunSettings | None
    sources: dict[str, SourceEntry]
    sensors: dict[str, SensorOverride]
    sensor_documents: dict[str, Any]
    localizers: dict[str, LocalizerEntry]
    estimator: EstimatorEntry | None
    path_store: PathStoreEntry | None
    controller: PartEntry[NoOptions] | None
    sinks: list[PartEntry[NoOptions]]

    @property
    def parts(self) -> list[PartEntry[Any]]:
        """All parts that could be read."""
        single = [self.path_store, self.controller, self.estimator]
        faults = [fault for source in self.sources.values() for fault in source.faults]
        several = [*self.sources.values(), *faults, *self.localizers.values(), *self.sinks]
        return [*several, *(part for part in single if part is not None)]


class _RunReader:
    """Reads a document section by section, so that one wrong section hides no other."""

    def __init__(self, document: Document, plugins: Plugins, notices: tuple[str, ...], problems: Problems) -> None:
        self._written = document
        self._plugins = plugins
        self._notices = notices
        self._problems = problems
        self._parts = PartReader(document, plugins.registry, problems)

    def read(self) -> RunConfig:
        sections = self._sections()
        self._check(sections)
        assert sections.settings is not None  # otherwise there was a problem, and it was raised
        assert sections.estimator is not None
        return RunConfig(
            settings=sections.settings,
            sources=sections.sources,
            sensors=sections.sensors,
            localizers=sections.localizers,
            estimator=sections.estimator,
            path_store=sections.path_store,
            controller=sections.controller,
            sinks=tuple(sections.sinks),
            base_dir=self._written.base_dir,
            plugins=self._plugins,
            document=_resolved_document(sections.settings, sections),
            notices=(*self._notices, *notices_of_strangers(sections.parts, sections.localizers, self._written)),
            written=self._written,
        )

    def _sections(self) -> _Sections:
        settings = self._settings()
        needs_store = settings is not None and settings.mode != "track"
        sensors, sensor_documents = self._sensors()
        return _Sections(
            settings=settings,
            sources=self._parts.sources(),
            sensors=sensors,
            sensor_documents=sensor_documents,
            localizers=self._parts.localizers(),
            estimator=self._parts.single("estimator", EstimatorEntry, is_needed=True),
            path_store=self._parts.single("path_store", PathStoreEntry, is_needed=needs_store),
            controller=self._parts.single("controller", PartEntry),
            sinks=self._parts.sinks(),
        )

    def _settings(self) -> RunSettings | None:
        given = {key: value for key, value in self._written.data.items() if value is not None}
        return validate_at(RunSettings, given, (), self._problems, self._written.base_dir)

    def _sensors(self) -> tuple[dict[str, SensorOverride], dict[str, Any]]:
        raw = self._written.data.get("sensors")
        overrides: dict[str, SensorOverride] = {}
        documents: dict[str, Any] = {}
        for name, entry in raw.items() if isinstance(raw, Mapping) else ():
            keys = ("sensors", name)
            self._parts.check_name(keys, str(name))
            if not isinstance(entry, Mapping):
                self._problems.add(keys, "must be a mapping with the keys 'mounting' and 'calibration'")
                continue
            section = validate_at(SensorSection, entry, keys, self._problems, self._written.base_dir)
            if section is not None:
                calibration = self._parts.calibration((*keys, "calibration"), section.calibration)
                overrides[str(name)] = SensorOverride(section.mounting, calibration)
                dumped = section.model_dump(mode="json", exclude_none=True)
                documents[str(name)] = with_absolute_files(dumped, self._written.base_dir)
        return overrides, documents

    def _check(self, sections: _Sections) -> None:
        """Raise the problems: first those of the text, then those that only imported classes show."""
        raw = self._written.data.get("localizers")
        names = [str(name) for name in raw] if isinstance(raw, Mapping) else []
        if sections.estimator is not None:
            check_use(names, sections.estimator, self._problems)
        refuse_outputs_elsewhere(sections.parts, self._written, self._problems)
        self._problems.raise_if_any()
        if sections.estimator is not None:
            check_motion(sections.localizers, sections.estimator, self._problems)
        check_classes(sections.parts, self._problems)
        self._problems.raise_if_any()


def _resolved_document(settings: RunSettings, sections: _Sections) -> dict[str, Any]:
    """Return the config with all defaults, in the order of the settings."""
    single = {"estimator": sections.estimator, "path_store": sections.path_store, "controller": sections.controller}
    parts: dict[str, Any] = {
        "sources": {name: part.document for name, part in sections.sources.items()},
        "sensors": sections.sensor_documents,
        "localizers": {name: part.document for name, part in sections.localizers.items()},
        "sinks": [part.document for part in sections.sinks],
    }
    parts |= {key: None if part is None else part.document for key, part in single.items()}
    return {key: parts.get(key, value) for key, value in settings.model_dump(mode="json").items()}
