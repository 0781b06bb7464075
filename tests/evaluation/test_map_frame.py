"""A place is judged in the map, without a fit, unless the map plainly is another frame than the truth."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from trailmark.cli.compare import compare_command
from trailmark.evaluation import Protocol, align, associate, evaluate_run
from trailmark.evaluation.map_frame import find_map_frame
from trailmark.geometry import Pose2, Trajectory

Write = Callable[..., Path]

SIGMAS = np.array([0.002, math.radians(0.05), math.radians(1.5)])  # range, bearing, and how the marker is turned
MARKER = Pose2(3.0, 1.0, math.pi)


def _seen(base: Pose2, noise: np.ndarray) -> Pose2:
    """Return where base is by a marker that is seen at range and bearing and turned, with errors of these three."""
    seen = base.between(MARKER)
    range_m, bearing = math.hypot(seen.x, seen.y) + noise[0], math.atan2(seen.y, seen.x) + noise[1]
    return (
        MARKER @ Pose2(range_m * math.cos(bearing), range_m * math.sin(bearing), seen.theta + float(noise[2])).inverse()
    )


def _jacobian(base: Pose2) -> np.ndarray:
    steps = 1e-6 * np.eye(3)
    return np.column_stack([(_seen(base, step).array() - _seen(base, -step).array()) / 2e-6 for step in steps])


def marker_run(n: int = 25) -> tuple[Trajectory, Trajectory, list[str], float]:
    """Return truth, fixes as a trajectory and as rows of ``estimates.csv``, and NEES per number by hand.

    A robot drives 1.2 m past one marker. Its errors are drawn from the covariance that it states: where the marker
    is seen turned by 1.5 degrees, base is 5 cm aside, and turned: position and heading hang together.
    """
    rng = np.random.default_rng(7)
    stamps = 0.2 * np.arange(n)
    true = [Pose2(1.2 * k / (n - 1), 0.0, 0.0) for k in range(n)]
    told, rows, squares = [], [], []
    for stamp, base in zip(stamps, true, strict=True):
        fix = _seen(base, rng.normal(size=3) * SIGMAS)
        J = _jacobian(fix)
        information = np.linalg.inv(J @ np.diag(SIGMAS**2) @ J.T)
        error = fix.array() - base.array()
        squares.append(error @ information @ error)
        told.append(fix.array())
        xx, xy, xt, yy, yt, tt = information[np.triu_indices(3)].tolist()
        numbers = ",".join(repr(value) for value in [*fix.array().tolist(), xx, xy, xt, yy, yt, tt])
        rows.append(f"{stamp},marker,fix,,{stamp},{numbers},accepted,,,,")
    truth = Trajectory(stamps, np.array([pose.array() for pose in true]))
    return truth, Trajectory(stamps, np.array(told)), rows, float(np.mean(squares)) / 3.0


def test_an_honest_marker_is_called_honest_by_compare(write_run: Write) -> None:
    truth, fixes, rows, by_hand = marker_run()
    folder = write_run({"marker": fixes, "fused": fixes}, truth=truth, estimates=rows)

    done = CliRunner().invoke(compare_command, [str(folder), "--json"])

    assert done.exit_code == 0, done.output
    nees = json.loads(done.stdout)[0]["sources"]["marker"]["nees"]
    assert by_hand == pytest.approx(1.0, abs=0.3)
    assert nees["per_dof"] == pytest.approx(by_hand, rel=1e-6)
    assert nees["verdict"] == "consistent"


@pytest.mark.parametrize("kind", ["se2", "origin", "none"])
def test_consistency_does_not_depend_on_how_trajectories_are_aligned(write_run: Write, kind: str) -> None:
    truth, fixes, rows, by_hand = marker_run()
    folder = write_run({"marker": fixes, "fused": fixes}, truth=truth, estimates=rows)

    document = evaluate_run(folder, protocol=Protocol(align=kind), write=False)  # type: ignore[arg-type]

    assert document["sources"]["marker"]["nees"]["per_dof"] == pytest.approx(by_hand, rel=1e-6)


def test_a_bias_in_the_map_is_no_other_frame(write_run: Write, figure_eight: Trajectory) -> None:
    beside = figure_eight.transformed(Pose2(0.3, 0.0, 0.0))  # 0.3 m off, sure to 1 cm; the belief began right
    rows = [
        f"{stamp},map,fix,,{stamp},{x!r},{y!r},{theta!r},1e4,0,0,1e4,0,1e4,accepted,,,,"
        for stamp, (x, y, theta) in zip(beside.stamps_s.tolist(), beside.poses.tolist(), strict=True)
    ]
    folder = write_run({"map": beside, "fused": figure_eight}, truth=figure_eight, estimates=rows)

    nees = evaluate_run(folder, write=False)["sources"]["map"]["nees"]

    assert nees["per_dof"] == pytest.approx(30.0**2 / 3.0, rel=1e-3)


def test_another_frame_is_fitted_and_said(write_run: Write) -> None:
    truth, fixes, rows, by_hand = marker_run()
    elsewhere = truth.transformed(Pose2(40.0, -20.0, 2.0))
    folder = write_run({"marker": fixes, "fused": fixes}, truth=elsewhere, estimates=rows)

    document = evaluate_run(folder, write=False)

    assert "is not that of the ground truth" in document["map_frame"]
    assert 0.2 < document["sources"]["marker"]["nees"]["per_dof"] < 1.1 * by_hand  # a fit takes a part of the errors


def _shrunk(rows: list[str]) -> list[str]:
    """Return the rows as of a robot that drives a tenth of the way."""
    fields = [row.split(",") for row in rows]
    return [
        ",".join([*row[:5], repr(float(row[5]) - 0.9 * 1.2 * k / (len(rows) - 1)), *row[6:]])
        for k, row in enumerate(fields)
    ]


def test_where_the_way_does_not_tell_the_turn_of_another_frame_fixes_are_not_judged(write_run: Write) -> None:
    truth, fixes, rows, _ = marker_run()
    near = Trajectory(truth.stamps_s, truth.poses * [0.1, 1.0, 1.0])
    elsewhere = near.transformed(Pose2(40.0, -20.0, 2.0))
    folder = write_run({"marker": fixes, "fused": fixes}, truth=elsewhere, estimates=_shrunk(rows))

    document = evaluate_run(folder, write=False)

    assert "the way is too short to tell its turn" in document["map_frame"]
    assert document["sources"]["marker"]["nees"] is None


def test_the_uncertainty_of_a_fit_is_that_of_many_fits() -> None:
    rng = np.random.default_rng(7)
    truth = np.column_stack([np.linspace(0.0, 1.0, 60), np.zeros(60), np.zeros(60)])
    other = Pose2(5.0, 6.0, 1.0)
    placed = np.column_stack([other.inverse() @ np.ascontiguousarray(truth[:, :2]), truth[:, 2] - 1.0])
    found = [
        find_map_frame(placed + rng.normal(size=placed.shape) * [0.02, 0.02, 0.01], truth, None) for _ in range(300)
    ]

    turns = np.array([frame.pose_truth_map.theta for frame in found if frame.pose_truth_map is not None])

    assert len(turns) == 300
    assert np.mean([frame.sigma_rad for frame in found]) == pytest.approx(turns.std(), rel=0.2)


def test_information_is_weakened_as_covariances_add() -> None:
    frame = find_map_frame(
        np.column_stack([np.linspace(0.0, 1.0, 9), 0.01 * (-1.0) ** np.arange(9), np.zeros(9)]),
        np.column_stack([np.linspace(5.0, 6.0, 9), np.zeros(9), np.zeros(9)]),
        None,
    )
    where = np.array([[2.5, 0.0]])
    information = np.diag([1e4, 1e6, 1e5])[None]

    weakened = frame.weaken(information, where)

    lever = 2.5 - frame.centre_map[0]
    added = np.diag([frame.sigma_m**2, frame.sigma_m**2, 0.0])
    turn = np.array([-where[0, 1] + frame.centre_map[1], lever, 1.0])
    added += frame.sigma_rad**2 * np.outer(turn, turn)
    np.testing.assert_allclose(np.linalg.inv(weakened[0]), np.linalg.inv(information[0]) + added, rtol=1e-9, atol=1e-15)


def test_what_was_not_measured_stays_so() -> None:
    frame = find_map_frame(
        np.column_stack([np.linspace(0.0, 1.0, 9), 0.01 * (-1.0) ** np.arange(9), np.zeros(9)]),
        np.column_stack([np.linspace(5.0, 6.0, 9), np.zeros(9), np.zeros(9)]),
        None,
    )

    weakened = frame.weaken(np.diag([0.0, 1e6, 0.0])[None], np.array([[2.5, 0.0]]))

    assert np.linalg.matrix_rank(weakened[0]) == 1


def test_a_turn_that_the_way_does_not_tell_is_not_applied() -> None:
    rng = np.random.default_rng(7)
    stamps = 0.1 * np.arange(200)
    wander = 0.02 * np.cumsum(rng.normal(size=(200, 2)), axis=0) / math.sqrt(20.0)
    truth = np.column_stack([0.03 * np.sin(stamps), 0.05 * np.sin(0.7 * stamps), np.zeros(200)])
    estimate = truth + np.column_stack([wander, np.zeros(200)])

    found = align(associate(Trajectory(stamps, estimate), Trajectory(stamps, truth)), "se2")

    assert (found.asked, found.used) == ("se2", "origin")
    assert "so that its direction is known to" in found.reason
    assert found.pose_truth_estimate.theta == pytest.approx(0.0, abs=1e-9)
