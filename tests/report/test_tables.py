from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.evaluation import Protocol, evaluate_run
from trailmark.evaluation.consistency import consistency_of
from trailmark.report.tables import (
    Trajectories,
    consistency_table,
    sources_table,
    timing_table,
    trajectories_table,
)

Write = Callable[..., Path]


def _column(table: object, title: str) -> list[str]:
    titles = [column.title for column in table.columns]  # type: ignore[attr-defined]
    return [row[titles.index(title)] for row in table.rows]  # type: ignore[attr-defined]


def test_every_trajectory_has_a_row_and_lengths_share_a_unit(fake_run: Write) -> None:
    document = evaluate_run(fake_run(seconds=20.0), write=False)

    table = trajectories_table(Trajectories.of_run(document))

    assert _column(table, "trajectory") == ["floor", "floor_map", "klt", "fused", "standstill"]
    assert {column.unit for column in table.columns if column.title in ("ATE rmse", "max", "end error")} == {"mm"}
    assert "RPE over 2\u00a0m" in [column.title for column in table.columns]
    assert table.notes == (
        "Alignment: se2, over 40 to 400 pairs of poses.",
        "floor was lost: 59 x too dark, blurred.",
    )


def test_without_ground_truth_the_table_speaks_of_differences(fake_run: Write) -> None:
    document = evaluate_run(fake_run(seconds=20.0, has_truth=False), write=False)

    table = trajectories_table(Trajectories.of_run(document))

    titles = " ".join(column.title for column in table.columns)
    assert "difference" in titles
    assert not [word for word in ("error", "ATE", "RPE", "drift") if word in titles]
    assert table.notes[0] == "No ground truth: the numbers are differences from fused, not errors."
    assert table.rows[-1][3:] == ("\u2013",) * (len(table.columns) - 3)


def test_a_fallback_of_the_alignment_is_marked_and_explained(fake_run: Write) -> None:
    document = evaluate_run(fake_run(shape="static", seconds=10.0), write=False)

    table = trajectories_table(Trajectories.of_run(document))

    assert all(cell.endswith("*") for cell in _column(table, "ATE rmse"))
    assert "* aligned at the origin: the truth stands still, so no direction can be told." in table.notes
    assert "drift" not in [column.title for column in table.columns]


def test_each_reason_of_a_fallback_has_its_own_stars() -> None:
    def document(reason: str) -> dict[str, Any]:
        used = "origin" if reason else "se2"
        alignment = {"asked": "se2", "used": used, "reason": reason}
        metrics = {f"ate_rmse_m[{used},n=9]": 0.5}
        return {"poses": 9, "metrics": metrics, "alignment": alignment, "association": {"pairs": 9}}

    documents = tuple(document(reason) for reason in ("it stands", "", "few poses"))
    table = trajectories_table(Trajectories((("a",), ("b",), ("c",)), documents, errors=True))

    assert _column(table, "ATE rmse") == ["0.500**", "0.500  ", "0.500* "]
    assert table.notes[1:] == ("* aligned at the origin: few poses.", "** aligned at the origin: it stands.")


def test_a_trajectory_that_could_not_be_compared_says_why() -> None:
    documents = ({"poses": 1, "metrics": {}, "problem": "it has 1 pose"},)

    table = trajectories_table(Trajectories((("floor",),), documents, errors=True))

    assert table.rows == (("floor", "1"),)
    assert table.notes == ("floor: it has 1 pose.",)


def test_rows_of_different_distances_say_the_distance_of_each_rpe(fake_run: Write) -> None:
    folder = fake_run(seconds=20.0)
    protocols = (Protocol(), Protocol(rpe_distances_m=(0.5,)))
    first, second = (evaluate_run(folder, protocol=item, write=False)["trajectories"]["fused"] for item in protocols)

    table = trajectories_table(Trajectories((("a",), ("b",)), (first, second), errors=True))

    assert [cell.split(" ")[1] for cell in _column(table, "RPE")] == ["/2m", "/0.5m"]


def test_outcomes_that_never_occurred_have_no_column(fake_run: Write) -> None:
    document = evaluate_run(fake_run(seconds=20.0), write=False)
    sources = [((name,), item) for name, item in document["sources"].items()]

    table = sources_table(sources)

    assert _column(table, "lost") == ["59", "0", "0"]
    assert _column(table, "unused") == ["0", "0", "340"]
    assert "refused" not in [column.title for column in table.columns]


def squares_of_size(per_dof: float) -> dict[str, object]:
    """Return what is told of 50 estimates whose squared errors are all of one size."""
    return consistency_of(np.full(50, 3.0 * per_dof), np.full(50, 3.0)).document()


def test_an_overconfident_localizer_is_named() -> None:
    table = consistency_table([(("floor_map",), {"nis": squares_of_size(8.0), "nees": squares_of_size(9.0)})])

    assert table is not None
    assert table.notes[0].startswith("floor_map is overconfident against the belief")
    assert table.notes[1].startswith("floor_map is overconfident against the ground truth")
    assert "evaluate --noise" in table.notes[-1]


def test_of_a_localizer_that_leads_the_belief_nothing_is_said() -> None:
    table = consistency_table([(("floor",), {"nis": squares_of_size(0.01), "nees": squares_of_size(0.7)})])

    assert table is not None
    assert [note for note in table.notes if "floor is" in note] == []


def test_without_nis_and_nees_there_is_no_table_of_consistency() -> None:
    silent = {"nis": None, "nees": None}

    assert consistency_table([(("floor",), silent)]) is None


def test_stages_are_shown_with_three_digits() -> None:
    table = timing_table({"estimator": {"n": 10, "mean_ms": 0.0612, "p50_ms": 0.05, "max_ms": 1.0}})

    assert table.rows == (("estimator", "10", "0.0612", "0.0500", "\u2013", "\u2013", "1.00"),)
