from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from trailmark import paths
from trailmark.errors import DataError
from trailmark.evaluation import (
    Protocol,
    evaluate_run,
    evaluate_run_folder,
    find_metric,
    read_run,
    write_metrics,
)
from trailmark.geometry import Pose2, Trajectory

SIGMAS = (0.02, 0.01, 0.005)
INFORMATION = f"{1 / SIGMAS[0] ** 2!r},0,0,{1 / SIGMAS[1] ** 2!r},0,{1 / SIGMAS[2] ** 2!r}"


def _motions(truth: Trajectory, scale: float = 1.0, source: str = "floor") -> list[str]:
    """Rows of motions whose errors are `scale` times as large as they say."""
    rng = np.random.default_rng(7)
    rows = []
    for k in range(1, len(truth)):
        since, stamp = truth.stamps_s[k - 1], truth.stamps_s[k]
        motion = truth[k - 1][1].between(truth[k][1]).array() + scale * rng.normal(size=3) * SIGMAS
        x, y, theta = (repr(float(value)) for value in motion)
        nis = float(rng.chisquare(3))
        rows.append(f"{stamp + 0.02},{source},motion,{since},{stamp},{x},{y},{theta},{INFORMATION},accepted,{nis},3,,")
    return rows


def _fixes(truth: Trajectory, source: str = "map") -> list[str]:
    rng = np.random.default_rng(8)
    rows = []
    for stamp, pose in zip(truth.stamps_s, truth.poses, strict=True):
        x, y, theta = (repr(float(value)) for value in pose + rng.normal(size=3) * SIGMAS)
        rows.append(f"{stamp + 0.2},{source},fix,,{stamp},{x},{y},{theta},{INFORMATION},accepted,,,,")
    return rows


def test_a_run_with_ground_truth_gets_errors(
    write_run: Callable[..., Path], figure_eight: Trajectory, noisy: Callable[..., Trajectory]
) -> None:
    folder = write_run({"floor": noisy(figure_eight, 0.05), "fused": noisy(figure_eight, 0.01)}, truth=figure_eight)

    document = evaluate_run(folder)

    assert (document["reference"], document["errors"], document["align"]) == ("groundtruth", True, "se2")
    floor, fused = (
        find_metric(document["trajectories"][name]["metrics"], "ate_rmse_m", "se2") for name in ("floor", "fused")
    )
    assert floor == pytest.approx(0.05 * math.sqrt(2.0), rel=0.1)
    assert fused == pytest.approx(0.01 * math.sqrt(2.0), rel=0.1)
    assert document["trajectories"]["groundtruth"]["poses"] == 401
    assert json.loads((folder / "metrics.json").read_text()) == document


def test_what_has_been_evaluated_is_written_as_if_read_anew(
    write_run: Callable[..., Path], figure_eight: Trajectory, noisy: Callable[..., Trajectory]
) -> None:
    folder = write_run({"floor": noisy(figure_eight, 0.05)}, truth=figure_eight)
    evaluated = evaluate_run_folder(read_run(folder))

    document = write_metrics(evaluated)

    written = (folder / "metrics.json").read_bytes()
    assert evaluate_run(folder) == document
    assert (folder / "metrics.json").read_bytes() == written


def test_without_ground_truth_there_are_differences_from_the_fused_one(
    write_run: Callable[..., Path], figure_eight: Trajectory, noisy: Callable[..., Trajectory]
) -> None:
    document = evaluate_run(write_run({"floor": noisy(figure_eight, 0.05), "fused": figure_eight}))

    floor, fused = (document["trajectories"][name]["metrics"] for name in ("floor", "fused"))
    assert (document["reference"], document["errors"]) == ("fused", False)
    assert find_metric(floor, "difference_rmse_m", "se2") == pytest.approx(0.05 * math.sqrt(2.0), rel=0.1)
    assert list(fused) == ["tracked_fraction[gap<=0.15s]"]
    assert not [name for name in floor if name.startswith(("ate", "rpe", "drift")) or "error" in name]


def test_one_localizer_alone_has_nothing_to_differ_from(write_run: Callable[..., Path], straight: Trajectory) -> None:
    document = evaluate_run(write_run({"floor": straight}))

    assert document["reference"] == "floor"
    assert list(document["trajectories"]["floor"]["metrics"]) == ["tracked_fraction[gap<=0.3s]"]


def test_a_run_that_left_no_pose_still_gets_a_document(write_run: Callable[..., Path]) -> None:
    empty = Trajectory([], np.empty((0, 3)))

    document = evaluate_run(write_run({"floor": empty}))

    assert document["reference"] is None
    assert document["trajectories"] == {"floor": {"poses": 0, "length_m": 0.0, "metrics": {}}}


def test_a_trajectory_that_cannot_be_compared_says_why_and_the_others_are(
    write_run: Callable[..., Path], straight: Trajectory
) -> None:
    short = Trajectory([0.0], [[0.0, 0.0, 0.0]])

    document = evaluate_run(write_run({"short": short, "whole": straight}, truth=straight))

    assert document["trajectories"]["short"]["problem"] == "the estimate has 1 pose; at least 2 are needed"
    assert find_metric(document["trajectories"]["whole"]["metrics"], "ate_rmse_m") == pytest.approx(0.0, abs=1e-8)


