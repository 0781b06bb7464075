from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from trailmark.errors import DataError
from trailmark.evaluation import Protocol, evaluate, extra_metrics, find_metric, quantity_of
from trailmark.geometry import Pose2, Trajectory

QUANTITIES = {
    *(f"ate_{word}_m" for word in ("rmse", "mean", "median", "max")),
    *(f"ate_heading_{word}_deg" for word in ("rmse", "mean", "median", "max")),
    *(f"rpe_{word}_m" for word in ("rmse", "mean", "median", "max")),
    *(f"rpe_heading_{word}_deg" for word in ("rmse", "mean", "median", "max")),
    *("tracked_fraction", "drift_percent", "drift_deg_per_m"),
    *("end_error_m", "end_error_percent", "end_heading_error_deg"),
}


def test_all_metrics_are_told_with_all_alignments(figure_eight: Trajectory) -> None:
    evaluation = evaluate(figure_eight.transformed(Pose2(1.0, 0.0, 0.0)), figure_eight)

    metrics = evaluation.metrics()

    assert {quantity_of(name) for name in metrics} == QUANTITIES
    assert metrics["ate_rmse_m[se2,n=401]"] == pytest.approx(0.0, abs=1e-9)
    assert metrics["ate_rmse_m[none,n=401]"] == pytest.approx(1.0)
    assert "ate_rmse_m[origin,n=401]" in metrics


def test_the_document_says_alignment_association_and_counts(straight: Trajectory) -> None:
    document = evaluate(straight, straight).document()

    assert document["poses"] == 101
    assert document["length_m"] == pytest.approx(10.0)
    assert document["alignment"] == {"asked": "se2", "used": "se2", "reason": "", "x": 0.0, "y": 0.0, "theta": 0.0}
    assert document["association"]["pairs"] == 101  # type: ignore[index]


def test_straight_and_static_ways_have_metrics(
    straight: Trajectory, static: Trajectory, noisy: Callable[..., Trajectory]
) -> None:
    along = evaluate(noisy(straight, 0.01, 0.01), straight).metrics()
    still = evaluate(noisy(static, 1e-4, 0.01), static).metrics()

    assert along["ate_rmse_m[se2,n=101]"] == pytest.approx(0.01 * np.sqrt(2.0), rel=0.2)
    assert along["ate_heading_rmse_deg[se2,n=101]"] == pytest.approx(np.degrees(0.01), rel=0.2)
    assert find_metric(still, "ate_rmse_m", "origin") == pytest.approx(2e-4, rel=0.5)
    assert find_metric(still, "ate_rmse_m", "se2") is None
    assert find_metric(still, "drift_percent") is None


def test_against_another_estimate_nothing_is_called_an_error(straight: Trajectory) -> None:
    metrics = evaluate(straight, straight, against_truth=False).metrics()

    assert "difference_rmse_m[se2,n=101]" in metrics
    assert "relative_difference_heading_rmse_deg[1s,n=91]" in metrics
    assert "end_difference_m[origin]" in metrics
    assert "tracked_fraction[gap<=0.3s]" in metrics
    assert not [name for name in metrics if "error" in name or name.startswith(("ate", "rpe", "drift"))]


@pytest.mark.parametrize(("against_truth", "told"), [(True, "error rmse"), (False, "difference rmse")])
def test_its_repr_is_one_line_of_what_matters(straight: Trajectory, against_truth: bool, told: str) -> None:
    text = repr(evaluate(straight, straight, against_truth=against_truth))

    assert text.startswith(f"Evaluation({len(straight)} poses, ")
    assert f"{told} 0 m, 0 deg after se2" in text
    assert len(text) < 120


def test_the_protocol_can_be_chosen(straight: Trajectory) -> None:
    protocol = Protocol(align="none", rpe_distances_m=(0.5, 2.0), rpe_times_s=())

    metrics = evaluate(straight, straight, protocol).metrics()

    assert next(iter(metrics)) == "ate_rmse_m[none,n=101]"
    assert {name for name in metrics if name.startswith("rpe_rmse")} == {"rpe_rmse_m[0.5m,n=96]", "rpe_rmse_m[2m,n=81]"}
    assert "end_error_m[none]" in metrics


def test_no_overlap_is_an_error(straight: Trajectory) -> None:
    later = Trajectory(straight.stamps_s + 100.0, straight.poses)

    with pytest.raises(DataError, match="0 common stamps"):
        evaluate(later, straight)


def test_metrics_of_plugins_see_paired_and_aligned_trajectories(straight: Trajectory) -> None:
    evaluation = evaluate(straight.transformed(Pose2(0.0, 7.0, 0.0)), straight)

    def largest_side_step(estimate: Trajectory, truth: Trajectory) -> dict[str, float]:
        return {"side_m": float(np.abs(estimate.positions - truth.positions)[:, 1].max())}

    numbers, problems = extra_metrics({"mine": largest_side_step}, evaluation)

    assert numbers == {"mine.side_m": pytest.approx(0.0, abs=1e-9)}
    assert problems == []


def test_a_metric_that_raises_is_named_and_costs_the_others_nothing(straight: Trajectory) -> None:
    def broken(_estimate: Trajectory, _truth: Trajectory) -> dict[str, float]:
        raise ZeroDivisionError("by zero")

    def particular(_estimate: Trajectory, _truth: Trajectory) -> dict[str, float]:
        raise DataError("needs 500 poses")

    metrics = {"bad": broken, "picky": particular, "good": lambda _e, _t: {"one": 1.0}}

    numbers, problems = extra_metrics(metrics, evaluate(straight, straight))

    assert numbers == {"good.one": 1.0}
    assert problems == ["metric 'bad' raised ZeroDivisionError: by zero", "metric 'picky': needs 500 poses"]
