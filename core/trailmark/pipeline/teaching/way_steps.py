"""Steps of a taught way of which the belief was unsure: how neighbouring keyframes lie to each other.

Where wheels and laser contradict each other and nothing decides, the belief lies between both and covers them: half a
metre of way may be off by as much. Laid on those before it, the keyframe at its end tells what the step was.
Of steps of which the belief is sure nobody is asked, and what is told counts only where the belief allows it: a single
match may be wrong.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Fix
from trailmark.geometry import Pose2
from trailmark.paths import Keyframe
from trailmark.pipeline.teaching.way_graph import WayGraph, unsure_axes

__all__ = ["PLAUSIBLE", "SLACK", "chi_square", "told_steps"]

#: 99.9 % of right relations of three numbers lie within.
PLAUSIBLE = 16.3
#: An error of the poses between two looks that no covariance tells [m, rad].
SLACK = np.diag(np.square([0.03, 0.03, math.radians(0.5)]))
# Longer steps are gaps of the log, whose ends may show different things; so far back lie those that it is laid on [m].
_STEP_M, _NEIGHBOURS_M = 0.75, 2.0
# Standard deviations within which a step is looked for, at least and at most [m, rad].
_LEAST, _MOST = (0.1, math.radians(3.0)), (0.5, math.radians(13.0))

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
        believed, spread = graph.step_to(node)
        if not unsure_axes(spread).size:
            steps[node] = believed
            continue
        before = _places_before(node, nodes, sites, steps)
        if not before:
            continue
        number, offset = sites[node]
        fix = relate(before, number, believed @ offset, _window(spread))
        if fix is None:
            continue  # an unsure step that nobody told places no older keyframes: they would be seen doubled
        found = fix.pose_map_base @ offset.inverse()
        more = found.array() - believed.array()
        more[2] = math.remainder(more[2], 2.0 * math.pi)
        if chi_square(more, fix.information, spread + SLACK) > PLAUSIBLE:
            continue
        information = np.linalg.solve(np.eye(3) + fix.information @ SLACK, fix.information)
        steps[node], told[node] = found, (more, (information + information.T) / 2.0)
    return told


def chi_square(off: Floats, information: Floats, covariance: Floats) -> float:
    """Return how far two statements differ, one of which may leave directions open.

    Parameters
    ----------
    off : (3,) float64
        By how much they differ: x, y, theta [m, m, rad].
    information : (3, 3) float64
        Of the one that may leave directions open.
    covariance : (3, 3) float64
        Of the other.
    """
    mixed = np.linalg.solve(np.eye(3) + information @ covariance, information)
    return float(off @ mixed @ off)


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
    """Return the covariance to look within: in no direction too sure of the step, nor looking too far."""
    (least_m, least_rad), (most_m, most_rad) = _LEAST, _MOST
    window = np.zeros((3, 3))
    values, vectors = np.linalg.eigh(spread[:2, :2])
    window[:2, :2] = (vectors * np.clip(values, least_m**2, most_m**2)) @ vectors.T
    window[2, 2] = np.clip(spread[2, 2], least_rad**2, most_rad**2)
    return window
