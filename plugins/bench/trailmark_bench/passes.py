"""A bench in pieces: each goes on from a file of results, adds to it, and notes what it has cost."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from trailmark.interruption import KEEP_S, shielded
from trailmark_bench.cell import FINISHED, Cell
from trailmark_bench.index import Index
from trailmark_bench.shared import read_results, write_results

__all__ = ["going_on_from", "known_from", "noting_pass"]


@contextmanager
def going_on_from(index: Index, cells: Sequence[Cell], path: Path, whole: Sequence[Cell] = ()) -> Iterator[str]:
    """Take what a file says of cells that have not been run here; write it anew with all that has ended, at the end.

    A cell is taken by its address, which is made of config, code, data and protocol: what is of other code is not
    taken, and no longer in the file afterwards. What a call leaves out of the same bench stays in the file.

    Parameters
    ----------
    index : Index
        Of the folder of the bench, for writing.
    cells : sequence of Cell
        That this call asks for.
    path : Path
        The file; that there is none yet is no mistake.
    whole : sequence of Cell
        Of the whole bench, where this call asks for some of it.

    Yields
    ------
    str
        What was taken.

    Raises
    ------
    DataError
        If the file is none of results, or cannot be written.
    """
    told = _take(index, cells, path, whole) if path.exists() else f"{path} is begun"
    try:
        yield told
    finally:
        with shielded(KEEP_S):
            index.enter(_asked_or_finished(cells, whole, index.states()))
            try:
                write_results(index, path, pictured=True)
            finally:
                index.enter(cells)  # tables show what was asked for


def _asked_or_finished(cells: Sequence[Cell], whole: Sequence[Cell], states: Mapping[str, str]) -> Sequence[Cell]:
    """Return the cells that belong in the file, in the order of the whole bench."""
    asked = {cell.id for cell in cells}
    return [cell for cell in whole if cell.id in asked or states.get(cell.id) in FINISHED] or cells


@contextmanager
def known_from(path: Path, own: Index | None) -> Iterator[Index]:
    """Yield a bench of what a file and a bench say together, to be looked at; neither is changed.

    Raises
    ------
    DataError
        If the file is none of results.
    """
    with TemporaryDirectory() as folder:
        read_results(path, Path(folder))
        with Index(folder, write=True) as known:
            if own is not None:
                known.copy_from(own, [cell_id for cell_id, state in own.states().items() if state in FINISHED])
            yield known


def _take(index: Index, cells: Sequence[Cell], path: Path, whole: Sequence[Cell]) -> str:
    index.enter(cells)
    ours = index.states()
    with TemporaryDirectory() as folder:
        read_results(path, Path(folder))
        with Index(folder) as other:
            theirs = other.states()
            known = [cell.id for cell in cells if cell.id in theirs]
            others = theirs.keys() - known
            staying = [cell.id for cell in whole if cell.id in others]
            index.copy_from(other, [one for one in (*known, *staying) if ours.get(one) not in FINISHED])
            index.set_meta(passes=_united(other.meta().get("passes", ()), index.meta().get("passes", ())))
    index.enter(cells)
    n_other = len(others) - len(staying)
    told = f"{len(known)} of {len(cells)} cells are known from {path}"
    told += f"; {len(staying)} in it are not asked for: they stay" * bool(staying)
    return told + f"; {n_other} in it are of other code or config: it loses them" * bool(n_other)


def _united(*passes: Sequence[object]) -> list[object]:
    """Return the passes of several benches, each once, in their order."""
    found: list[object] = []
    for one in (one for several in passes for one in several):
        if one not in found:
            found.append(one)
    return found


@contextmanager
def noting_pass(index: Index) -> Iterator[None]:
    """Note with the bench what runs in this context: how many cells, wall and processor time, commit and machine."""
    before, began_s, cpu_before_s = _cells_s(index), time.monotonic(), _cpu_s()
    try:
        yield
    finally:
        ended_s = [cpu_s for cell_id, cpu_s in _cells_s(index).items() if cell_id not in before]
        meta = index.meta()
        if ended_s:
            origin = meta.get("provenance") or {}
            # nobody has waited for processes that an interruption leaves behind: what their cells took, they told
            cpu_s = max(_cpu_s() - cpu_before_s, sum(ended_s))
            costs = {"wall_s": round(time.monotonic() - began_s, 1), "cpu_s": round(cpu_s, 1)}
            about = {key: origin.get(key) for key in ("started", "git", "cpu")}
            index.set_meta(passes=[*meta.get("passes", ()), {**about, "cells": len(ended_s), **costs}])


def _cells_s(index: Index) -> dict[str, float]:
    """Return the processor time of each cell that has ended, by its id [s]."""
    records = index.records(everything=True)
    return {record.id: record.cpu_s or 0.0 for record in records if record.state in FINISHED}


def _cpu_s() -> float:
    """Return the processor time of this process and of those that it has waited for [s]."""
    return sum(os.times()[:4])
