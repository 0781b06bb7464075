"""Poses that agree best with odometry and relations, some of them wrong."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.estimation.pose_graph import PoseEdges, chi_squares, solve_pose_graph
from trailmark.geometry import Pose2

N = 60
ODOMETRY = np.diag([0.02**-2, 0.01**-2, math.radians(0.6) ** -2])
RELATION = np.diag([0.01**-2, 0.01**-2, math.radians(0.2) ** -2])


def two_rounds() -> list[Pose2]:
    turns = np.linspace(0.0, 4.0 * math.pi, N)
    return [Pose2(5.0 * math.cos(turn), 5.0 * math.sin(turn), turn + math.pi / 2.0) for turn in turns]


def edges(pairs: list[tuple[int, int]], measured: list[Pose2], information: Floats, switchable: bool) -> PoseEdges:
    first, second = np.array(pairs, np.intp).reshape(-1, 2).T
    rows = np.array([pose.array() for pose in measured]).reshape(-1, 3)
    count = len(rows)
    return PoseEdges(first, second, rows, np.tile(information, (count, 1, 1)), np.full(count, switchable))


def driven(seed: int = 1) -> tuple[Floats, PoseEdges, Floats]:
    """Return noisy poses, their odometry and the true poses."""
    rng, truth = np.random.default_rng(seed), two_rounds()
    noise = np.sqrt(1.0 / np.diag(ODOMETRY))
    true_steps = (a.between(b).array() for a, b in itertools.pairwise(truth))
    steps = [Pose2.from_array(step + noise * rng.standard_normal(3)) for step in true_steps]
    poses = [truth[0]]
    for step in steps:
        poses.append(poses[-1] @ step)
    pairs = [(k, k + 1) for k in range(N - 1)]
    rows = (np.array([pose.array() for pose in some]) for some in (poses, truth))
    return next(rows), edges(pairs, steps, ODOMETRY, False), next(rows)


def worst(poses: Floats, truth: Floats) -> float:
    return float(np.hypot(*(poses - truth)[:, :2].T).max())


def closures(truth: Floats, pairs: list[tuple[int, int]]) -> PoseEdges:
    seen = [Pose2.from_array(truth[a]).between(Pose2.from_array(truth[b])) for a, b in pairs]
    return edges(pairs, seen, RELATION, True)


def test_odometry_alone_stays_where_it_is() -> None:
    poses, odometry, _ = driven()
    solved = solve_pose_graph(poses, odometry)
    np.testing.assert_allclose(solved.poses[:, :2], poses[:, :2], atol=1e-9)
    assert solved.chi_squares.max() < 1e-12


def test_relations_straighten_the_drift() -> None:
    poses, odometry, truth = driven()
    loops = closures(truth, [(k, k + 30) for k in range(0, 29, 4)])
    solved = solve_pose_graph(poses, odometry + loops)
    assert worst(poses, truth) > 0.3
    assert worst(solved.poses, truth) < 0.5 * worst(poses, truth)
    assert solved.weights.min() == 1.0
    assert 0.3 < solved.chi_squares.sum() / (3 * len(loops)) < 2.0  # as large as the noise that was put in


def test_wrong_relations_are_switched_off_and_bend_nothing() -> None:
    poses, odometry, truth = driven()
    good = closures(truth, [(k, k + 30) for k in range(0, 29, 4)])
    wrong = edges([(5, 50), (2, 40)], [Pose2(0.3, 0.1, 0.0), Pose2(-0.2, 0.0, 1.0)], RELATION, True)
    without = solve_pose_graph(poses, odometry + good)
    solved = solve_pose_graph(poses, odometry + good + wrong)
    assert solved.weights[-2:].max() < 0.01
    assert solved.weights[:-2].min() > 0.9
    np.testing.assert_allclose(solved.poses, without.poses, atol=0.03)


def test_a_direction_that_no_relation_tells_is_left_to_the_odometry() -> None:
    line = np.column_stack([np.arange(5.0), np.zeros(5), np.zeros(5)])
    odometry = edges([(k, k + 1) for k in range(4)], [Pose2(1.0)] * 4, ODOMETRY, False)
    across = edges([(0, 4)], [Pose2(9.0, 0.1, 0.0)], np.diag([0.0, 1e8, 1e8]), True)
    solved = solve_pose_graph(line, odometry + across)
    assert solved.poses[-1] == pytest.approx([4.0, 0.1, 0.0], abs=5e-3)
    assert chi_squares(solved.poses, across)[0] < 1.0


def test_turns_beyond_half_a_circle_are_no_error() -> None:
    poses = np.array([[0.0, 0.0, 3.1], [0.0, 0.0, -3.1]])
    edge = edges([(0, 1)], [Pose2(0.0, 0.0, 0.1)], ODOMETRY, False)
    solved = solve_pose_graph(poses, edge)
    assert math.remainder(solved.poses[1, 2] - 3.2, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
