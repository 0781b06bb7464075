"""A metric is declared once: what it is called, its unit and which way is better follow everywhere."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from trailmark.evaluation import (
    JudgedEstimates,
    PluggedMetric,
    evaluate_run,
    metrics_of,
    quantities_of,
    spec_of,
)
from trailmark.geometry import Trajectory
from trailmark.metrics import MetricSpec
from trailmark.plugins.registry import Owner, Registry
from trailmark.report.tables import Trajectories, trajectories_table

Write = Callable[..., Path]


def side_step(estimate: Trajectory, truth: Trajectory) -> dict[str, float]:
    """Return the largest step to the side [m]."""
    return {"largest": float(np.abs(estimate.positions - truth.positions)[:, 1].max())}


def chatter(judged: JudgedEstimates) -> dict[str, float]:
    """Return how many estimates there are in a second."""
    spoken = judged.estimates
    return {"chatter[all]": len(spoken) / float(np.ptp(spoken.stamp_s)), "other": 1.0}


def broken(_judged: JudgedEstimates) -> dict[str, float]:
    raise ZeroDivisionError("by zero")


@pytest.fixture
def registry() -> Registry:
    registry = Registry(Owner("mine", "trailmark-mine", "1.0", __name__))
    registry.metric("side", side_step, quantities=[MetricSpec("side.largest", "m", title="side")])
    chatty = MetricSpec("chatter", "1/s", "higher", "nothing", "told")
    registry.metric("chatter", chatter, judges="estimates", quantities=[chatty])
    registry.metric("broken", broken, judges="estimates")
    return registry


def rows(n: int = 11) -> list[str]:
    return [f"{t},way,lost,,{t},,,,,,,,,,unused,,,blank," for t in np.linspace(0.0, 5.0, n)]


def test_what_a_metric_declares_has_a_column_in_the_tables(
    registry: Registry, write_run: Write, straight: Trajectory
) -> None:
    beside = Trajectory(straight.stamps_s, straight.poses + np.array([0.0, 0.5, 0.0]))
    folder = write_run({"way": beside}, truth=straight, estimates=rows())

    document = evaluate_run(folder, metrics=metrics_of(registry), write=False)
    table = trajectories_table(Trajectories.of_run(document))

    shown = {column.title: cell for column, cell in zip(table.columns, table.rows[0], strict=True)}
    assert shown["told"] == "2.20"
    assert "side" in shown
    assert document["sources"]["way"]["metrics"]["chatter[all]"] == pytest.approx(11 / 5.0)
    assert document["sources"]["way"]["metrics"]["chatter.other"] == 1.0
    assert document["problems"] == ["way: metric 'broken' raised ZeroDivisionError: by zero"]


def test_the_declaration_travels_with_the_figures(registry: Registry, write_run: Write, straight: Trajectory) -> None:
    document = evaluate_run(
        write_run({"way": straight}, truth=straight, estimates=rows()), metrics=metrics_of(registry), write=False
    )

    found = spec_of("chatter", quantities_of([document]))

    assert found == MetricSpec("chatter", "1/s", "higher", "nothing", "told")
    assert spec_of("chatter").better == "lower"  # nobody declared it here


def test_without_truth_only_what_needs_none_is_shown(
    registry: Registry, write_run: Write, straight: Trajectory
) -> None:
    document = evaluate_run(
        write_run({"way": straight, "fused": straight}, estimates=rows()), metrics=metrics_of(registry), write=False
    )

    titles = [column.title for column in trajectories_table(Trajectories.of_run(document)).columns]

    assert "told" in titles
    assert "side" not in titles


def test_a_plain_function_judges_trajectories(write_run: Write, straight: Trajectory) -> None:
    folder = write_run({"way": straight}, truth=straight)

    document = evaluate_run(folder, metrics={"side": side_step}, write=False)

    assert document["trajectories"]["way"]["metrics"]["side.largest"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("better", "value", "oriented"),
    [("lower", 2.0, 2.0), ("higher", 2.0, -2.0), ("near one", 0.5, np.log(2.0)), ("near one", -1.0, np.inf)],
)
def test_an_oriented_value_is_lower_where_it_is_better(better: str, value: float, oriented: float) -> None:
    assert MetricSpec("x", better=better).oriented(value) == pytest.approx(oriented)  # type: ignore[arg-type]


def test_a_failure_is_worst_whichever_way_is_better() -> None:
    assert all(MetricSpec("x", better=way).oriented(np.nan) == np.inf for way in ("lower", "higher", "near one"))


def test_every_quantity_of_an_evaluation_is_declared(write_run: Write, figure_eight: Trajectory) -> None:
    folder = write_run({"way": figure_eight}, truth=figure_eight)

    names = evaluate_run(folder, write=False)["trajectories"]["way"]["metrics"]

    declared = {spec.name for spec in quantities_of([])}
    assert {name.partition("[")[0] for name in names} <= declared


def test_a_declaration_is_read_back_and_later_keys_are_left_out() -> None:
    spec = MetricSpec("x", "m", title="side")

    assert MetricSpec.from_document({**spec.document(), "colour": "red"}) == spec
    assert PluggedMetric("x", side_step).judges == "trajectory"
