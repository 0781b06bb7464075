"""From a bench config to its cells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trailmark.config import Document, read_document
from trailmark.config.document import Keys, Problems
from trailmark.config.explain import validate_at
from trailmark.config.overrides import with_overrides
from trailmark.errors import ConfigError
from trailmark.isolation.fingerprint import FileCache
from trailmark.plugins import Plugins
from trailmark_bench.cell import Cell
from trailmark_bench.choice import Only
from trailmark_bench.config import BenchSection
from trailmark_bench.context import MatrixContext
from trailmark_bench.crossing import Matrix

__all__ = ["Bench", "load_bench"]


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
    wanted = Only.read(only)
    found = list(notices)
    cells: list[Cell] = []
    shared = {key: value for key, value in document.data.items() if key != "bench"}
    if shared.pop("sinks", None):
        found.append("sinks: left out; cells that run side by side would write over each other")
    cache = {} if cache is None else cache
    session = {"plugins": {"files": [str(Path(file).resolve()) for file in files], "block": list(block)}}
    for index, matrix in enumerate(section.matrices):
        where: Keys = ("bench", "cells", index) if isinstance(section.cells, tuple) else ("bench", "cells")
        crossed = Matrix(MatrixContext(document, section, matrix, where, plugins, cache, session), shared)
        cells += crossed.cells(wanted)
        found += crossed.notices
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
    section = validate_at(BenchSection, raw, ("bench",), problems, document.base_dir)
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
