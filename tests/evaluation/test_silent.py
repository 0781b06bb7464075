"""Wrong estimates that claim to be right are counted; wide ones, `Lost` and small errors are not."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from trailmark import paths
from trailmark.evaluation import JudgedEstimates, evaluate_run, find_metric, metrics_of, read_estimates
from trailmark.evaluation.chaining import chained_motion, covariances_of, windows
from trailmark.evaluation.silent import FLOORS, are_silently_wrong, silent
from trailmark.geometry import Pose2, Trajectory
from trailmark.plugins import load_plugins
from trailmark.report.tables import Trajectories, trajectories_table

Write = Callable[..., Path]


def true_line(speed_mps: float, seconds: float = 4.0, rate_hz: float = 20.0) -> Trajectory:
    stamps = np.arange(round(seconds * rate_hz) + 1) / rate_hz
    return Trajectory(stamps, np.column_stack([speed_mps * stamps, 0.0 * stamps, 0.0 * stamps]))


def motions(truth: Trajectory, x_error: float, sigma: float, theta_error: float = 0.0) -> list[str]:
    info = 1.0 / sigma**2
    steps = np.diff(truth.poses[:, 0]) + x_error
    return [
        f"{now},cam,motion,{since},{now},{step!r},0,{theta_error!r},{info!r},0,0,{info!r},0,{info!r},accepted,,,,"
        for since, now, step in zip(truth.stamps_s[:-1], truth.stamps_s[1:], steps.tolist(), strict=True)
    ]


def fix(stamp: float, x: float, sigma: float, theta: float = 0.0) -> str:
    info = 1.0 / sigma**2
    return f"{stamp},cam,fix,,{stamp},{x!r},0,{theta!r},{info!r},0,0,{info!r},0,1e4,accepted,,,,"


def lost(stamp: float) -> str:
    return f"{stamp},cam,lost,,{stamp},,,,,,,,,,unused,,,dark,"


@pytest.fixture
def judge(write_run: Write) -> Callable[..., dict[str, float]]:
    """Return the numbers of some rows against a truth, by quantity."""

    numbers = itertools.count()

    def judged(truth: Trajectory | None, rows: list[str], path: paths.Path | None = None) -> dict[str, float]:
        folder = write_run({}, estimates=rows, name=f"run{next(numbers)}")
        found = silent(JudgedEstimates(read_estimates(folder / "estimates.csv"), truth, path=path))
        return {name.partition("[")[0]: value for name, value in found.items()}

    return judged


def test_a_standing_lie_is_silent_in_every_frame(judge: Callable[..., dict[str, float]]) -> None:
    truth = true_line(0.1)  # 5 mm a frame, told 0 mm, sure to 0.2 um

    found = judge(truth, motions(truth, -0.005, 2e-7))

    assert found["silent"] == 1.0
    assert found["answered_fraction"] == 1.0


def test_a_slow_lie_below_the_floor_is_found_over_a_second(judge: Callable[..., dict[str, float]]) -> None:
    truth = true_line(0.008)  # 0.4 mm a frame, told 0

    found = judge(truth, motions(truth, -0.0004, 1e-5))

    assert found["silent_single"] == 0.0
    assert found["silent_1s"] == 1.0
    assert found["silent"] == 1.0


def test_a_small_scale_error_is_found_over_a_metre(judge: Callable[..., dict[str, float]]) -> None:
    truth = true_line(1.0)  # 50 mm a frame, 0.2 mm short

    found = judge(truth, motions(truth, -0.0002, 2e-5))

    assert found["silent_single"] == 0.0
    assert found["silent_1m"] == 1.0


def test_who_says_how_wrong_he_is_is_not_silent(judge: Callable[..., dict[str, float]]) -> None:
    truth = true_line(0.5)

    found = judge(truth, motions(truth, -0.005, 0.02))

    assert found["silent"] == 0.0


def test_honest_noise_is_not_silent(judge: Callable[..., dict[str, float]]) -> None:
    truth, rng = true_line(0.5, seconds=60.0), np.random.default_rng(7)
    rows = [motions(truth, float(error), 0.002)[k] for k, error in enumerate(rng.normal(0.0, 0.002, len(truth) - 1))]

    found = judge(truth, rows)

    assert found["silent"] == 0.0


def test_the_share_is_of_the_answered_and_lost_is_no_answer(judge: Callable[..., dict[str, float]]) -> None:
    truth = true_line(0.5)
    wrong = [fix(0.05 * k, 0.025 * k + 0.1, 0.005) for k in range(10)]  # 100 mm off, 20 sigmas
    right = [fix(0.05 * k, 0.025 * k + 0.01, 0.001) for k in range(10, 40)]  # 10 sigmas, but 10 mm

    found = judge(truth, [*wrong, *right, *(lost(0.05 * k) for k in range(40, 80))])

    assert found["silent"] == pytest.approx(10 / 40)
    assert found["answered_fraction"] == pytest.approx(40 / 80)


def test_a_heading_alone_may_be_silently_wrong(judge: Callable[..., dict[str, float]]) -> None:
    truth = true_line(0.5)
    turned = [fix(0.05 * k, 0.025 * k, 0.005, math.radians(4.0)) for k in range(40)]  # sigma 0.57 degrees

    assert judge(truth, turned)["silent"] == 1.0


def test_a_path_offset_is_judged_on_the_path(judge: Callable[..., dict[str, float]]) -> None:
    truth = true_line(0.5)
    path = paths.Path(paths.Waypoint(k, float(k), Pose2(float(k), 0.1, 0.0)) for k in range(4))
    rows = [  # base drives 0.1 m to the right of the path: half of the answers say so, half say 0
        f"{t},cam,path_offset,,{t},{0.5 * t!r},{lateral},0,0,0,0,1e4,0,1e4,accepted,,,,"
        for t, lateral in zip(truth.stamps_s.tolist(), [-0.1, 0.0] * 40, strict=False)
    ]

    assert judge(truth, rows, path)["silent"] == pytest.approx(0.5, abs=0.01)
    assert "silent" not in judge(truth, rows)  # nobody knows the path


def test_without_truth_only_the_answers_are_told(judge: Callable[..., dict[str, float]]) -> None:
    assert judge(None, [fix(0.0, 0.0, 1.0), lost(1.0)]) == {"answered_fraction": 0.5}


def test_it_is_built_in_and_stands_beside_the_error_in_the_table(write_run: Write) -> None:
    truth = true_line(0.1)
    folder = write_run({"cam": truth}, truth=truth, estimates=[*motions(truth, -0.005, 2e-7), lost(9.0)])

    document = evaluate_run(folder, metrics=metrics_of(load_plugins().registry), write=False)
    table = trajectories_table(Trajectories.of_run(document))

    shown = {column.title: cell for column, cell in zip(table.columns, table.rows[0], strict=True)}
    assert shown["silent"] == "100.0"
    assert shown["answered"] == "98.8"
    assert find_metric(document["sources"]["cam"]["metrics"], "silent") == 1.0


def test_the_belief_is_judged_like_a_localizer(write_run: Write) -> None:
    truth = true_line(0.5)
    ahead = Trajectory(truth.stamps_s, truth.poses + np.array([0.0, 0.1, 0.0]))
    folder = write_run({"fused": ahead}, truth, motions(truth, 0.0, 0.001))
    rows = [  # one in four says 10 mm, and is 100 mm off
        f"{t},{0.5 * t!r},0.1,0,{variance},0,0,{variance},0,1e-4"
        for t, variance in zip(truth.stamps_s[:80].tolist(), [1e-4, 1e-2, 1e-2, 1e-2] * 20, strict=True)
    ]
    header = "stamp_s,x,y,theta,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt"
    (folder / "beliefs.csv").write_text("\n".join([header, *rows]) + "\n")

    document = evaluate_run(folder, metrics=metrics_of(load_plugins().registry))

    fused = document["trajectories"]["fused"]["metrics"]
    assert find_metric(fused, "silent") == pytest.approx(0.25)


@pytest.mark.parametrize(("mode", "silent"), [("teach", 0.0), ("track", 1.0)])
def test_a_map_that_is_taught_without_a_fix_begins_where_the_robot_stands(
    write_run: Write, mode: str, silent: float
) -> None:
    truth = true_line(0.5)
    origin = Trajectory(truth.stamps_s, truth.poses + np.array([1.0, 2.0, 0.0]))
    folder = write_run({"fused": truth}, origin, motions(truth, 0.0, 0.001))
    (folder / "run.json").write_text(json.dumps({"status": "done", "mode": mode}))
    rows = [f"{t},{0.5 * t!r},0,0,1e-4,0,0,1e-4,0,1e-4" for t in truth.stamps_s[:80].tolist()]
    header = "stamp_s,x,y,theta,cov_xx,cov_xy,cov_xt,cov_yy,cov_yt,cov_tt"
    (folder / "beliefs.csv").write_text("\n".join([header, *rows]) + "\n")

    document = evaluate_run(folder, metrics=metrics_of(load_plugins().registry))

    assert find_metric(document["trajectories"]["fused"]["metrics"], "silent") == silent
    assert ("begins where it is taught from" in document["map_frame"]) is (mode == "teach")


def test_what_was_not_measured_is_not_wrong() -> None:
    information = np.array([np.diag([0.0, 1e6, 0.0]), np.diag([1e6, 1e6, 0.0])])
    errors = np.array([[9.0, 0.0, 2.0], [9.0, 0.0, 2.0]])

    wrong = are_silently_wrong(errors, covariances_of(information), FLOORS["fix"])

    assert wrong.tolist() == [False, True]


def test_a_range_is_judged_along_its_line_only() -> None:
    along = np.array([0.6, 0.8, 0.0])
    information = np.outer(along, along)[None] / 0.01**2
    across, away = np.array([[-0.8, 0.6, 0.0]]), np.array([[0.6, 0.8, 0.0]])

    covariances = covariances_of(information)

    assert not are_silently_wrong(across, covariances, FLOORS["fix"])[0]
    assert are_silently_wrong(away, covariances, FLOORS["fix"])[0]


def test_a_chain_is_as_wide_as_many_chains_are() -> None:
    rng = np.random.default_rng(7)
    steps = np.tile([0.1, 0.01, 0.05], (20, 1))
    spread = np.diag([2e-3, 1e-3, 4e-3]) ** 2

    end, covariance = chained_motion(steps, np.tile(spread, (20, 1, 1)))
    ends = []
    for noise in rng.multivariate_normal(np.zeros(3), spread, size=(4000, 20)):
        pose = Pose2()
        for step in steps + noise:
            pose = pose @ Pose2.from_array(step)
        ends.append(pose.array())

    np.testing.assert_allclose(np.mean(ends, axis=0), end, atol=2e-3)
    np.testing.assert_allclose(np.cov(np.array(ends).T), covariance, rtol=0.1, atol=2e-6)


def test_pieces_end_at_gaps_and_do_not_overlap() -> None:
    stamps = np.array([0.5, 1.0, 1.5, 2.5, 3.0, 3.5])
    since = stamps - 0.5  # nothing between 1.5 and 2.0

    assert list(windows(since, stamps, stamps - since, 1.0)) == [(0, 2), (3, 5)]
