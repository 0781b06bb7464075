"""Steps of a taught way of which the belief was unsure: how neighbouring keyframes lie to each other.

Where wheels and laser contradict each other and nothing decides, the belief lies between both and covers them: half a
metre of way may be off by as much. Laid on those before it, the keyframe at its end tells what the step was.
Of steps of which the belief is sure nobody is asked: a single match may be wrong.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Fix
from trailmark.geometry import Pose2
from trailmark.paths import Keyframe
from trailmark.pipeline.teaching.way_graph import WayGraph

__all__ = ["PLAUSIBLE", "SLACK", "told_steps"]

#: 99.9 % of right relations of three numbers lie within.
PLAUSIBLE = 16.3
#: An error of the poses between two looks that no covariance tells [m, rad].
SLACK = np.diag(np.square([0.03, 0.03, math.radians(0.5)]))
# Longer steps are gaps of the log, whose ends may show different things; so far back lie those that it is laid on [m].
_STEP_M, _NEIGHBOURS_M = 0.75, 2.0
# Standard deviations within which a step is looked for, at least and at most [m, rad].
_LEAST, _MOST = (0.1, math.radians(3.0)), (0.5, math.radians(13.0))
# The belief is unsure of a step whose standard deviation is larger [m, rad].
_SURE_M, _SURE_RAD = 0.1, math.radians(5.0)

#: Keyframes near a place, their number, the guess and its covariance; see `Localizer.relate`.
_Relate = Callable[[Mapping[int, Pose2], int, Pose2, Floats], Fix | None]


def told_steps(
    nodes: Sequence[Keyframe], graph: WayGraph, sites: Mapping[int, tuple[int, Pose2]], relate: _Relate
) -> dict[int, tuple[Floats, Floats]]:
    """Return what keyframes tell of steps of which the belief was unsure.

    Parameters
    ----------
    nodes : sequence of Keyframe
        The way log.
    graph : WayGraph
        Of these nodes.
    sites : mapping of int to (int, Pose2)
        For nodes: the number of a keyframe, and where it lies as seen from the node.
    relate : callable
        Says how a keyframe lies to others; None where it cannot.

    Returns
    -------
    dict of int to (3,) and (3, 3) float64
        As `WayGraph.correct_steps` takes it.
    """
    steps, told = dict[int, Pose2](), dict[int, tuple[Floats, Floats]]()
    for node in sorted(sites):
        if node == 0 or not _is_near(nodes[node - 1], nodes[node], _STEP_M):
            continue
        steps[node], spread = graph.step_to(node)
        if _is_sure(spread):
            continue
        before = _places_before(node, nodes, sites, steps)
        if not before:
            continue
        number, offset = sites[node]
        fix = relate(before, number, steps[node] @ offset, _window(spread))
        if fix is None:
            continue
        found = fix.pose_map_base @ offset.inverse()
        more = found.array() - steps[node].array()
        more[2] = math.remainder(more[2], 2.0 * math.pi)
        information = np.linalg.solve(np.eye(3) + fix.information @ SLACK, fix.information)
        steps[node], told[node] = found, (more, (information + information.T) / 2.0)
    return told


def _places_before(
    node: int, nodes: Sequence[Keyframe], sites: Mapping[int, tuple[int, Pose2]], steps: Mapping[int, Pose2]
) -> dict[int, Pose2]:
    """Return where the last keyframes before a node lie, as seen from the node before it."""
    places, place, before = dict[int, Pose2](), Pose2(), node - 1
    while before in sites and _is_near(nodes[before], nodes[node], _NEIGHBOURS_M):
        places[sites[before][0]] = place @ sites[before][1]
        if before not in steps:
            break
        place = place @ steps[before].inverse()
        before -= 1
    return places


def _is_near(before: Keyframe, now: Keyframe, most_m: float) -> bool:
    return 0.0 <= now.station_m - before.station_m <= most_m and before.stamp_s <= now.stamp_s


def _window(spread: Floats) -> Floats:
    """Return the covariance to look within: neither too sure of the step nor looking too far."""
    sigmas = np.clip([_sigma_m(spread), math.sqrt(spread[2, 2])], _LEAST, _MOST)
    return np.diag(np.square(sigmas[[0, 0, 1]]))


def _is_sure(spread: Floats) -> bool:
    return _sigma_m(spread) < _SURE_M and float(spread[2, 2]) < _SURE_RAD**2


def _sigma_m(covariance: Floats) -> float:
    return math.sqrt(max(float(np.linalg.eigvalsh(covariance[:2, :2])[1]), 0.0))
