"""Steps of which the belief was unsure are what keyframes tell; where it was sure, nobody is asked."""

from __future__ import annotations

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


def log(sigma_m: float, gap_m: float = 0.0) -> list[Keyframe]:
    """Return the log of a straight way whose belief is 0.6 m too far from the sixth node on, and how sure it was."""
    nodes = []
    for k, true in enumerate(TRUE):
        has_jumped = k >= JUMP
        covariance = np.diag([1e-6 + has_jumped * sigma_m**2] * 2 + [1e-6])
        pose = Pose2(true.x + 0.6 * has_jumped, 0.1 * has_jumped, 0.0)
        arrays = {COVARIANCE: covariance, FIXED: np.array(False)}
        nodes.append(Keyframe(0.5 * k + gap_m * has_jumped, float(k), pose, arrays))
    return nodes


class Truthful:
    """Lays keyframes where they truly are."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def relate(self, known: Mapping[int, Pose2], keyframe: int, guess: Pose2, covariance: Floats) -> Fix:
        self.asked.append(keyframe)
        first = max(known)
        pose = known[first] @ TRUE[first].between(TRUE[keyframe])
        return Fix(0.0, pose, information_from_sigmas(0.01, 0.01, 0.005))


def corrected(nodes: Sequence[Keyframe], truthful: Truthful) -> list[Pose2]:
    graph = WayGraph(nodes)
    graph.correct_steps(told_steps(nodes, graph, SITES, truthful.relate))
    return graph.poses


def test_an_unsure_step_is_what_keyframes_tell() -> None:
    truthful = Truthful()
    nodes = log(sigma_m=1.0)
    found = corrected(nodes, truthful)
    assert truthful.asked == [JUMP]
    assert max(a.distance_to(b) for a, b in zip(found, TRUE, strict=True)) < 0.01
    graph = WayGraph(nodes)
    assert graph.covariances_from(0, [9])[9][0, 0] > 1.0  # the step makes all that comes after it uncertain
    graph.correct_steps(told_steps(nodes, graph, SITES, truthful.relate))
    assert graph.covariances_from(0, [9])[9][0, 0] < 0.1**2


@pytest.mark.parametrize(("sigma_m", "gap_m"), [(0.02, 0.0), (1.0, 0.5)])
def test_nobody_is_asked_of_a_sure_step_and_of_a_gap_of_the_log(sigma_m: float, gap_m: float) -> None:
    truthful, nodes = Truthful(), log(sigma_m, gap_m)
    assert corrected(nodes, truthful) == [node.pose_map_base for node in nodes]
    assert truthful.asked == []


def test_the_search_for_loops_begins_with_the_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loops, "_BACK_M", 100.0)  # no loops
    part: Any = SimpleNamespace(name="laser", localizer=Truthful())
    nodes = log(sigma_m=1.0)
    part.localizer.relate = lambda *asked: Truthful().relate(*asked)
    search = LoopSearch(nodes, [RelatingLocalizer(part, nodes)])
    assert search.straighten() is None  # nothing moves by steps alone
    assert search._graph.poses[-1].distance_to(TRUE[-1]) < 0.01
