"""Running the cells of a bench: what is missing, in order, as many at a time as there are places."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

from trailmark.errors import DataError
from trailmark.isolation.executor import Executor, Finished, Job
from trailmark_bench.board import CellBoard
from trailmark_bench.cell import UNSUCCESSFUL, Cell
from trailmark_bench.durations import CellDurations
from trailmark_bench.index import Index
from trailmark_bench.results import CellFolders

__all__ = ["BenchStatus", "Retry", "cells_to_run", "run_bench"]

logger = logging.getLogger(__name__)

_WAIT_S = 0.5

#: What ``--retry`` may say: ``failed`` means every cell that ran and gave no result.
Retry = Sequence[str]


@dataclass(slots=True)
class BenchStatus:
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


def cells_to_run(cells: Sequence[Cell], states: Mapping[str, str], retry: Retry = ()) -> list[Cell]:
    """Return the cells that are to be run: those that have not been, or with `retry` only those that it names."""
    wanted = {"pending", "running"}
    if retry:
        wanted = {state for word in retry for state in (UNSUCCESSFUL if word == "failed" else (word,))}
    return [
        cell for cell in cells if not cell.missing and ("all" in wanted or states.get(cell.id, "pending") in wanted)
    ]


def run_bench(
    cells: Sequence[Cell],
    index: Index,
    executor: Executor,
    *,
    retry: Retry = (),
    on_progress: Callable[[BenchStatus], None] = lambda status: None,
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
    folders = CellFolders(index.folder)
    index.enter(cells)
    folders.recover(cells, index)
    chosen = cells_to_run(cells, index.states(), retry)
    if retry:
        folders.forget_outcomes(chosen)
        index.mark_pending(cell.id for cell in chosen)
    board = CellBoard(index, chosen)
    rounds = _BenchRound(board, executor, folders, CellDurations(index.records(everything=True)), on_progress)
    rounds.tell()
    if chosen:
        rounds.run()


class _BenchRound:
    """One call of `run_bench`: cells go from the board to the executor, and what they leave to their folders."""

    def __init__(
        self,
        board: CellBoard,
        executor: Executor,
        folders: CellFolders,
        durations: CellDurations,
        on_progress: Callable[[BenchStatus], None],
    ) -> None:
        self._board = board
        self._executor = executor
        self._folders = folders
        self._durations = durations
        self._on_progress = on_progress

    def run(self) -> None:
        """Run all waiting cells."""
        self._folders.make_workspace()
        try:
            self._executor.start(self._folders.workspace)
            while self._board.waiting or self._board.running:
                for cell in self._board.startable(self._executor.slots):
                    self._board.start(cell)
                    self._executor.submit(Job(cell.id, cell.request))
                    self.tell()
                for finished in self._executor.wait(_WAIT_S):
                    self._take(finished)
                self.tell()
        finally:
            self._executor.close()
            self._folders.clear_workspace()
            with suppress(DataError):
                self._board.release()

    def _take(self, finished: Finished) -> None:
        """Keep what a cell left, and tell what became of it."""
        cell = self._board.running.get(finished.id)
        if cell is None:  # an executor that lost a machine may give a result twice: the first one counts
            logger.debug("a second result of %s is not taken", finished.id)
            return
        self._board.finish(cell, finished.outcome, *self._folders.keep(finished))
        self._durations.add(cell, finished.outcome.wall_s)
        self.tell(cell, finished.outcome.state, finished.outcome.reason)

    def tell(self, finished: Cell | None = None, state: str = "", reason: str = "") -> None:
        """Tell how far the bench is, and what has just ended."""
        running, waiting = self._board.running, self._board.waiting
        left_s = self._durations.sum_s([*running.values(), *waiting.values()])
        if left_s is not None and running:
            left_s /= max(1, min(self._executor.slots, len(running) + len(waiting)))
        counts = {name: count for name, count in self._board.counts.items() if count}
        self._on_progress(BenchStatus(counts, tuple(running.values()), left_s, finished, state, reason))
