"""Loops of a taught way: places seen twice are looked for where they may be, and believed when several agree.

Which places may be the same follows from how uncertain the way between them is; whether they are, any localizer that
relates keyframes says (`Localizer.relate`). What it says must lie within that uncertainty, and agree with what it says
a little further on, before it counts (pairwise consistency; Mangelson et al., ICRA 2018). The way itself, matched step
by step, must not exclude it, and the place must not look like another one where the robot may be as well.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import StoreFailedError
from trailmark.estimates import Fix, Lost
from trailmark.estimation.pose_graph import PoseEdges
from trailmark.failures import raise_failure
from trailmark.geometry import Pose2, rotate_axes
from trailmark.paths import Keyframe
from trailmark.pipeline.localizers.runner import LocalizerFailedError
from trailmark.pipeline.parts import LocalizerPart
from trailmark.pipeline.teaching.alike import LookAlikes
from trailmark.pipeline.teaching.logged_way import LoggedWay
from trailmark.pipeline.teaching.matched_way import PLAUSIBLE, SLACK, sigma_m
from trailmark.pipeline.teaching.way_graph import Straightened, WayGraph, chi_square, edge_of

__all__ = ["LoopSearch", "RelatingLocalizer"]

# Between two looks; a place seen again lies at least so far back on the way [m].
_EVERY_M, _BACK_M = 0.7, 6.0
# Places that near count as the same, beside the uncertainty; those that show its surroundings [m].
_SAME_M, _AROUND_M = 2.0, 5.0
_MOST_KNOWN = 40
# Looked for within so many standard deviations, and no farther [m, rad].
_SIGMAS, _FARTHEST_M, _FARTHEST_RAD = 3.0, 8.0, math.radians(40.0)
# 99 % of right relations of three numbers agree with another.
_AGREE = 11.3
# So many must agree, over so much way [m].
_FEWEST, _WITHIN_M = 3, 6.0
# A keyframe laid that near to a node stands for it, unless the belief has jumped by so much between both [m].
_SITE_M, _JUMP_M = 1.0, 0.2
# A direction that is told less than this, as a share of the best, is not told: of a difference, of a position.
_TOLD, _TOLD_BESIDE = 1e-12, 1e-6
# A relation that cannot be off by more is not tested further [m].
_HARMLESS_M = 0.5


class RelatingLocalizer:
    """A localizer that relates keyframes, and what it remembers.

    Parameters
    ----------
    part : LocalizerPart
        The localizer.
    keyframes : sequence of Keyframe
        All that it remembers.
    """

    def __init__(self, part: LocalizerPart, keyframes: Sequence[Keyframe]) -> None:
        self._part, self._keyframes = part, keyframes

    def sites_of(self, way: LoggedWay) -> dict[int, tuple[int, Pose2]]:
        """Return for each node the keyframe laid nearest in time, and its pose relative to the node."""
        drives = [way.drive_of(keyframe) for keyframe in self._keyframes]
        found: dict[int, tuple[int, Pose2]] = {}
        for drive in way.drives:
            laid = [number for number, its_drive in enumerate(drives) if its_drive == drive]
            found |= self._sites_in(drive, way.nodes, laid) if laid else {}
        return found

    def _sites_in(self, drive: range, nodes: Sequence[Keyframe], laid: Sequence[int]) -> dict[int, tuple[int, Pose2]]:
        stamps = np.array([self._keyframes[number].stamp_s for number in laid])
        found: dict[int, tuple[int, Pose2]] = {}
        taken = -1
        for number in drive:
            nearest = laid[int(np.argmin(np.abs(stamps - nodes[number].stamp_s)))]
            offset = nodes[number].pose_map_base.between(self._keyframes[nearest].pose_map_base)
            way_m = abs(nodes[number].station_m - self._keyframes[nearest].station_m)
            if math.hypot(offset.x, offset.y) < min(way_m + _JUMP_M, _SITE_M) and nearest != taken:
                found[number] = nearest, offset
                taken = nearest
        return found

    def relate(self, known: Mapping[int, Pose2], keyframe: int, guess: Pose2, covariance: Floats) -> Fix | None:
        """Return the pose of a keyframe relative to others; None where the localizer cannot say.

        Raises
        ------
        LocalizerFailedError
            If it fails.
        """
        try:
            told = self._part.localizer.relate(known, keyframe, guess, covariance)
            if not isinstance(told, Fix | Lost):
                raise TypeError(f"it returned {type(told).__name__}, not a Fix or Lost")
        except BaseException as error:
            raise_failure(
                error, f"localizer {self._part.name!r}", "relate", kind=LocalizerFailedError, keeps=StoreFailedError
            )
        if isinstance(told, Lost) or not (np.isfinite(told.information).all() and told.information.any()):
            return None
        return told


@dataclass(frozen=True, slots=True, eq=False)
class _KnownPlaces:
    """What one localizer knows of the way.

    Sites say for nodes the number of a keyframe, and where it lies as seen from the node.
    """

    relating: RelatingLocalizer
    sites: Mapping[int, tuple[int, Pose2]]
    alikes: LookAlikes

    @classmethod
    def along(cls, way: LoggedWay, relating: RelatingLocalizer) -> _KnownPlaces:
        sites = relating.sites_of(way)
        return cls(relating, sites, LookAlikes(way.nodes, sites, relating.relate))


@dataclass(frozen=True, slots=True, eq=False)
class _LoopCandidate:
    """A relation that may close a loop: between which nodes, and the second as seen from the first.

    Its spread is how uncertain the way between them is without it, as seen from the second.
    """

    first: int
    second: int
    measured: Pose2
    information: Floats
    spread: Floats

    def edge(self) -> PoseEdges:
        return edge_of(self.first, self.second, self.measured, self.information)

    def is_sharp(self) -> bool:
        """Return whether it tells the position so well in every direction that nothing harmful agrees with it."""
        weakest = float(np.linalg.eigvalsh(self.information[:2, :2])[0])
        return weakest * _HARMLESS_M**2 > _AGREE

    def reach_m(self) -> float:
        """Return how far off it may be without being implausible, in directions that it tells, if any [m]."""
        values, vectors = np.linalg.eigh(rotate_axes(self.information, -self.measured.theta)[:2, :2])
        told = vectors[:, values > _TOLD_BESIDE * values[-1]]
        if told.shape[1] == 0:
            return 0.0
        return math.sqrt(PLAUSIBLE * float(np.linalg.eigvalsh(told.T @ self.spread[:2, :2] @ told)[-1]))


class LoopSearch:
    """Looks along a taught way for places seen before, and straightens it.

    Parameters
    ----------
    nodes : sequence of Keyframe
        The way log, at least two.
    relating : sequence of RelatingLocalizer
        Say how places lie to each other.

    Attributes
    ----------
    n_left_open : int
        Relations that agreed with each other and did not count: the way excludes them, or their places look alike.
    """

    def __init__(self, nodes: Sequence[Keyframe], relating: Sequence[RelatingLocalizer]) -> None:
        self._nodes = nodes
        way = LoggedWay(nodes)
        self._places = [_KnownPlaces.along(way, one) for one in relating]
        self._graph = WayGraph(nodes)
        self._counted: list[_LoopCandidate] = []
        self._pending: list[_LoopCandidate] = []
        self.n_left_open = 0

    def straighten(self) -> Straightened | None:
        """Return the way with its loops closed; None if it has none."""
        looked_m = -math.inf
        for node, keyframe in enumerate(self._nodes):
            if keyframe.station_m - looked_m >= _EVERY_M:
                looked_m = keyframe.station_m
                for places in self._places:
                    look = self._look(node, places) if node in places.sites else None
                    if look is not None:
                        self._take(look, places.alikes)
        n_loops = self._graph.without_wrong()
        return Straightened(self._nodes, self._graph.poses, n_loops) if n_loops else None

    def _look(self, node: int, places: _KnownPlaces) -> _LoopCandidate | None:
        """Return the relation of a node to a place seen before, if the localizer gives a plausible one."""
        station_m, here, sites = self._nodes[node].station_m, self._graph.poses[node], places.sites
        before = [one for one in sites if self._nodes[one].station_m <= station_m - _BACK_M]
        near = [one for one in before if self._graph.poses[one].distance_to(here) < _FARTHEST_M + _AROUND_M]
        if not near:
            return None
        spreads = self._graph.covariances_from(node, near)
        reach = {one: _SIGMAS * sigma_m(spread) for one, spread in spreads.items()}
        same = [
            one for one in reach if self._graph.poses[one].distance_to(here) < _SAME_M + min(reach[one], _FARTHEST_M)
        ]
        if not same:
            return None
        surest = min(same, key=lambda one: reach[one] + self._graph.poses[one].distance_to(here))
        covariance = spreads[surest]
        window = min(reach[surest], _FARTHEST_M)
        known = sorted(near, key=lambda one: self._graph.poses[one].distance_to(here))
        known = [one for one in known if self._graph.poses[one].distance_to(here) < window + _AROUND_M][:_MOST_KNOWN]
        number, offset = sites[node]
        around = {sites[one][0]: self._graph.poses[one] @ sites[one][1] for one in known}
        spread = rotate_axes(covariance + SLACK, here.theta)
        spread[2, 2] = min(spread[2, 2], (_FARTHEST_RAD / _SIGMAS) ** 2)
        told = places.relating.relate(around, number, here @ offset, spread)
        if told is None:
            return None
        found = told.pose_map_base @ offset.inverse()
        first = min(known, key=lambda one: self._graph.poses[one].distance_to(found))
        seen_from = self._graph.poses[first]
        off = here.between(found)
        information = rotate_axes(told.information, -here.theta)
        if chi_square(off.array(), information, covariance + SLACK) > PLAUSIBLE:
            return None
        information = rotate_axes(told.information, -seen_from.theta)
        return _LoopCandidate(first, node, seen_from.between(found), information, covariance)

    def _take(self, look: _LoopCandidate, alikes: LookAlikes) -> None:
        """Keep a relation until enough others agree with it, then count them all."""
        station_m = self._nodes[look.second].station_m
        recent = [one for one in self._pending if station_m - self._nodes[one.second].station_m <= _WITHIN_M]
        agreeing = [one for one in recent if self._agree(one, look)]
        group = [*agreeing, look]
        if len(group) >= _FEWEST:
            self._pending = [one for one in recent if one not in agreeing]
            if self._is_certain(group, alikes):
                self._graph.add([one.edge() for one in group])
                self._counted = group
            else:
                self.n_left_open += len(group)
        elif beside := [one for one in self._counted[-_FEWEST:] if self._agree(one, look)]:
            # What it agrees with may leave open the direction in which it is wrong.
            if any(one.is_sharp() for one in beside) or self._is_certain([look], alikes):
                self._graph.add([look.edge()])
                self._counted = [*self._counted[-_FEWEST:], look]
            else:
                self.n_left_open += 1
        else:
            self._pending = [*recent, look]

    def _is_certain(self, group: Sequence[_LoopCandidate], alikes: LookAlikes) -> bool:
        """Return whether relations that agree are what the way allows for, and their place looks like no other."""
        if all(one.reach_m() < _HARMLESS_M for one in group):
            return True
        if any(alikes.way.contradicts(one.first, one.second, one.measured, one.information) for one in group):
            return False
        look = group[-1]
        return alikes.shift_of(self._graph, (look.first, look.second), look.measured, look.spread) is None

    def _agree(self, one: _LoopCandidate, other: _LoopCandidate) -> bool:
        """Return whether two relations, with the ways between their ends, lead back to where they begin."""
        way_m = self._nodes[other.second].station_m - self._nodes[one.second].station_m
        if way_m > _WITHIN_M:
            return False
        poses = self._graph.poses
        along_new = poses[one.second].between(poses[other.second])
        along_old = poses[one.first].between(poses[other.first])
        round_trip = (one.measured @ along_new).between(along_old @ other.measured)
        drift = np.diag(np.square([0.02 * way_m, 0.02 * way_m, math.radians(0.5) * math.sqrt(max(way_m, 0.0))]))
        # Errors of both relations; a direction that one of them does not tell is not compared.
        spread = SLACK + drift
        first = rotate_axes(one.information, -(one.measured.theta + along_new.theta))
        second = rotate_axes(other.information, -other.measured.theta)
        both = _parallel(first, second)
        return chi_square(round_trip.array(), both, spread) <= _AGREE


def _parallel(first: Floats, second: Floats) -> Floats:
    """Return the information of a difference: none in directions that one of the two did not measure.

    In axes in which the sum of both is the unit matrix, both are diagonal, and tell shares of it that make one.
    """
    values, vectors = np.linalg.eigh(first + second)
    told = values > _TOLD * values[-1]
    roots, axes = np.sqrt(values[told]), vectors[:, told]
    shares, turn = np.linalg.eigh((axes / roots).T @ first @ (axes / roots))
    back = (axes * roots) @ turn
    return np.asarray((back * np.clip(shares * (1.0 - shares), 0.0, None)) @ back.T)
