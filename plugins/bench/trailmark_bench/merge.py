"""Putting benches together: what has the same address is the same cell, whichever machine ran it."""

from __future__ import annotations

import re
import shutil
import stat
from collections.abc import Collection, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from trailmark.errors import ConfigError, DataError
from trailmark_bench.cell import Cell
from trailmark_bench.index import INDEX_FILE, CellRecord, Index
from trailmark_bench.results import CELLS

__all__ = ["is_address", "merge_benches"]

_ADDRESS = re.compile(r"[0-9a-f]{8,64}")

# Of two outcomes of one cell, the one further left is taken.
_BEST = ("ok", "failed", "timeout", "crashed", "skipped", "running", "pending")
_NOT_RUN = ("running", "pending")

# Of a matrix, and coordinates in it.
_Name = tuple[str, frozenset[tuple[str, object]]]


def merge_benches(folders: Sequence[Path], out: Path) -> list[str]:
    """Merge benches into one folder, which may be one of them; return lines about what was done.

    A file of ``export json`` counts as the folder of a bench. Of a cell that several have, a result is taken before a
    failure, and what stands in `out` before the rest. Two results of one cell whose figures differ are told: what has
    the same address should give the same figures. Of cells with one name but several addresses (of other code, config
    or data) one is shown, by the same order; the others that were run are told, and stay in the folder.

    Raises
    ------
    ConfigError
        If a folder does not exist, or another bench works in `out`.
    DataError
        If a folder is no bench, or its index names cells by what is no address.
    """
    for folder in folders:
        if not folder.is_file() and not (folder / INDEX_FILE).is_file():
            raise DataError(f"{folder} is not the folder of a bench: it has no {INDEX_FILE}")
    others = [folder for folder in folders if folder.resolve() != out.resolve()]
    with TemporaryDirectory() as unpacked:
        opened = [_folder_of(other, Path(unpacked, str(number))) for number, other in enumerate(others)]
        with Index(out, write=True) as merged:
            shown = _ShownCells()
            hidden = shown.add(merged.records())  # what was merged by an earlier version has several of one name
            lines = [f"{out}: {hidden}"] if hidden else []
            for name, folder in zip(others, opened, strict=True):
                with Index(folder) as other:
                    done = [_take(merged, other), shown.add(other.records())]
                    lines.append(f"{name}: {'; '.join(told for told in done if told)}")
            _show(merged, shown.ids)
    return [*lines, f"{out}: {len(merged_states(out))} cells"]


def _folder_of(bench: Path, folder: Path) -> Path:
    """Return the folder of a bench; a file of results becomes one."""
    if not bench.is_file():
        return bench
    from trailmark_bench.shared import read_results

    read_results(bench, folder)
    return folder


def is_address(name: object) -> bool:
    """Return whether something is the address of a cell: hexadecimal digits, and so no path."""
    return isinstance(name, str) and _ADDRESS.fullmatch(name) is not None


def merged_states(folder: Path) -> dict[str, str]:
    """Return the states of the cells of a folder."""
    with Index(folder) as index:
        return index.states()


def _take(merged: Index, other: Index) -> str:
    known = {record.id: record for record in merged.records(everything=True)}
    taken, differing = [], []
    for record in other.records(everything=True):
        _refuse_other_names(other, record)
        ours = known.get(record.id)
        if ours is not None and ours.state == record.state == "ok" and _figures(ours) != _figures(record):
            differing.append(record.label)
        if ours is None or _BEST.index(record.state) < _BEST.index(ours.state):
            taken.append(record.id)
    for cell_id in taken:
        _copy(other.folder / CELLS / cell_id, merged.folder / CELLS / cell_id)
    merged.copy_from(other, taken)
    if not merged.meta():
        merged.set_meta(**other.meta())
    told = f"{len(taken)} cells taken over"
    if differing:
        told += f"; {len(differing)} differ in their figures from those that were there: {'; '.join(differing[:5])}"
    return told


def _refuse_other_names(index: Index, record: CellRecord) -> None:
    """Refuse what would become a path outside of the folder: a bench may come from a stranger."""
    if not is_address(record.id) or record.state not in _BEST:
        raise DataError(
            f"{index.folder / INDEX_FILE} is damaged: no cell is called {str(record.id)[:60]!r}, {record.state!r}"
        )


def _figures(record: CellRecord) -> object:
    return record.result.get("metrics")


def _copy(folder: Path, place: Path) -> None:
    if not folder.is_dir():
        return
    try:
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(folder, place, ignore=_irregular)
    except OSError as error:
        raise ConfigError(f"cannot copy {folder} to {place}: {error.strerror or error}") from error


def _irregular(folder: str, names: list[str]) -> list[str]:
    """Name links, devices and pipes: they lead out of the folder, or have no end."""
    modes = {name: Path(folder, name).lstat().st_mode for name in names}
    return [name for name, mode in modes.items() if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))]


class _ShownCells:
    """Which address is shown of each cell: that of the best outcome; of equal ones, that of the first bench."""

    def __init__(self) -> None:
        self._chosen: dict[_Name, CellRecord] = {}

    @property
    def ids(self) -> set[str]:
        """Addresses of those that are shown."""
        return {record.id for record in self._chosen.values()}

    def add(self, records: Sequence[CellRecord]) -> str:
        """Add the cells of a bench; return what is to be told of those that are not shown now."""
        hidden = []
        for record in records:
            name = _name(record)
            ours = self._chosen.get(name)
            if ours is None:
                self._chosen[name] = record
                continue
            best, other = (record, ours) if _rank(record) < _rank(ours) else (ours, record)
            self._chosen[name] = best
            if best.id != other.id and other.state not in _NOT_RUN:
                hidden.append(other.label if other.state == "ok" else f"{other.label} ({other.state})")
        if not hidden:
            return ""
        return (
            f"{len(hidden)} are not shown: they are of other code, config or data than those of the same name that"
            f" are: {'; '.join(hidden[:5])}"
        )


def _rank(record: CellRecord) -> int:
    """Return the place of an outcome, from the best; what has not run is all the same."""
    return min(_BEST.index(record.state), _BEST.index(_NOT_RUN[0]))


def _name(record: CellRecord) -> _Name:
    return record.matrix, frozenset(record.coordinates.items())


def _show(merged: Index, ids: Collection[str]) -> None:
    """Enter cells in the order of their names; those that ran elsewhere and did not end are pending."""
    records = sorted((record for record in merged.records(everything=True) if record.id in ids), key=_order)
    merged.enter([Cell(record.id, record.matrix, record.coordinates, {}) for record in records])
    merged.mark_pending([record.id for record in records if record.state == "running"])


def _order(record: CellRecord) -> tuple[str, list[tuple[bool, float, str]]]:
    values = record.coordinates.values()
    return record.matrix, [
        (isinstance(value, str), float(value) if isinstance(value, int | float) else 0.0, str(value))
        for value in values
    ]
