"""Steps of which the belief was unsure are what keyframes tell; where it was sure, nobody is asked."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.estimates import Fix, information_from_sigmas
from trailmark.geometry import Pose2
from trailmark.paths import Keyframe
from trailmark.pipeline.teaching import loops
from trailmark.pipeline.teaching.loops import LoopSearch, RelatingLocalizer
from trailmark.pipeline.teaching.way_graph import WayGraph
from trailmark.pipeline.teaching.way_log import COVARIANCE, FIXED
from trailmark.pipeline.teaching.way_steps import told_steps

TRUE = [Pose2(0.5 * k, 0.0, 0.0) for k in range(10)]
SITES = {k: (k, Pose2()) for k in range(10)}
JUMP = 5


ALL, ALONG, HEADING = (1.0, 1.0, 0.001), (1.0, 0.012, 0.001), (0.012, 0.012, math.radians(6.0))


def log(*sigmas: tuple[float, float, float], gap_m: float = 0.0) -> list[Keyframe]:
    """Return the log of a straight way whose belief is 0.6 m too far from the sixth node on.

    And how sure it was of the step there and of those after it: x, y, theta.
    """
    nodes, covariance = list[Keyframe](), np.diag([1e-6] * 3)
    for k, true in enumerate(TRUE):
        has_jumped = k >= JUMP
        pose = Pose2(true.x + 0.6 * has_jumped, 0.1 * has_jumped, 0.0)
        before = nodes[-1].pose_map_base if nodes else pose
        carry = np.array([[1.0, 0.0, before.y - pose.y], [0.0, 1.0, pose.x - before.x], [0.0, 0.0, 1.0]])
        covariance = carry @ covariance @ carry.T
        if JUMP <= k < JUMP + len(sigmas):
            covariance += np.diag(np.square(sigmas[k - JUMP]))
        arrays = {COVARIANCE: covariance, FIXED: np.array(False)}
        nodes.append(Keyframe(0.5 * k + gap_m * has_jumped, float(k), pose, arrays))
    return nodes


class Truthful:
    """Lays keyframes where they truly are, or off by so much."""

    def __init__(self, off: Pose2 | None = None) -> None:
        self.off = off or Pose2()
        self.asked: list[int] = []
        self.windows: list[Floats] = []

    def relate(self, known: Mapping[int, Pose2], keyframe: int, guess: Pose2, covariance: Floats) -> Fix:
        self.asked.append(keyframe)
        self.windows.append(covariance)
        first = max(known)
        pose = known[first] @ TRUE[first].between(TRUE[keyframe]) @ self.off
        return Fix(0.0, pose, information_from_sigmas(0.01, 0.01, 0.005))


def corrected(nodes: Sequence[Keyframe], truthful: Truthful) -> list[Pose2]:
    graph = WayGraph(nodes)
    graph.correct_steps(told_steps(nodes, graph, SITES, truthful.relate))
    return graph.poses


def test_an_unsure_step_is_what_keyframes_tell() -> None:
    truthful = Truthful()
    nodes = log(ALL)
    found = corrected(nodes, truthful)
    assert truthful.asked == [JUMP]
    assert max(a.distance_to(b) for a, b in zip(found, TRUE, strict=True)) < 0.01
    graph = WayGraph(nodes)
    assert graph.covariances_from(0, [9])[9][0, 0] > 1.0  # the step makes all that comes after it uncertain
    graph.correct_steps(told_steps(nodes, graph, SITES, truthful.relate))
    assert graph.covariances_from(0, [9])[9][0, 0] < 0.1**2


@pytest.mark.parametrize(("sigma_m", "gap_m"), [(0.02, 0.0), (1.0, 0.5)])
def test_nobody_is_asked_of_a_sure_step_and_of_a_gap_of_the_log(sigma_m: float, gap_m: float) -> None:
    truthful, nodes = Truthful(), log((sigma_m, sigma_m, 0.001), gap_m=gap_m)
    assert corrected(nodes, truthful) == [node.pose_map_base for node in nodes]
    assert truthful.asked == []


@pytest.mark.parametrize(("sigmas", "off"), [(ALONG, Pose2(0.0, 0.5)), (HEADING, Pose2(0.9, 0.1))])
def test_what_is_told_is_left_where_the_belief_was_sure_of_something_else(
    sigmas: tuple[float, float, float], off: Pose2
) -> None:
    laid, nodes = Truthful(off), log(sigmas)
    assert corrected(nodes, laid) == [node.pose_map_base for node in nodes]
    assert laid.asked == [JUMP]


def test_what_is_told_moves_only_what_the_belief_was_unsure_of() -> None:
    nodes = log(ALONG)
    graph = WayGraph(nodes)
    graph.correct_steps(told_steps(nodes, graph, SITES, Truthful(Pose2(0.0, 0.18)).relate))  # 8 cm beside the belief
    believed, found = nodes[JUMP].pose_map_base, graph.poses[JUMP]
    assert found.x == pytest.approx(TRUE[JUMP].x, abs=0.01)
    assert abs(found.y - believed.y) < 0.02
    assert graph.step_to(JUMP)[1][1, 1] < 0.02**2


def test_a_step_is_looked_for_in_directions_of_which_the_belief_was_unsure() -> None:
    laid = Truthful()
    corrected(log(ALONG), laid)
    assert np.sqrt(np.diag(laid.windows[0])) == pytest.approx([0.5, 0.1, math.radians(3.0)])


def test_an_unsure_step_that_nobody_told_lays_no_older_keyframes_for_the_next() -> None:
    asked: list[tuple[int, list[int]]] = []

    def relate(known: Mapping[int, Pose2], keyframe: int, guess: Pose2, covariance: Floats) -> Fix | None:
        asked.append((keyframe, sorted(known)))
        return None if keyframe == JUMP else Truthful().relate(known, keyframe, guess, covariance)

    nodes = log(ALL, ALL)
    told = told_steps(nodes, WayGraph(nodes), SITES, relate)
    assert asked == [(JUMP, [1, 2, 3, 4]), (JUMP + 1, [JUMP])]
    assert list(told) == [JUMP + 1]


def test_the_search_for_loops_begins_with_the_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loops, "_BACK_M", 100.0)  # no loops
    part: Any = SimpleNamespace(name="laser", localizer=Truthful())
    nodes = log(ALL)
    part.localizer.relate = lambda *asked: Truthful().relate(*asked)
    search = LoopSearch(nodes, [RelatingLocalizer(part, nodes)])
    assert search.straighten() is None  # nothing moves by steps alone
    assert search._graph.poses[-1].distance_to(TRUE[-1]) < 0.01
