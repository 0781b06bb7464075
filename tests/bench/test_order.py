"""A bench that is ended early has told most: every condition once, before any twice."""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from trailmark.cli.root import ChosenPlugins, root
from trailmark.isolation.executor import Executor, Finished, Job
from trailmark_bench import Cell, Index, Outcome, run_bench
from trailmark_bench.order import first_samples, in_order_of_worth

TOY = Path(__file__).with_name("toy_plugin.py")
AXES = {"source": ["wood", "stone"], "place": ["a", "b"], "perturbation": ["clean", "dark"], "seed": [0, 1]}
CELLS = [
    Cell(f"{number:020x}", "", dict(zip(AXES, values, strict=True)), {})
    for number, values in enumerate(product(*AXES.values()))
]


def at(cell: Cell, *axes: str) -> tuple[Any, ...]:
    return tuple(cell.coordinates[axis] for axis in axes)


def test_places_come_before_seeds_and_faults_after_what_has_none() -> None:
    ordered = in_order_of_worth(CELLS)

    rounds = [at(cell, "seed", "place", "perturbation") for cell in ordered[::2]]
    assert rounds[:5] == [(0, "a", "clean"), (0, "a", "dark"), (0, "b", "clean"), (0, "b", "dark"), (1, "a", "clean")]
    assert [at(cell, "source") for cell in ordered[:2]] == [("wood",), ("stone",)]


@given(st.permutations(CELLS))
def test_nothing_is_lost_and_of_each_condition_the_first_comes_before_any_second(cells: list[Cell]) -> None:
    ordered = in_order_of_worth(cells)

    assert sorted(cell.id for cell in ordered) == sorted(cell.id for cell in cells)
    n_conditions = len(first_samples(cells))
    firsts = {at(cell, "source", "perturbation") for cell in ordered[:n_conditions]}
    assert len(firsts) == n_conditions == 4


def test_each_matrix_has_first_samples_of_its_own() -> None:
    other = Cell("f" * 20, "halls", {"source": "hall", "seed": 7}, {})

    assert other in first_samples([*CELLS, other])


def test_a_combination_that_the_first_place_lacks_has_a_first_sample_elsewhere() -> None:
    values = [("a", "p1", 0), ("a", "p2", 0), ("b", "p2", 1), ("b", "p3", 0), ("b", "p2", 0)]
    cells = [
        Cell(f"{number:020x}", "", dict(zip(("localizer", "place", "seed"), three, strict=True)), {})
        for number, three in enumerate(values)
    ]

    assert [at(cell, "localizer", "place", "seed") for cell in first_samples(cells)] == [("a", "p1", 0), ("b", "p2", 0)]


class StartedCells(Executor):
    """Takes every cell, and is interrupted when it is asked for the first that has ended."""

    def __init__(self) -> None:
        self.ids: list[str] = []

    @property
    def slots(self) -> int:
        return len(CELLS)

    def start(self, workspace: Path) -> None:
        pass

    def submit(self, job: Job) -> None:
        self.ids.append(job.id)

    def wait(self, timeout_s: float) -> list[Finished]:
        raise KeyboardInterrupt

    def close(self) -> None:
        pass


def test_a_bench_that_goes_on_keeps_its_order(tmp_path: Path) -> None:
    ordered = in_order_of_worth(CELLS)
    is_done = {cell.id for cell in ordered[:5]} | {CELLS[0].id}
    executor = StartedCells()
    with Index(tmp_path, write=True) as index:
        index.enter(CELLS)
        for cell_id in is_done:
            index.mark_finished(cell_id, Outcome("ok"))

        with pytest.raises(KeyboardInterrupt):
            run_bench(CELLS, index, executor)

    assert executor.ids == [cell.id for cell in ordered if cell.id not in is_done]


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the config of a bench of three cells."""
    path = tmp_path_factory.mktemp("bench") / "small.yaml"
    cells = "{localizers: [toy], seeds: 3}"
    path.write_text(f"sources: {{robot: {{plugin: toy_wheels}}}}\nbench: {{code: version, cells: {cells}}}\n")
    return path


def run(*words: object) -> Any:
    return CliRunner().invoke(root, ["bench", *map(str, words)], obj=ChosenPlugins(files=(str(TOY),)))


def test_when_the_time_is_over_what_is_left_is_said_and_the_next_call_goes_on(config: Path, tmp_path: Path) -> None:
    nothing = run(config, "--out", tmp_path / "out", "--hours", "1e-9", "--no-report")
    rest = run(config, "--out", tmp_path / "out", "--no-report")

    assert nothing.exit_code == rest.exit_code == 0
    assert "the time is over: 3 of 3 cells have not been run, of 1 combinations not one" in nothing.stderr
    assert "3 ok" in rest.stdout
    assert "the time is over" not in rest.stderr


def test_a_quick_pass_has_one_seed(config: Path, tmp_path: Path) -> None:
    listed = run(config, "--out", tmp_path / "out", "--quick", "--list", "--json")

    assert [cell["seed"] for cell in json.loads(listed.stdout)] == [0]