def test_time_is_tracked_of_the_run_not_of_a_longer_recording(
    write_run: Callable[..., Path], straight: Trajectory
) -> None:
    half = straight.between(0.0, 5.0)

    document = evaluate_run(write_run({"floor": half}, truth=straight))

    assert find_metric(document["trajectories"]["floor"]["metrics"], "tracked_fraction") == pytest.approx(1.0)


def test_latency_outcomes_nis_and_nees_are_told_of_each_localizer(
    write_run: Callable[..., Path], figure_eight: Trajectory
) -> None:
    truth = figure_eight.transformed(Pose2(5.0, 2.0, 1.0))  # the map has a frame of its own
    rows = [*_motions(figure_eight), *_fixes(figure_eight), "9.0,map,lost,,8.9,,,,,,,,,,unused,,,dark,"]

    document = evaluate_run(write_run({"floor": figure_eight, "map": figure_eight}, truth=truth, estimates=rows))

    floor, fixes = document["sources"]["floor"], document["sources"]["map"]
    assert floor["outcomes"] == {"accepted": 400}
    assert fixes["outcomes"] == {"accepted": 401, "lost": 1}
    assert floor["latency"]["p95_ms"] == pytest.approx(20.0)
    assert fixes["latency"]["max_ms"] == pytest.approx(200.0)
    assert floor["nis"]["verdict"] == "consistent"
    assert fixes["nis"] is None
    assert floor["nees"]["verdict"] == "consistent"
    assert fixes["nees"]["verdict"] == "consistent"
    assert (floor["nees"]["n"], fixes["nees"]["n"]) == (400, 401)
    assert "nees_per_dof[n=400,dof=1200]" in floor["metrics"]


def test_a_localizer_that_claims_too_much_is_overconfident(
    write_run: Callable[..., Path], figure_eight: Trajectory
) -> None:
    rows = _motions(figure_eight, scale=3.0)

    document = evaluate_run(write_run({"floor": figure_eight}, truth=figure_eight, estimates=rows))

    assert document["sources"]["floor"]["nees"]["verdict"] == "overconfident"
    assert document["sources"]["floor"]["nees"]["per_dof"] == pytest.approx(9.0, rel=0.1)


def test_without_ground_truth_there_is_no_nees(write_run: Callable[..., Path], straight: Trajectory) -> None:
    document = evaluate_run(write_run({"floor": straight}, estimates=_motions(straight)))

    assert document["sources"]["floor"]["nees"] is None
    assert document["sources"]["floor"]["nis"]["n"] == 100


def test_with_a_taught_path_lateral_errors_are_told_also_of_the_truth(
    write_run: Callable[..., Path], straight: Trajectory
) -> None:
    path = paths.Path(paths.Waypoint(k, float(k), Pose2(float(k), 0.0, 0.0)) for k in range(11))
    beside = straight.transformed(Pose2(0.0, 0.03, 0.0))

    document = evaluate_run(write_run({"fused": straight}, truth=beside), path=path)

    truth, fused = (document["trajectories"][name]["metrics"] for name in ("groundtruth", "fused"))
    assert truth["lateral_rmse_m[n=101]"] == pytest.approx(0.03)
    assert fused["lateral_rmse_m[n=101]"] == pytest.approx(0.0, abs=1e-8)


def test_metrics_of_plugins_stand_beside_ours_and_bad_numbers_are_null(
    write_run: Callable[..., Path], straight: Trajectory
) -> None:
    def broken(_estimate: Trajectory, _truth: Trajectory) -> dict[str, float]:
        raise RuntimeError("no luck")

    folder = write_run({"floor": straight}, truth=straight)

    document = evaluate_run(folder, metrics={"mine": lambda _e, _t: {"n": 3.0, "bad": math.nan}, "other": broken})

    written = json.loads((folder / "metrics.json").read_text())
    assert document["trajectories"]["floor"]["metrics"]["mine.n"] == 3.0
    assert written["trajectories"]["floor"]["metrics"]["mine.bad"] is None
    assert document["problems"] == ["floor: metric 'other' raised RuntimeError: no luck"]


def test_the_protocol_is_passed_on_and_nothing_is_written_on_request(
    write_run: Callable[..., Path], straight: Trajectory
) -> None:
    folder = write_run({"floor": straight}, truth=straight)

    document = evaluate_run(folder, protocol=Protocol(align="none"), write=False)

    assert document["trajectories"]["floor"]["alignment"]["used"] == "none"
    assert not (folder / "metrics.json").exists()


def test_a_folder_that_cannot_be_written_to_is_an_error(write_run: Callable[..., Path], straight: Trajectory) -> None:
    folder = write_run({"floor": straight})
    (folder / "metrics.json").mkdir()

    with pytest.raises(DataError, match=r"cannot write .*metrics\.json"):
        evaluate_run(folder)
