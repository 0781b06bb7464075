"""From values of axes to the run that they make together, and what its result depends on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

from trailmark.config import Document, RunConfig, load_run_config
from trailmark.config.document import Keys, expand_shorthand
from trailmark.errors import ConfigError
from trailmark.isolation.fingerprint import code_of, files_in_document, fingerprint
from trailmark.plugins import Spec
from trailmark_bench.axes import AxisValue
from trailmark_bench.context import MatrixContext
from trailmark_bench.overlay import overlaid

__all__ = ["Combination", "Combiner", "part_specs"]


@dataclass(slots=True)
class Combination:
    """Values of all axes but the seed, with the run that they make.

    Attributes
    ----------
    document : dict
        The run config, checked and resolved.
    teach : dict or None
        That of the teaching before it.
    code, data : dict of str to str
        Digests of plugins by name, and of files by path.
    limits : dict
        What a cell may use.
    first_localizer : str
        The one that figures are told of.
    """

    document: dict[str, Any] = field(default_factory=dict)
    teach: dict[str, Any] | None = None
    code: dict[str, str] = field(default_factory=dict)
    data: dict[str, str] = field(default_factory=dict)
    limits: dict[str, Any] = field(default_factory=dict)
    first_localizer: str = ""


class Combiner:
    """Makes runs of one matrix.

    Parameters
    ----------
    context : MatrixContext
        The matrix.
    base : dict
        The run config that all cells of the matrix share.
    """

    def __init__(self, context: MatrixContext, base: Mapping[str, Any]) -> None:
        self._context = context
        self._document = context.document
        self._base = base

    def combine(self, values: Sequence[AxisValue]) -> Combination:
        """Return the run that values make together.

        Raises
        ------
        ConfigError
            If it is none, told at the lines of the bench config.
        """
        clean, perturb = self._laid_together(values)
        teaching = [self._context.section.teach, self._context.matrix.teach, *(value.teach for value in values)]
        taught = [piece for piece in teaching if piece is not None]
        run = _with_faults(clean, perturb) if perturb else clean
        if taught and "mode" not in run:
            run["mode"] = "replay"
        origins = [(value.keys, value.where) for value in values if value.keys]
        loaded = self._load_run(run, origins)
        combination = Combination(loaded.document, code=self._code(loaded))
        combination.limits = self._context.section.limits.model_dump(mode="json")
        for value in values:
            combination.limits |= value.limits
        combination.first_localizer = next(iter(self._first_localizer(values, loaded)), "")
        if taught:
            lesson = clean
            for piece in taught:
                lesson = overlaid(lesson, piece)
            learned = self._load_run(lesson | {"mode": "teach"}, origins)
            combination.teach = learned.document
            combination.code |= self._code(learned)
        for path in files_in_document([combination.document, combination.teach]):
            combination.data[path] = fingerprint(path, self._context.cache)
        return combination

    def _laid_together(self, values: Sequence[AxisValue]) -> tuple[dict[str, Any], dict[str, Any]]:
        document = deepcopy(dict(self._base))
        perturb: dict[str, Any] = {}
        for value in values:
            if value.axis == "perturbations":
                perturb = value.piece["perturb"]
            elif value.axis in ("sources", "localizers"):
                document[value.axis] = {**(document.get(value.axis) or {}), **value.piece[value.axis]}
            else:
                document = overlaid(document, value.piece)
        expand_shorthand(document)
        return document, perturb

    def _first_localizer(self, values: Sequence[AxisValue], loaded: RunConfig) -> Iterator[str]:
        for value in values:
            if value.axis == "localizers":
                yield from [value.about] if value.about else value.piece["localizers"]
        yield from loaded.localizers

    def _load_run(self, data: dict[str, Any], origins: Sequence[tuple[Keys, Keys]]) -> RunConfig:
        """Load a run; problems are reported at the lines of the bench config."""

        def line_of(keys: Keys) -> int | None:
            for at, where in origins:
                if keys[: len(at)] == at:
                    line = self._document.line_of((*where, *keys[len(at) :]))
                    if line is not None:
                        return line
            return self._document.line_of(keys)

        document = Document(data, self._document.name, self._document.base_dir, line_of)
        loaded = load_run_config(document, plugins=self._context.plugins)
        if not loaded.sources:
            raise ConfigError(f"{self._document.name}: a cell has no sources: name them under cells, or for all cells")
        if not loaded.localizers:
            raise ConfigError(f"{self._document.name}: a cell has no localizers: name them under cells, or for all")
        loaded.document.pop("sinks", None)
        return loaded

    def _code(self, loaded: RunConfig) -> dict[str, str]:
        specs = [*part_specs(loaded), *loaded.plugins.registry.specs("metric")]
        return code_of(specs, source=self._context.section.code == "source")


def part_specs(config: RunConfig) -> list[Spec]:
    """Return the plugins that the parts of a run are of, which have a say in what it gives."""
    single = [config.estimator, config.path_store, config.controller]
    faults = [fault for source in config.sources.values() for fault in source.faults]
    several = [*config.sources.values(), *faults, *config.localizers.values()]
    return [entry.spec for entry in [*several, *(entry for entry in single if entry)]]


def _with_faults(document: Mapping[str, Any], perturb: Mapping[str, Any]) -> dict[str, Any]:
    """Return the run with sources as they are not meant to be: all of them, or those that ``of`` names."""
    names = perturb.get("of")
    wanted = [names] if isinstance(names, str) else names
    settings = {key: value for key, value in perturb.items() if key != "of"}
    sources = {
        name: {**source, "perturb": {**(source.get("perturb") or {}), **settings}}
        if isinstance(source, Mapping) and (wanted is None or name in wanted)
        else source
        for name, source in (document.get("sources") or {}).items()
    }
    return {**document, "sources": sources}
