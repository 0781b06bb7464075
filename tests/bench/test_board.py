"""The states of cells, and which of them may start."""

from __future__ import annotations

from pathlib import Path

import pytest

from trailmark.isolation import Outcome
from trailmark_bench import Cell, Index
from trailmark_bench.board import CellBoard


def cell(name: str, seed: int = 0, alone: bool = False) -> Cell:
    return Cell(f"{name}{seed}", "", {"source": "hall", "localizer": name, "seed": seed}, {}, alone=alone)


@pytest.fixture
def board_of(tmp_path: Path):
    """Return the maker of boards whose cells are all pending, and their index."""

    def make(*cells: Cell, shares_frames: bool = True) -> tuple[CellBoard, Index]:
        index = Index(tmp_path, write=True)
        index.enter(cells)
        return CellBoard(index, cells, shares_frames), index

    return make


def start(board: CellBoard, slots: int) -> list[str]:
    started = []
    for one in board.startable(slots):
        board.start(one)
        started.append(one.id)
    return started


def test_a_cell_that_runs_alone_comes_last_and_has_the_machine_for_itself(board_of) -> None:
    timed, *rest = cells = (cell("timed", alone=True), cell("orb"), cell("klt"))
    board, _ = board_of(*cells)

    assert start(board, slots=3) == ["orb0", "klt0"]
    for one in rest:
        assert start(board, slots=3) == []
        board.finish(one, Outcome("ok"), {}, None)
    assert start(board, slots=3) == [timed.id]


def seeing(name: str, world: str, alone: bool = False, **source) -> Cell:
    document = {"sources": {"robot": {"plugin": "sim", "world": world, **source}}, "seed": 0}
    coordinates = {"source": world, "localizer": name, "seed": 0}
    return Cell(name, "", coordinates, {"document": document}, alone=alone)


def test_cells_wait_for_frames_that_another_renders_while_there_is_something_else_to_do(board_of) -> None:
    first, second, noisy = seeing("orb", "hall"), seeing("klt", "hall"), seeing("noisy", "hall", perturb={"noise": 3})
    other = seeing("flow", "lab")
    board, _ = board_of(first, second, noisy, other)

    assert start(board, slots=2) == ["orb", "flow"]
    board.finish(first, Outcome("ok"), {}, None)
    assert start(board, slots=3) == ["klt", "noisy"]


def test_cells_of_one_sort_of_frames_run_beside_each_other_where_there_is_no_other(board_of) -> None:
    board, _ = board_of(seeing("a", "hall"), seeing("b", "hall"))

    assert start(board, slots=2) == ["a", "b"]


def test_a_place_does_not_stay_empty_while_a_cell_that_runs_alone_waits(board_of) -> None:
    board, _ = board_of(seeing("a", "hall"), seeing("b", "hall"), seeing("timed", "hall", alone=True))

    assert start(board, slots=2) == ["a", "b"]


def test_cells_wait_for_no_frames_where_none_are_kept(board_of) -> None:
    cells = seeing("a", "hall"), seeing("b", "hall"), seeing("flow", "lab")
    board, _ = board_of(*cells, shares_frames=False)

    assert start(board, slots=2) == ["a", "b"]


def test_every_change_is_in_the_index_and_counted(board_of) -> None:
    orb, klt = cells = cell("orb"), cell("klt")
    board, index = board_of(*cells)
    start(board, slots=2)

    board.finish(orb, Outcome("failed", "no texture"), None, None)
    board.release()

    assert index.states() == {"orb0": "failed", "klt0": "pending"}
    assert +board.counts == {"failed": 1, "pending": 1}
    assert list(board.waiting) == [klt.id]


def test_cells_that_differ_in_the_seed_alone_are_skipped_with_the_one_that_found_no_sensor(board_of) -> None:
    cells = [cell("orb", seed) for seed in range(3)] + [cell("klt")]
    board, index = board_of(*cells)
    start(board, slots=1)

    board.finish(cells[0], Outcome("skipped", "no camera"), None, None)

    assert list(board.waiting) == ["klt0"]
    assert [record.reason for record in index.records()] == ["no camera"] * 3 + [""]


def test_what_has_ended_cannot_end_again(board_of) -> None:
    one = cell("orb")
    board, _ = board_of(one)
    start(board, slots=1)
    board.finish(one, Outcome("ok"), {}, None)

    with pytest.raises(ValueError, match="'hall, orb, seed 0' is ok: it cannot become failed"):
        board.finish(one, Outcome("failed"), None, None)


def test_who_is_interrupted_while_a_cell_starts_leaves_it_pending(board_of, monkeypatch) -> None:
    one = cell("orb")
    board, index = board_of(one, cell("klt"))
    mark = index.mark_running

    def marked_and_interrupted(cell_id: str) -> None:
        mark(cell_id)
        raise KeyboardInterrupt

    monkeypatch.setattr(index, "mark_running", marked_and_interrupted)
    with pytest.raises(KeyboardInterrupt):
        board.start(one)
    board.release()

    assert {record.state for record in index.records()} == {"pending"}
