"""Where every cell stands: the one place where a cell changes its state, in memory and in the index."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from trailmark.isolation.outcome import Outcome
from trailmark_bench.cell import Cell
from trailmark_bench.index import Index
from trailmark_bench.order import frames_of

__all__ = ["CellBoard"]

#: What a cell that is to run may become, by what it is.
_NEXT: dict[str, tuple[str, ...]] = {
    "pending": ("running", "skipped"),
    "running": ("ok", "failed", "timeout", "crashed", "skipped", "pending"),
}

# Times that a cell is started when what runs it is lost: perhaps the cell kills it.
_TRIES = 3


class CellBoard:
    """The states of a bench's cells while some of them are run: pending, running, or what became of them.

    Parameters
    ----------
    index : Index
        Keeps every change.
    chosen : sequence of Cell
        Those that are to run; they are pending. Those that run alone come last.
    shares_frames : bool
        Whether a cell finds the frames that another one rendered.

    Attributes
    ----------
    counts : Counter
        Cells of the bench by state.
    waiting, running, lost : dict of str to Cell
        Those that are to start, that are in work, and that were lost too often to start again now.
    """

    def __init__(self, index: Index, chosen: Sequence[Cell], shares_frames: bool) -> None:
        self._index = index
        self._states = {cell.id: "pending" for cell in chosen}
        self.counts = Counter(record.state for record in index.records())
        self.waiting = {cell.id: cell for cell in sorted(chosen, key=lambda cell: cell.alone)}
        self.running: dict[str, Cell] = {}
        self.lost: dict[str, Cell] = {}
        self._losses: Counter[str] = Counter()
        self._frames = {cell.id: frames_of(cell) if shares_frames else None for cell in chosen}
        self._rendered: set[str | None] = {None}

    def startable(self, slots: int) -> Iterator[Cell]:
        """Yield waiting cells while there are places for them; one that is to run alone gets the machine for itself.

        While the first cell of some frames renders them, others that would do so too come after those that would not.
        """
        later = []
        for cell in list(self.waiting.values()):
            if not self._has_place(cell, slots):
                break  # those that are set aside may have a place where the one that runs alone has none
            if self._is_being_rendered(cell):
                later.append(cell)
            else:
                yield cell
        for cell in later:
            if not self._has_place(cell, slots):
                return
            yield cell

    def _has_place(self, cell: Cell, slots: int) -> bool:
        is_alone = cell.alone or any(other.alone for other in self.running.values())
        return len(self.running) < (1 if is_alone else slots)

    def _is_being_rendered(self, cell: Cell) -> bool:
        """Return whether cells that render a cell's frames run, and none has ended that did."""
        frames = self._frames[cell.id]
        return frames not in self._rendered and frames in {self._frames[other] for other in self.running}

    def start(self, cell: Cell) -> None:
        """Mark a waiting cell as running."""
        self._move(cell, "running")
        self.running[cell.id] = self.waiting.pop(cell.id)  # first: who is interrupted now knows what to release
        self._index.mark_running(cell.id)

    def finish(self, cell: Cell, outcome: Outcome, result: Any, detail: bytes | None) -> None:
        """Mark a running cell as ended; one that found no sensor ends those that differ in seed or faults alone."""
        self._move(cell, outcome.state)
        self._index.mark_finished(cell.id, outcome, result, detail)
        self._rendered.add(self._frames[cell.id])
        del self.running[cell.id]
        if outcome.state == "skipped":
            self._skip_like(cell, outcome.reason)

    def lose(self, cell: Cell) -> None:
        """Put a cell whose worker was lost back; the third time it waits for another call of the bench."""
        self._move(cell, "pending")
        self._index.mark_pending([cell.id])
        self._losses[cell.id] += 1
        place = self.waiting if self._losses[cell.id] < _TRIES else self.lost
        place[cell.id] = self.running.pop(cell.id)

    def release(self) -> None:
        """Nothing that is in work will end: it is pending again."""
        for cell in self.running.values():
            self._move(cell, "pending")
        self._index.mark_pending(self.running)
        self.waiting = {**self.running, **self.waiting}
        self.running = {}

    def _skip_like(self, cell: Cell, reason: str) -> None:
        with self._index.transaction():
            for other in [other for other in self.waiting.values() if _fit_of(other) == _fit_of(cell)]:
                self._move(other, "skipped")
                self._index.mark_finished(other.id, Outcome("skipped", reason))
                del self.waiting[other.id]

    def _move(self, cell: Cell, state: str) -> None:
        before = self._states[cell.id]
        if state not in _NEXT.get(before, ()):
            raise ValueError(f"cell {cell.label!r} is {before}: it cannot become {state}")
        self._states[cell.id] = state
        self.counts[before] -= 1
        self.counts[state] += 1


def _fit_of(cell: Cell) -> tuple[Any, ...]:
    """Return what decides which sensors a cell finds: neither seed nor faults make one that is not there."""
    kept = {axis: value for axis, value in cell.coordinates.items() if axis not in ("seed", "perturbation")}
    return (cell.matrix, *kept.items())
