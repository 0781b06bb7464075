"""Running the cells of a bench: what is missing, in order, as many at a time as there are places."""

from __future__ import annotations

import json
import logging
import shutil
import statistics
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from trailmark.errors import ConfigError, DataError
from trailmark.isolation.executor import Executor, Finished, Job
from trailmark.isolation.outcome import Outcome
from trailmark_bench.cell import UNSUCCESSFUL, Cell
from trailmark_bench.index import Index, Record
from trailmark_bench.process import DETAIL_FILE, OUTCOME_FILE, RESULT_FILE

__all__ = ["Progress", "Retry", "estimated_s", "run_bench", "to_run"]

logger = logging.getLogger(__name__)

CELLS = "cells"
_WORK = ".work"
_WAIT_S = 0.5

#: What ``--retry`` may say: ``failed`` means every cell that ran and gave no result.
Retry = Sequence[str]


@dataclass(slots=True)
class Progress:
    """How far a bench is.

    Attributes
    ----------
    states : dict of str to int
        Cells by state.
    running : tuple of Cell
        In work.
    left_s : float or None
        Estimate of the time that is left; None while nothing is known [s].
    finished : Cell or None
        What has just ended.
    state, reason : str
        What became of it.
    """

    states: dict[str, int] = field(default_factory=dict)
    running: tuple[Cell, ...] = ()
    left_s: float | None = None
    finished: Cell | None = None
    state: str = ""
    reason: str = ""


def to_run(cells: Sequence[Cell], states: Mapping[str, str], retry: Retry = ()) -> list[Cell]:
    """Return the cells that are to be run: those that have not been, or with `retry` only those that it names."""
    if retry:
        wanted = {state for word in retry for state in (UNSUCCESSFUL if word == "failed" else (word,))}
        return [cell for cell in cells if not cell.missing and (states.get(cell.id) in wanted or "all" in wanted)]
    return [cell for cell in cells if not cell.missing and states.get(cell.id, "pending") in ("pending", "running")]


def run_bench(
    cells: Sequence[Cell],
    index: Index,
    executor: Executor,
    *,
    retry: Retry = (),
    on_progress: Callable[[Progress], None] = lambda progress: None,
) -> None:
    """Run the cells that are missing. A finished cell is never run again, however often this is called.

    Whatever ends it (Ctrl-C, a kill, a full disk), what is finished is kept and the rest is run next time.

    Parameters
    ----------
    cells : sequence of Cell
        Of the bench.
    index : Index
        Of its folder, for writing.
    executor : Executor
        Where to run them; it is started and closed here.
    retry : sequence of str
        Run only cells in these states: ``failed``, ``timeout``, ``crashed``, ``skipped``, ``all``.
    on_progress : callable
        Told when a cell starts or ends, and now and then.

    Raises
    ------
    ConfigError
        If the executor lacks what it needs.
    DataError
        If results cannot be written.
    """
    index.enter(cells)
    _recover(cells, index)
    chosen = to_run(cells, index.states(), retry)
    if retry:
        for cell in chosen:  # or a kill in the middle would bring the old outcome back
            (index.folder / CELLS / cell.id / OUTCOME_FILE).unlink(missing_ok=True)
        index.again(cell.id for cell in chosen)
    _Round(cells, index, executor, on_progress).run(chosen)


def _recover(cells: Sequence[Cell], index: Index) -> None:
    """Put back what a killed bench left as running; take what had been finished and is not in the index."""
    shutil.rmtree(index.folder / CELLS / _WORK, ignore_errors=True)
    states = index.states()
    index.again(cell.id for cell in cells if states.get(cell.id) == "running")
    with index.together():
        for cell in cells:
            folder = index.folder / CELLS / cell.id
            if states.get(cell.id) in ("pending", "running") and (outcome := _json(folder / OUTCOME_FILE)) is not None:
                index.finished(cell.id, Outcome(**outcome), _json(folder / RESULT_FILE), _bytes(folder / DETAIL_FILE))


