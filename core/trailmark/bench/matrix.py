"""From a bench config to its cells."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from itertools import product
from pathlib import Path
from typing import Any

from trailmark.bench.cell import Cell
from trailmark.bench.config import AXES, BenchSection, CellsSection, Limits
from trailmark.bench.fingerprint import FileCache, code_of, digest_of, files_in_document, fingerprint, without_paths
from trailmark.bench.overlay import overlaid
from trailmark.config import Document, RunConfig, load_run_config, read_document
from trailmark.config.document import Keys, Problems
from trailmark.config.explain import validated
from trailmark.config.files import resolved
from trailmark.config.overrides import with_overrides
from trailmark.config.sections import expand_shorthand
from trailmark.errors import ConfigError
from trailmark.plugins import Plugins
from trailmark.plugins.hints import nearest_or_all

__all__ = ["Bench", "load_bench"]

#: Changes of what a cell means or how it is measured: older results then have other addresses.
FORMAT = 1

_HEX = 20

# Keys of a value of an axis that are the bench's, not those of a part.
_OWN_KEYS = ("about", "limits", "needs", "teach")


@dataclass(frozen=True, slots=True, eq=False)
class Bench:
    """A bench that was read.

    Attributes
    ----------
    section : BenchSection
        What was written under ``bench:``.
    cells : tuple of Cell
        In the order of the matrices: the last axis, the seed, changes first.
    notices : tuple of str
        What the reader should know.
    name : str
        Of the file.
    """

    section: BenchSection
    cells: tuple[Cell, ...]
    notices: tuple[str, ...] = ()
    name: str = "bench"


@dataclass(frozen=True, slots=True, eq=False)
class _Value:
    """One value of an axis, as a piece of a run config."""

    axis: str
    name: str
    piece: dict[str, Any]
    keys: Keys = ()
    where: Keys = ()
    teach: dict[str, Any] | None = None
    missing: str = ""
    limits: dict[str, Any] = field(default_factory=dict)
    about: str = ""


@dataclass(slots=True)
class _Combination:
    """Values of all axes but the seed, with the run that they make."""

    document: dict[str, Any] = field(default_factory=dict)
    teach: dict[str, Any] | None = None
    code: dict[str, str] = field(default_factory=dict)
    data: dict[str, str] = field(default_factory=dict)
    limits: dict[str, Any] = field(default_factory=dict)
    first_localizer: str = ""


def load_bench(
    config: str | Path | Mapping[str, Any] | Document,
    *,
    plugins: Plugins,
    overrides: Sequence[Any] = (),
    only: Sequence[str] = (),
    files: Sequence[str] = (),
    block: Sequence[str] = (),
    cache: FileCache | None = None,
) -> Bench:
    """Read a bench config and return its cells, each checked as a run config is.

    Parameters
    ----------
    config : path, mapping or Document
        What was written.
    plugins : Plugins
        What may be named.
    overrides : sequence of str
        As ``--set``, for the whole file.
    only : sequence of str
        ``axis=pattern``: cells whose value fits, of several patterns of one axis any.
    files, block : sequence of str
        One-file plugins to load, and plugins not to load, in the process of a cell.
    cache : dict, optional
        Digests of files, kept between runs.

    Raises
    ------
    ConfigError
        With one line for everything that is wrong.
    """
    document, notices = with_overrides(read_document(config), overrides, plugins.registry)
    section = _section(document)
    wanted = _Only.read(only)
    found = list(notices)
    cells: list[Cell] = []
    shared = {key: value for key, value in document.data.items() if key != "bench"}
    if shared.pop("sinks", None):
        found.append("sinks: left out; cells that run side by side would write over each other")
    cache = {} if cache is None else cache
    session = {"plugins": {"files": [str(Path(file).resolve()) for file in files], "block": list(block)}}
    for index, matrix in enumerate(section.matrices):
        where: Keys = ("bench", "cells", index) if isinstance(section.cells, tuple) else ("bench", "cells")
        reader = _MatrixReader(document, shared, section, matrix, where, plugins, cache, session)
        cells += reader.cells(wanted)
        found += reader.notices
    wanted.refuse_unused()
    return Bench(section, _without_twins(cells, found), tuple(dict.fromkeys(found)), Path(document.name).stem)


def _section(document: Document) -> BenchSection:
    problems = Problems(document)
    raw = document.data.get("bench")
    if not isinstance(raw, Mapping):
        raise ConfigError(
            f"{document.name}: this is no bench: add a section 'bench:', for example"
            " bench: {cells: {localizers: [ground_vo, klt], seeds: 5}, baseline: klt}"
        )
    section = validated(BenchSection, raw, ("bench",), problems, document.base_dir)
    problems.raise_if_any()
    assert section is not None
    names = [matrix.name for matrix in section.matrices]
    if len(set(names)) < len(names):
        raise ConfigError(f"{document.place(('bench', 'cells'))}: several matrices need a 'name' each, all different")
    return section


def _without_twins(cells: Sequence[Cell], notices: list[str]) -> tuple[Cell, ...]:
    """Keep one cell of each address; two of one address differ in name alone."""
    first: dict[str, Cell] = {}
    for cell in cells:
        twin = first.setdefault(cell.id, cell)
        if twin is not cell:
            notices.append(f"'{cell.label}' is the same run as '{twin.label}': it is not run twice")
    return tuple(first.values())


class _Only:
    """``--only axis=pattern``: which cells are meant."""

    def __init__(self, patterns: Mapping[str, list[str]]) -> None:
        self._patterns = patterns
        self._used: set[tuple[str, str]] = set()

    @classmethod
    def read(cls, only: Sequence[str]) -> _Only:
        axes = ["matrix", *AXES.values(), "seed"]
        patterns: dict[str, list[str]] = {}
        for item in only:
            axis, equals, pattern = item.partition("=")
            if not equals or not pattern:
                raise ConfigError(f"--only {item}: write AXIS=NAME, for example --only localizer=klt")
            if axis not in axes:
                raise ConfigError(f"--only {item}: no axis is called {axis!r}{nearest_or_all(axis, axes, 'axes')}")
            patterns.setdefault(axis, []).extend(pattern.split(","))
        return cls(patterns)

    def keeps(self, matrix: str, coordinates: Mapping[str, Any]) -> bool:
        known = {"matrix": matrix, **coordinates}
        fits = [self._any(axis, patterns, known) for axis, patterns in self._patterns.items()]  # notes all of them
        return all(fits)

    def refuse_unused(self) -> None:
        """Refuse patterns that no cell fits: a misspelt name would leave an empty bench."""
        for axis, patterns in self._patterns.items():
            for pattern in patterns:
                if (axis, pattern) not in self._used:
                    raise ConfigError(f"--only {axis}={pattern}: no cell has such a {axis}")

    def _any(self, axis: str, patterns: Sequence[str], known: Mapping[str, Any]) -> bool:
        fits = [pattern for pattern in patterns if axis in known and fnmatchcase(str(known[axis]), pattern)]
        self._used |= {(axis, pattern) for pattern in fits}
        return bool(fits)


class _MatrixReader:
    """Reads one matrix."""

    def __init__(
        self,
        document: Document,
        shared: Mapping[str, Any],
        section: BenchSection,
        matrix: CellsSection,
        where: Keys,
        plugins: Plugins,
        cache: FileCache,
        session: Mapping[str, Any],
    ) -> None:
        self._document = document
        self._section = section
        self._matrix = matrix
        self._where = where
        self._plugins = plugins
        self._cache = cache
        self._session = session
        self._base = overlaid(shared, matrix.config)
        self._problems = Problems(document)
        self.notices: list[str] = []

    def cells(self, only: _Only) -> list[Cell]:
        """Return the cells that are asked for."""
        axes = [values for axis in AXES if (values := self._values(axis))]
        self._problems.raise_if_any()
        rules = self._exclusions({found[0].axis: [value.name for value in found] for found in axes})
        self._problems.raise_if_any()
        cells: list[Cell] = []
        for combination in product(*axes):
            values = list(combination)
            coordinates = {AXES[value.axis]: value.name for value in values}
            seeds = [
                seed
                for seed in self._seeds()
                if not any(_fits(rule, {**coordinates, "seed": seed}) for rule in rules)
                and only.keeps(self._matrix.name, {**coordinates, "seed": seed})
            ]
            if seeds:
                cells += self._of(values, coordinates, seeds)
        return cells

    def _seeds(self) -> tuple[int, ...]:
        seeds = self._matrix.seeds
        first = int(self._base.get("seed") or 0)
        return tuple(range(first, first + seeds)) if isinstance(seeds, int) else seeds

    # --- values of axes ------------------------------------------------------------------------------------------

    def _values(self, axis: str) -> list[_Value]:
        written: dict[str, Any] = dict(getattr(self._matrix, axis))
        keys: Keys = (*self._where, axis)
        if axis == "localizers" and self._matrix.installed is not None:
            written |= self._installed(written)
        found = [self._value(axis, str(name), value, (*keys, name)) for name, value in written.items()]
        return [value for value in found if value is not None]

    def _installed(self, written: Mapping[str, Any]) -> dict[str, Any]:
        """Return the localizers that are installed and can be had without a word, by name."""
        wanted = self._matrix.installed
        assert wanted is not None
        named = {value.get("plugin") for value in written.values() if isinstance(value, Mapping)}
        found: dict[str, Any] = {}
        for spec in self._plugins.registry.specs("localizer"):
            is_wanted = not spec.gives or spec.gives & set(wanted.gives)
            if is_wanted and spec.name not in {*named, *wanted.leave_out, *written}:
                try:
                    spec.load_config()()
                    spec.load()
                except Exception as error:  # a stranger's plugin: whatever is wrong is no matter of this bench
                    self.notices.append(f"localizer {spec.name!r} is left out: {str(error).splitlines()[0]}")
                else:
                    found[spec.name] = {"plugin": spec.name}
        return found

    def _value(self, axis: str, name: str, value: Any, keys: Keys) -> _Value | None:
        if isinstance(value, str):
            value = {"plugin": value}
        if not isinstance(value, Mapping):
            self._problems.add(keys, f"must be a mapping, not {value!r}")
            return None
        own = {key: value[key] for key in _OWN_KEYS if key in value}
        content = {key: deepcopy(item) for key, item in value.items() if key not in _OWN_KEYS}
        teach = own.get("teach")
        if teach is not None and not isinstance(teach, Mapping):
            self._problems.add((*keys, "teach"), f"must be a mapping, not {teach!r}")
            return None
        piece, run_keys, where = self._piece(axis, name, content, keys)
        missing = self._missing(own.get("needs", ()), keys)
        limits = self._limits(own.get("limits", {}), (*keys, "limits"))
        about = str(own.get("about", ""))
        if about and about not in piece.get("localizers", {}):
            hint = nearest_or_all(about, piece.get("localizers", {}), "localizers of it")
            self._problems.add((*keys, "about"), f"no localizer is called {about!r}{hint}")
        teach = None if teach is None else dict(teach)
        return _Value(axis, name, piece, run_keys, where, teach, missing, limits, about)

    def _piece(self, axis: str, name: str, content: dict[str, Any], keys: Keys) -> tuple[dict[str, Any], Keys, Keys]:
        """Return a value as a piece of a run config, and which keys of it stand where."""
        match axis:
            case "sources" | "localizers":
                if "plugin" in content:
                    return {axis: {name: content}}, (axis, name), keys
                return {axis: content}, (axis,), keys
            case "estimators" | "controllers":
                return {axis[:-1]: content}, (axis[:-1],), keys
            case "perturbations":
                return {"perturb": content}, ("perturb",), keys
        return content, (), keys

    def _limits(self, written: Any, keys: Keys) -> dict[str, Any]:
        """Return the limits that a value has for itself."""
        if not isinstance(written, Mapping):
            self._problems.add(keys, f"must be a mapping, not {written!r}")
            return {}
        limits = validated(Limits, written, keys, self._problems, self._document.base_dir)
        return {} if limits is None else limits.model_dump(mode="json", exclude_unset=True)

    def _missing(self, needs: Any, keys: Keys) -> str:
        paths = [needs] if isinstance(needs, str) else list(needs)
        for path in paths:
            try:
                found = resolved(str(path), self._document.base_dir)
            except ValueError as error:
                return str(error)
            if not os.path.exists(found):
                return f"needs {found}, which is not there"
        return ""

    # --- exclusions ----------------------------------------------------------------------------------------------

    def _exclusions(self, names: Mapping[str, Sequence[str]]) -> list[Mapping[str, Any]]:
        """Return the exclusions, with every name in them checked; those of the whole bench may name other matrices."""
        rules: list[Mapping[str, Any]] = []
        known: dict[str, Sequence[str]] = {AXES[axis]: values for axis, values in names.items()}
        known["seed"] = [str(seed) for seed in self._seeds()]
        for index, rule in enumerate(self._matrix.exclude):
            self._check_rule(rule, known, (*self._where, "exclude", index))
            rules.append(rule)
        for index, rule in enumerate(self._section.exclude):
            axes = ["matrix", *AXES.values(), "seed"]
            for axis in rule:
                if axis not in axes:
                    hint = nearest_or_all(str(axis), axes, "axes")
                    self._problems.add(("bench", "exclude", index), f"no axis is called {axis!r}{hint}")
            if "matrix" not in rule or _is_meant(rule["matrix"], self._matrix.name):
                rules.append({axis: value for axis, value in rule.items() if axis != "matrix"})
        return rules

    def _check_rule(self, rule: Mapping[str, Any], known: Mapping[str, Sequence[str]], keys: Keys) -> None:
        for axis, value in rule.items():
            if axis not in known:
                self._problems.add(keys, f"no axis is called {axis!r}{nearest_or_all(str(axis), known, 'axes')}")
                continue
            for name in value if isinstance(value, list | tuple) else [value]:
                if not any(fnmatchcase(candidate, str(name)) for candidate in known[axis]):
                    hint = nearest_or_all(str(name), known[axis], f"{axis}s")
                    self._problems.add((*keys, axis), f"no {axis} is called {name!r}{hint}")

    # --- runs ----------------------------------------------------------------------------------------------------

    def _of(self, values: Sequence[_Value], coordinates: Mapping[str, Any], seeds: Sequence[int]) -> list[Cell]:
        missing = next((value.missing for value in values if value.missing), "")
        if missing:
            return [self._missing_cell(coordinates, seed, missing) for seed in seeds]
        combination = self._combined(values)
        return [self._cell(combination, {**coordinates, "seed": seed}) for seed in seeds]

    def _combined(self, values: Sequence[_Value]) -> _Combination:
        clean, perturb = self._laid_together(values)
        teaching = [self._section.teach, self._matrix.teach, *(value.teach for value in values)]
        taught = [piece for piece in teaching if piece is not None]
        run = _perturbed(clean, perturb) if perturb else clean
        if taught and "mode" not in run:
            run["mode"] = "replay"
        origins = [(value.keys, value.where) for value in values if value.keys]
        loaded = self._loaded(run, origins)
        combination = _Combination(loaded.document, code=self._code(loaded))
        combination.limits = self._section.limits.model_dump(mode="json")
        for value in values:
            combination.limits |= value.limits
        combination.first_localizer = next(iter(self._first_localizer(values, loaded)), "")
        if taught:
            lesson = clean
            for piece in taught:
                lesson = overlaid(lesson, piece)
            learned = self._loaded(lesson | {"mode": "teach"}, origins)
            combination.teach = learned.document
            combination.code |= self._code(learned)
        for path in files_in_document([combination.document, combination.teach]):
            combination.data[path] = fingerprint(path, self._cache)
        return combination

    def _laid_together(self, values: Sequence[_Value]) -> tuple[dict[str, Any], dict[str, Any]]:
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

    def _first_localizer(self, values: Sequence[_Value], loaded: RunConfig) -> Iterator[str]:
        for value in values:
            if value.axis == "localizers":
                yield from [value.about] if value.about else value.piece["localizers"]
        yield from loaded.localizers

    def _loaded(self, data: dict[str, Any], origins: Sequence[tuple[Keys, Keys]]) -> RunConfig:
        """Load a run; what is wrong with it is told at the lines of the bench config."""

        def line_of(keys: Keys) -> int | None:
            for at, where in origins:
                if keys[: len(at)] == at:
                    line = self._document.line_of((*where, *keys[len(at) :]))
                    if line is not None:
                        return line
            return self._document.line_of(keys)

        document = Document(data, self._document.name, self._document.base_dir, line_of)
        loaded = load_run_config(document, plugins=self._plugins)
        if not loaded.sources:
            raise ConfigError(f"{self._document.name}: a cell has no sources: name them under cells, or for all cells")
        if not loaded.localizers:
            raise ConfigError(f"{self._document.name}: a cell has no localizers: name them under cells, or for all")
        loaded.document.pop("sinks", None)
        return loaded

    def _code(self, loaded: RunConfig) -> dict[str, str]:
        single = [loaded.estimator, loaded.path_store, loaded.controller]
        entries = [*loaded.sources.values(), *loaded.localizers.values(), *(entry for entry in single if entry)]
        metrics = loaded.plugins.registry.specs("metric")
        specs = [*(entry.spec for entry in entries), *metrics]
        return code_of(specs, source=self._section.code == "source")

    def _cell(self, combination: _Combination, coordinates: dict[str, Any]) -> Cell:
        seed = coordinates["seed"]
        document = combination.document | {"seed": seed}
        teach = None if combination.teach is None else combination.teach | {"seed": seed}
        judging = self._section.judging.model_dump(mode="json")
        subject = combination.first_localizer if judging["trajectory"] == "localizer" else "fused"
        address = {
            "format": FORMAT,
            "run": _addressed(document, combination.data),
            "teach": None if teach is None else _addressed(teach, combination.data),
            "code": combination.code,
            "judging": judging | {"subject": subject},
            "threads": combination.limits["threads"],
        }
        cell_id = digest_of(address)[:_HEX]
        request = {
            "id": cell_id,
            "coordinates": coordinates,
            "document": document,
            "teach": teach,
            "base_dir": str(self._document.base_dir),
            "subject": subject,
            "localizer": combination.first_localizer,
            "align": judging["align"],
            "code": combination.code,
            "data": combination.data,
            "limits": combination.limits,
            "keep_stores": self._section.keep_stores,
            **self._session,
        }
        return Cell(cell_id, self._matrix.name, coordinates, request, self._matrix.alone)

    def _missing_cell(self, coordinates: Mapping[str, Any], seed: int, missing: str) -> Cell:
        named = {**coordinates, "seed": seed}
        return Cell(
            digest_of({"missing": missing, "matrix": self._matrix.name, "cell": named})[:_HEX],
            self._matrix.name,
            named,
            {},
            missing=missing,
        )


def _perturbed(document: Mapping[str, Any], perturb: Mapping[str, Any]) -> dict[str, Any]:
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


def _addressed(document: Mapping[str, Any], data: Mapping[str, str]) -> Any:
    """Return what of a config a result depends on."""
    kept = {key: value for key, value in document.items() if key not in ("sinks", "plugins")}
    store = kept.get("path_store")
    if isinstance(store, Mapping):
        kept["path_store"] = {key: value for key, value in store.items() if key != "path"}
    return without_paths(kept, lambda path: data[path])


def _fits(rule: Mapping[str, Any], coordinates: Mapping[str, Any]) -> bool:
    return bool(rule) and all(
        axis in coordinates and _is_meant(value, coordinates[axis]) for axis, value in rule.items()
    )


def _is_meant(value: Any, name: Any) -> bool:
    values = value if isinstance(value, list | tuple) else [value]
    return any(fnmatchcase(str(name), str(item)) for item in values)
