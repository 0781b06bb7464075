"""Whether a place looks like another one of the same way: then a look does not tell which of them it is.

A place that fits where it may be the same is only then the same if it would not fit elsewhere as well. Elsewhere need
not be known yet: rooms that repeat themselves every three metres do so also where nobody has been.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Fix
from trailmark.geometry import Pose2, rotate_axes
from trailmark.paths import Keyframe
from trailmark.pipeline.teaching.matched_way import PLAUSIBLE, SLACK, MatchedWay, RelateKeyframe, sigma_m
from trailmark.pipeline.teaching.way_graph import WayGraph, chi_square

__all__ = ["LookAlikes"]

# Places are compared that are so far apart on the way and at the place, each with what was seen so far around it [m].
_BACK_M, _APART_M, _EVERY_M, _AROUND_M = 3.0, 0.7, 1.5, 3.0
# No farther away, and there so far around them: three of these standard deviations [m, rad].
_FARTHEST_M = 12.0
_WINDOW = np.diag(np.square([0.5, 0.5, math.radians(4.5)]))
# A look that is off by less is not in question [m, rad].
_HARMLESS_M = 0.5
_HARMLESS = np.diag(np.square([_HARMLESS_M / 4.0, _HARMLESS_M / 4.0, math.radians(3.0)]))
_PLAUSIBLE_SIGMAS = math.sqrt(PLAUSIBLE)


class LookAlikes:
    """Compares a look with the other places of the way.

    Parameters
    ----------
    nodes : sequence of Keyframe
        The way log.
    sites : mapping of int to (int, Pose2)
        For nodes: the number of a keyframe, and where it lies as seen from the node.
    relate : callable
        Says how a keyframe lies to others; None where it cannot.

    Attributes
    ----------
    way : MatchedWay
        Says which places cannot be the same.
    """

    def __init__(
        self,
        nodes: Sequence[Keyframe],
        sites: Mapping[int, tuple[int, Pose2]],
        relate: RelateKeyframe,
    ) -> None:
        self.way = MatchedWay(nodes, sites, relate)
        self._nodes, self._sites, self._relate = nodes, sites, relate

    def shift_of(self, graph: WayGraph, ends: tuple[int, int], measured: Pose2, spread: Floats) -> Pose2 | None:
        """Return how the look of a place repeats itself, if its second place may lie so much off the one told.

        Parameters
        ----------
        graph : WayGraph
            Of the nodes.
        ends : (int, int)
            An earlier node, and the one that is said to lie near it.
        measured : Pose2
            How the second lies as seen from the first.
        spread : (3, 3) float64
            Covariance of the first as seen from the second, without the look.
        """
        first, second = ends
        here, found = graph.poses[second], graph.poses[first] @ measured
        reach_m = _PLAUSIBLE_SIGMAS * sigma_m(spread + SLACK)
        if reach_m + here.distance_to(found) < _HARMLESS_M:
            return None
        for centre in self._others(graph, ends, min(2.0 * reach_m, _FARTHEST_M)):
            again = self._fit_at(centre, graph, ends, found)
            if again is None:
                continue
            shift, information = again.pose_map_base @ found.inverse(), rotate_axes(again.information, -here.theta)
            for moved in (shift @ found, shift.inverse() @ found):
                off = here.between(moved)
                if chi_square(off.array(), information, spread + SLACK) <= PLAUSIBLE:
                    return shift
        return None

    def _others(self, graph: WayGraph, ends: tuple[int, int], farthest_m: float) -> list[int]:
        """Return nodes at other places than the one where the look is said to belong, nearest first."""
        first, second = ends
        place, station_m = graph.poses[first], self._nodes[second].station_m
        far = {node: graph.poses[node].distance_to(place) for node in self._sites}
        near = [
            node
            for node, away_m in far.items()
            if _APART_M < away_m <= farthest_m and abs(self._nodes[node].station_m - station_m) > _BACK_M
        ]
        chosen: list[int] = []
        for node in sorted(near, key=lambda one: (far[one], one)):
            if all(graph.poses[node].distance_to(graph.poses[one]) > _EVERY_M for one in chosen):
                chosen.append(node)
        return chosen

    def _fit_at(self, centre: int, graph: WayGraph, ends: tuple[int, int], found: Pose2) -> Fix | None:
        """Return how the look fits another place; None if it does not, or it may be the same place."""
        first, second = ends
        station_m = self._nodes[centre].station_m
        known = {
            self._sites[node][0]: graph.poses[node] @ self._sites[node][1]
            for node in self._sites
            if abs(self._nodes[node].station_m - station_m) <= _AROUND_M and node != second
        }
        number, offset = self._sites[second]
        guess = Pose2(graph.poses[centre].x, graph.poses[centre].y, found.theta)
        fix = self._relate(known, number, guess @ offset, _WINDOW)
        if fix is None:
            return None
        again = fix.pose_map_base @ offset.inverse()
        away = found.between(again)
        if chi_square(away.array(), rotate_axes(fix.information, -found.theta), _HARMLESS) <= PLAUSIBLE:
            return None
        place = graph.poses[first]
        same = place.between(found @ again.inverse() @ graph.poses[centre])
        if not self.way.contradicts(first, centre, same, rotate_axes(fix.information, -place.theta)):
            return None
        return replace(fix, pose_map_base=again)