class _Round:
    """One call of `run_bench`."""

    def __init__(
        self, cells: Sequence[Cell], index: Index, executor: Executor, on_progress: Callable[[Progress], None]
    ) -> None:
        self._index = index
        self._executor = executor
        self._on_progress = on_progress
        self._cells = {cell.id: cell for cell in cells}
        self._running: dict[str, Cell] = {}
        self._states = {cell.id: state for cell in cells if (state := index.states().get(cell.id)) is not None}
        self._walls = _Walls(index.records(everything=True))

    def run(self, chosen: Sequence[Cell]) -> None:
        together = deque(cell for cell in chosen if not cell.alone)
        alone = deque(cell for cell in chosen if cell.alone)
        self._left = [*together, *alone]
        self._tell()
        if not chosen:
            return
        workspace = self._index.folder / CELLS / _WORK
        try:
            workspace.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"cannot write to {workspace}: {error.strerror or error}") from error
        try:
            self._executor.start(workspace)
            self._work(together, self._executor.slots)
            self._work(alone, 1)
        finally:
            self._executor.close()
            shutil.rmtree(workspace, ignore_errors=True)
            with suppress(DataError):
                self._index.again(self._running)

    def _work(self, queue: deque[Cell], slots: int) -> None:
        while queue or self._running:
            while queue and len(self._running) < slots:
                cell = queue.popleft()
                if self._states.get(cell.id) != "skipped":
                    self._begin(cell)
            for finished in self._executor.wait(_WAIT_S):
                self._take(finished)
            self._tell()

    def _begin(self, cell: Cell) -> None:
        self._index.running(cell.id)
        self._states[cell.id] = "running"
        self._running[cell.id] = cell
        self._executor.submit(Job(cell.id, cell.request))
        self._tell()

    def _take(self, finished: Finished) -> None:
        cell = self._running.pop(finished.id, None)
        if cell is None:  # an executor that lost a machine may give a result twice: the first one counts
            logger.debug("a second result of %s is not taken", finished.id)
            return
        result, detail = self._keep(finished)
        self._index.finished(cell.id, finished.outcome, result, detail)
        self._states[cell.id] = finished.outcome.state
        self._left = [other for other in self._left if other is not cell]
        self._walls.add(cell, finished.outcome.wall_s)
        self._tell(cell, finished.outcome.state, finished.outcome.reason)
        if finished.outcome.state == "skipped":
            self._skip_like(cell, finished.outcome)

    def _skip_like(self, cell: Cell, outcome: Outcome) -> None:
        """Skip what differs in seed or faults alone: neither makes a sensor that is not there."""
        alike = [other for other in self._left if _fit_of(other) == _fit_of(cell) and other.id not in self._running]
        for other in alike:
            self._index.finished(other.id, Outcome("skipped", outcome.reason))
            self._states[other.id] = "skipped"
        gone = {other.id for other in alike}
        self._left = [other for other in self._left if other.id not in gone]
        if alike:
            self._tell()

    def _keep(self, finished: Finished) -> tuple[Any, bytes | None]:
        """Move what a cell left to its place, at once; return its result and detail."""
        place = self._index.folder / CELLS / finished.id
        try:
            folder = finished.folder or _unpacked(finished, self._index.folder / CELLS / _WORK)
            (folder / OUTCOME_FILE).write_text(json.dumps(asdict(finished.outcome)), encoding="utf-8")
            if place.exists():
                shutil.rmtree(place)
            folder.rename(place)
        except OSError as error:
            raise DataError(
                f"cannot write {place}: {error.strerror or error}; finished cells are kept: run the bench again"
            ) from error
        return _json(place / RESULT_FILE), _bytes(place / DETAIL_FILE)

    def _tell(self, finished: Cell | None = None, state: str = "", reason: str = "") -> None:
        counts: dict[str, int] = {}
        for known in self._states.values():
            counts[known] = counts.get(known, 0) + 1
        left_s = self._walls.sum_s(self._left)
        slots = max(1, min(self._executor.slots if self._running else 1, len(self._left) or 1))
        left_s = None if left_s is None else left_s / slots
        self._on_progress(Progress(counts, tuple(self._running.values()), left_s, finished, state, reason))


def _fit_of(cell: Cell) -> tuple[Any, ...]:
    kept = {axis: value for axis, value in cell.coordinates.items() if axis not in ("seed", "perturbation")}
    return (cell.matrix, *kept.items())


def estimated_s(cells: Iterable[Cell], records: Sequence[Record]) -> list[float | None]:
    """Return how long each cell will take, from those like it that have run; None: nothing is known [s]."""
    walls = _Walls(records)
    return [walls.of(cell.coordinates) for cell in cells]


class _Walls:
    """How long cells take: the median of those that differ in the seed alone, in the localizer too, or of all."""

    def __init__(self, records: Sequence[Record]) -> None:
        self._known: dict[tuple[Any, ...], list[float]] = {}
        for record in records:
            if record.state == "ok" and record.wall_s is not None:
                self._note(record.coordinates, record.wall_s)

    def add(self, cell: Cell, wall_s: float) -> None:
        self._note(cell.coordinates, wall_s)

    def of(self, coordinates: Mapping[str, Any]) -> float | None:
        known = next((found for key in _kinds(coordinates) if (found := self._known.get(key))), None)
        return None if known is None else statistics.median(known)

    def sum_s(self, cells: Iterable[Cell]) -> float | None:
        known = [self.of(cell.coordinates) for cell in cells]
        return None if any(value is None for value in known) else sum(value for value in known if value is not None)

    def _note(self, coordinates: Mapping[str, Any], wall_s: float) -> None:
        for key in _kinds(coordinates):
            self._known.setdefault(key, []).append(wall_s)


def _kinds(coordinates: Mapping[str, Any]) -> list[tuple[Any, ...]]:
    unseeded = {axis: value for axis, value in coordinates.items() if axis != "seed"}
    where = {axis: value for axis, value in unseeded.items() if axis in ("source", "localizer")}
    return [tuple(unseeded.items()), tuple(where.items()), (coordinates.get("source"),), ()]


def _unpacked(finished: Finished, workspace: Path) -> Path:
    folder = workspace / f"{finished.id}-{time.monotonic_ns()}"
    folder.mkdir(parents=True)
    for name, content in finished.files.items():
        path = folder / name
        if not path.resolve().is_relative_to(folder.resolve()):
            raise OSError(f"a worker sent the file {name!r}, which lies outside of the cell's folder")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return folder


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _bytes(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None
