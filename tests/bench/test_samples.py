"""What counts as a sample: distinct results, places that count once, and who beats whom how probably."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from trailmark.isolation import Outcome
from trailmark_bench import Cell, Index
from trailmark_bench.nested import compare_samples, spreads_of_samples
from trailmark_bench.statistics import compare_pairs, spreads
from trailmark_bench.summary import BenchSummary, summarize_bench
from trailmark_bench.tables import bench_tables

#: Errors by method and trial; None is a crash.
Errors = Mapping[str, Mapping[tuple[str, int], float | None]]


@pytest.fixture
def summary_of(tmp_path: Path):
    """Return what a bench of given errors says; every cell took another time."""

    def summarize(errors: Errors, metrics=("ate_rmse_m", "call_p95_ms")) -> BenchSummary:
        cells = [
            (Cell(f"{method}-{place}-{seed}", "", _at(method, place, seed), {}), error)
            for method, trials in errors.items()
            for (place, seed), error in trials.items()
        ]
        with Index(tmp_path, write=True) as index:
            index.enter([cell for cell, _ in cells])
            index.set_meta(metrics=list(metrics), baseline=next(iter(errors)), name="made up")
            for number, (cell, error) in enumerate(cells):
                index.mark_finished(cell.id, *_finished(error, number))
            return summarize_bench(index)

    return summarize


def _at(method: str, place: str, seed: int) -> dict[str, object]:
    where = {"source": "hall", "place": place} if place else {"source": "hall"}
    return {**where, "localizer": method, "seed": seed}


def _finished(error: float | None, number: int) -> tuple[Outcome, dict[str, object] | None]:
    if error is None:
        return Outcome("crashed", "ended by SIGSEGV"), None
    metrics = {"ate_rmse_m[se2,n=9]": error, "tracked_fraction[gap<=0.3s]": 1.0}
    times = {"call_p95_ms": 1.0 + 0.1 * number}
    return Outcome("ok"), {"metrics": metrics, "times": times, "errors": True, "alignment": "se2"}


def in_one_place(*errors: float | None) -> dict[tuple[str, int], float | None]:
    return {("", seed): error for seed, error in enumerate(errors)}


def test_seeds_that_change_nothing_are_one_sample(summary_of) -> None:
    summary = summary_of({"bag": in_one_place(*[0.2] * 5), "drawn": in_one_place(0.1, 0.3, 0.2, 0.15, 0.25)})

    bag, drawn = (summary.entries[name, "hall"] for name in ("bag", "drawn"))
    assert (bag.spreads["ate_rmse_m"].n, drawn.spreads["ate_rmse_m"].n) == (1, 5)
    assert bag.spreads["ate_rmse_m"].low is None  # five times the same number is no narrow interval
    assert bag.spreads["call_p95_ms"].n == 5  # what a clock measures was measured five times
    assert bag.counts == {"ok": 5}
    assert [entry["deterministic"] for entry in summary.document()["entries"]] == [True, False]
    table = bench_tables(summary)[1]
    assert {row[1]: row[2] for row in table.rows} == {"bag": "1 (deterministic)", "drawn": "5"}
    assert "Deterministic: n = 1, because another seed changes nothing." in table.notes


def test_two_deterministic_methods_are_one_pair_and_one_rank(summary_of) -> None:
    summary = summary_of({"slow": in_one_place(*[0.2] * 6), "fast": in_one_place(*[0.1] * 6)})

    pair, adjusted = summary.entries["fast", "hall"].comparisons["ate_rmse_m"]
    assert (pair.n, pair.wins, pair.ratio) == (1, 1, 0.5)
    assert (pair.p, adjusted) == (None, None)  # six pairs would have said p = 0.03
    assert [row.n_ranked for row in summary.overall] == [1, 1]


def test_a_deterministic_method_is_compared_with_every_draw_of_another(summary_of) -> None:
    summary = summary_of({"bag": in_one_place(*[0.2] * 6), "drawn": in_one_place(0.1, 0.12, 0.14, 0.16, 0.18, 0.19)})

    pair, _ = summary.entries["drawn", "hall"].comparisons["ate_rmse_m"]
    assert (pair.n, pair.wins) == (6, 6)
    assert pair.p == pytest.approx(2 / 2**6)


def test_failures_that_come_and_go_are_no_constant(summary_of) -> None:
    summary = summary_of({"shaky": in_one_place(0.2, None, 0.2, None, None), "sure": in_one_place(*[0.2] * 5)})

    spread = summary.entries["shaky", "hall"].spreads["ate_rmse_m"]
    assert (spread.n, spread.median) == (5, math.inf)


def test_each_place_counts_once(summary_of) -> None:
    easy = {("easy", seed): 0.1 + 0.001 * seed for seed in range(9)}
    hard = {("hard", 0): 0.9, ("harder", 0): 1.1}
    summary = summary_of({"one": easy | hard, "other": easy | hard})

    spread = summary.entries["one", "hall"].spreads["ate_rmse_m"]
    assert (spread.n, spread.n_places) == (11, 3)
    assert spread.median == 0.9  # of all eleven values it would be 0.105
    assert bench_tables(summary)[1].rows[0][2] == "11 in 3 places"


def test_one_place_is_what_seeds_alone_were() -> None:
    rows = np.random.default_rng(3).lognormal(size=(5, 9)).tolist()
    rows[2][4] = math.inf

    assert spreads_of_samples([[row] for row in rows]) == spreads(rows)
    assert compare_samples([([rows[0]], [rows[1]])]) == [compare_pairs(rows[0], rows[1])]


def test_the_interval_covers_what_new_places_would_say() -> None:
    """Places differ more than seeds: an interval that takes all values for independent covers far too seldom."""
    rng = np.random.default_rng(11)
    nested, flat = [], []
    for _ in range(300):
        samples = rng.normal(0.0, 1.0, (8, 1)) + rng.normal(0.0, 0.2, (8, 5))
        (found,) = spreads_of_samples([samples.tolist()])
        (pooled,) = spreads([samples.ravel().tolist()])
        nested.append(found.low <= 0.0 <= found.high)
        flat.append(pooled.low <= 0.0 <= pooled.high)

    assert 0.88 <= np.mean(nested) <= 0.99
    assert np.mean(flat) < 0.85


def test_p_is_over_places_where_there_are_several() -> None:
    baseline = [[1.0] * 10] * 3

    (pair,) = compare_samples([([[0.9] * 10] * 3, baseline)])

    assert (pair.n, pair.wins) == (30, 30)
    assert pair.p == pytest.approx(0.25)  # three witnesses, not thirty
    assert pair.ratio == pytest.approx(0.9)


def test_the_probability_of_improvement_by_hand(summary_of) -> None:
    summary = summary_of(
        {
            "a": {("x", 0): 0.1, ("x", 1): 0.4, ("y", 0): 0.2},
            "b": {("x", 0): 0.2, ("x", 1): 0.3, ("y", 0): 0.2},
            "c": {("x", 0): None, ("x", 1): 0.5, ("y", 0): None},
        }
    )

    found = {(one.method, one.other): one.probability for one in summary.improvements}
    assert found["a", "b"] == found["b", "a"] == 0.5  # half of x, and a tie in y
    assert found["a", "c"] == 1.0  # a failure loses
    assert found["c", "b"] == 0.0
    matrix = bench_tables(summary)[-1]
    assert matrix.columns[0].title == "better than"
    assert [row[0] for row in matrix.rows] == [column.title for column in matrix.columns[1:]]


def test_two_failures_are_a_tie_and_conditions_give_the_interval(tmp_path: Path, synthetic) -> None:
    with synthetic(tmp_path, sources=6, localizers=2, seeds=5, fails=0.3) as index:
        improvements = summarize_bench(index).improvements

    first, second = improvements
    assert (first.method, first.other, first.n_conditions) == ("method_0", "method_1", 6)
    assert first.probability + second.probability == pytest.approx(1.0)
    assert first.low <= first.probability <= first.high
    assert first.probability > 0.5  # method_1 errs 1.3 times as much
