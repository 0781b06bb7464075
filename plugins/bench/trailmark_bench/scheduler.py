"""Running the cells of a bench: what is missing, in order, as many at a time as there are places."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field

from trailmark.errors import ConfigError, DataError
from trailmark.interruption import TELL_S, shielded
from trailmark.isolation.executor import Executor, ExecutorLostError, Finished, Job
from trailmark_bench.board import CellBoard
from trailmark_bench.cell import UNSUCCESSFUL, Cell
from trailmark_bench.durations import CellDurations
from trailmark_bench.index import Index
from trailmark_bench.order import in_order_of_worth
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
    patience_s: float = 60.0,
    budget_s: float = math.inf,
) -> tuple[Cell, ...]:
    """Run the missing cells, the most informative first.

    A finished cell is never run again, however often this is called.
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
    patience_s : float
        How long to wait for an executor that is lost to come back [s].
    budget_s : float
        No cell begins after so much time; those that are in work come to their end [s].

    Returns
    -------
    tuple of Cell
        Those that are pending still: what ran them was lost, several times.

    Raises
    ------
    ConfigError
        If the executor lacks what it needs.
    ExecutorLostError
        If it was lost and did not come back; what was in work is pending.
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
    board = CellBoard(index, in_order_of_worth(chosen, cells), executor.shares_frames)
    durations = CellDurations(index.records(everything=True))
    bench_round = _BenchRound(board, executor, folders, durations=durations, on_progress=on_progress)
    bench_round.tell()
    if chosen:
        bench_round.run(patience_s, time.monotonic() + budget_s)
    return tuple(board.lost.values())


class _BenchRound:
    """One call of `run_bench`: cells go from the board to the executor, and what they leave to their folders."""

    def __init__(
        self,
        board: CellBoard,
        executor: Executor,
        folders: CellFolders,
        *,
        durations: CellDurations,
        on_progress: Callable[[BenchStatus], None],
    ) -> None:
        self._board = board
        self._executor = executor
        self._folders = folders
        self._durations = durations
        self._on_progress = on_progress

    def run(self, patience_s: float, until_s: float) -> None:
        """Run waiting cells, and begin none after a time; an executor that is lost is started again."""
        self._folders.make_workspace()
        try:
            self._executor.start(self._folders.workspace)
            while self._board.running or (self._board.waiting and time.monotonic() < until_s):
                try:
                    self._step(until_s)
                except ExecutorLostError as error:
                    self._start_again(error, time.monotonic() + patience_s)
        finally:
            with shielded(TELL_S):
                with suppress(DataError):
                    self._board.release()  # first: on a busy machine workers may take all of the time to end
                self._executor.close()
                self._folders.clear_workspace()

    def _step(self, until_s: float) -> None:
        """Start cells while there are places and time, and keep what those that have ended left."""
        for cell in self._board.startable(self._executor.slots):
            if time.monotonic() >= until_s:
                break
            self._board.start(cell)
            self._executor.submit(Job(cell.id, cell.request))
            self.tell()
        for finished in self._executor.wait(_WAIT_S):
            self._take(finished)
        self.tell()

    def _start_again(self, error: ExecutorLostError, until_s: float) -> None:
        """Start an executor that is lost, which may take a while; what was in work waits again."""
        logger.warning("%s; its %d cells are pending again", error, len(self._board.running))
        for cell in tuple(self._board.running.values()):
            self._board.lose(cell)
        self._executor.close()
        self.tell()
        while True:
            try:
                return self._executor.start(self._folders.workspace)
            except ConfigError as problem:
                if time.monotonic() >= until_s:
                    raise ExecutorLostError(f"{error}; {problem}; the same command goes on") from problem
                time.sleep(min(1.0, max(0.0, until_s - time.monotonic())))

    def _take(self, finished: Finished) -> None:
        """Keep the result of a cell, and report what became of it."""
        cell = self._board.running.get(finished.id)
        if cell is None:  # an executor that lost a machine may give a result twice: the first one counts
            logger.debug("a second result of %s is not taken", finished.id)
            return
        if finished.is_lost:
            logger.warning("%s is pending again: %s", cell.label, finished.outcome.reason)
            self._board.lose(cell)
            return
        self._board.finish(cell, finished.outcome, *self._folders.keep(finished))
        self._durations.add(cell, finished.outcome.wall_s)
        self.tell(cell, finished.outcome.state, finished.outcome.reason)

    def tell(self, finished: Cell | None = None, state: str = "", reason: str = "") -> None:
        """Report the progress of the bench, and the cell that has just ended."""
        running, waiting = self._board.running, self._board.waiting
        left_s = self._durations.sum_s([*running.values(), *waiting.values()])
        if left_s is not None and running:
            left_s /= max(1, min(self._executor.slots, len(running) + len(waiting)))
        counts = {name: count for name, count in self._board.counts.items() if count}
        self._on_progress(BenchStatus(counts, tuple(running.values()), left_s, finished, state, reason))
