"""The taught way as a graph of poses: its odometry, what is known of places seen twice, and how uncertain it is."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Collection, Sequence

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.pose_graph import PoseEdges, SolvedGraph, chi_squares, solve_pose_graph
from trailmark.geometry import Pose2, rotate_axes
from trailmark.paths import Keyframe
from trailmark.pipeline.teaching.logged_way import LoggedWay
from trailmark.pipeline.teaching.way_log import COVARIANCE

__all__ = ["Straightened", "WayGraph", "carry_covariance", "chi_square", "edge_of", "odometry_of"]

# No odometry is better than this over a piece of way: constant, share of the way, turn [m, 1, rad, rad/sqrt(m)].
_LEAST_M, _LEAST_SHARE = 0.002, 0.01
_LEAST_RAD, _LEAST_RAD_PER_ROOT_M = math.radians(0.05), math.radians(0.15)
# Where no covariance was estimated: share of the way, and turn [rad/sqrt(m)].
_UNKNOWN_SHARE, _UNKNOWN_RAD_PER_ROOT_M = 0.05, math.radians(2.0)
# A relation that keeps less of its weight is wrong.
_LEAST_WEIGHT = 0.5
# The way is straightened anew when relations are off by so much in all; at least this is told in every direction.
_SOLVE_AT, _OPEN = 3.0, 1e-6
# Places that uncertain are not looked for [m^2].
_HOPELESS_M2 = 36.0


class WayGraph:
    """Poses along a taught way, and what ties them.

    Parameters
    ----------
    nodes : sequence of Keyframe
        The way log.

    Attributes
    ----------
    taught : list of Pose2
        As believed while teaching.
    poses : list of Pose2
        As they agree best with all relations so far.
    loops : PoseEdges
        Relations between places seen twice.
    """

    def __init__(self, nodes: Sequence[Keyframe]) -> None:
        self.taught = [node.pose_map_base for node in nodes]
        self.poses = list(self.taught)
        self._odometry = odometry_of(nodes)
        self.loops = self._odometry.select(np.zeros(len(self._odometry), np.bool_))
        self._ties: list[list[tuple[int, Floats]]] = [[] for _ in nodes]
        self._tie(self._odometry)
        self._unsolved = 0.0

    def add(self, loops: Sequence[PoseEdges]) -> None:
        """Add relations, and solve the graph where they contradict the poses that it has."""
        rows = np.array([pose.array() for pose in self.poses])
        for edge in loops:
            self.loops += edge
            self._tie(edge)
            self._unsolved += float(chi_squares(rows, edge)[0])
        if self._unsolved > _SOLVE_AT:
            self._solve()

    def without_wrong(self) -> int:
        """Leave out the relations that contradict the others, straighten anew, and return how many are left."""
        if len(self.loops):
            solved = self._solve()
            self.loops = self.loops.select(solved.weights[len(self._odometry) :] > _LEAST_WEIGHT)
            self.poses = list(self.taught)
            if len(self.loops):
                self._solve()
        return len(self.loops)

    def covariances_from(self, node: int, wanted: Collection[int]) -> dict[int, Floats]:
        """Return how uncertain some poses are as seen from one, (3, 3) each, along the most certain way there.

        Those that are too uncertain to be looked for are left out.
        """
        found: dict[int, Floats] = {}
        missing = set(wanted)
        queue, n_pushed = [(0.0, 0, node, np.zeros((3, 3)))], 0  # of equals, the first counts
        while queue and missing:
            spread_m2, _, at, covariance = heapq.heappop(queue)
            if spread_m2 > _HOPELESS_M2:
                break
            if at in found:
                continue
            found[at] = covariance
            missing.discard(at)
            seen = self.poses[node].between(self.poses[at])
            for to, spread in self._ties[at]:
                if to not in found:
                    carried = carry_covariance(covariance, spread, seen, self.poses[at].between(self.poses[to]))
                    n_pushed += 1
                    heapq.heappush(queue, (float(carried[0, 0] + carried[1, 1] + carried[2, 2]), n_pushed, to, carried))
        return {one: found[one] for one in wanted if one in found}

    def _solve(self) -> SolvedGraph:
        solved = solve_pose_graph(np.array([pose.array() for pose in self.poses]), self._odometry + self.loops)
        self.poses = [Pose2.from_array(row) for row in solved.poses]
        self._unsolved = 0.0
        return solved

    def _tie(self, edges: PoseEdges) -> None:
        """Note which nodes are tied by edges that leave no direction open, and the covariance of each tie."""
        for first, second, information in zip(edges.first, edges.second, edges.information, strict=True):
            if np.linalg.eigvalsh(information)[0] > _OPEN:
                covariance = np.linalg.inv(information)
                self._ties[int(first)].append((int(second), covariance))
                self._ties[int(second)].append((int(first), covariance))


class Straightened:
    """The poses of a taught way after its loops were closed.

    Parameters
    ----------
    nodes : sequence of Keyframe
        The way log.
    poses : sequence of Pose2
        Where its beliefs lie now.
    n_loops : int
        How many relations closed them.
    """

    def __init__(self, nodes: Sequence[Keyframe], poses: Sequence[Pose2], n_loops: int) -> None:
        self.n_loops = n_loops
        self._before, self._after = [node.pose_map_base for node in nodes], poses
        self._way = LoggedWay(nodes)

    def at_station(self, station_m: float, pose: Pose2) -> Pose2:
        """Return the corrected pose of one that was believed at a station of the way."""
        return self._move_place(self._way.at_station(station_m), pose)

    def at_stamp(self, stamp_s: float, pose: Pose2) -> Pose2:
        """Return the corrected pose of one that was believed at a stamp, of a way that was taught in one run."""
        return self._move_place(self._way.at_stamp(stamp_s), pose)

    def at_keyframe(self, keyframe: Keyframe) -> Pose2:
        """Return the corrected pose of a keyframe."""
        return self._move_place(self._way.at_keyframe(keyframe), keyframe.pose_map_base)

    def _move_place(self, place: tuple[int, int, float], pose: Pose2) -> Pose2:
        before, after, share = place
        ends = [self._after[k] @ self._before[k].between(pose) for k in (before, after)]
        return ends[0].interpolate(ends[1], share)


def edge_of(first: int, second: int, measured: Pose2, information: Floats) -> PoseEdges:
    """Return one relation that may be wrong.

    Parameters
    ----------
    first, second : int
        Numbers of the two nodes.
    measured : Pose2
        Pose of the second as seen from the first.
    information : (3, 3) float64
        Of the measured (x, y, theta).

    Returns
    -------
    PoseEdges
        One edge, switchable.
    """
    begin, end = np.array([first], np.intp), np.array([second], np.intp)
    return PoseEdges(begin, end, measured.array()[np.newaxis], information[np.newaxis], np.ones(1, np.bool_))


def carry_covariance(covariance: Floats, spread: Floats, seen: Pose2, step: Pose2) -> Floats:
    """Return the covariance of a pose as seen from afar, after one more step with a spread of its own."""
    cos, sin = math.cos(seen.theta), math.sin(seen.theta)
    dx, dy = cos * step.x - sin * step.y, sin * step.x + cos * step.y
    carry = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
    return np.asarray(carry @ covariance @ carry.T + rotate_axes(spread, seen.theta))


def chi_square(error: Floats, information: Floats, covariance: Floats) -> float:
    """Return how far two statements differ, one of which may leave directions open.

    Parameters
    ----------
    error : (3,) float64
        Their difference in x, y and theta [m, m, rad].
    information : (3, 3) float64
        Of the one that may leave directions open.
    covariance : (3, 3) float64
        Of the other.
    """
    error = np.array([error[0], error[1], math.remainder(error[2], 2.0 * math.pi)])
    mixed = np.linalg.solve(np.eye(3) + information @ covariance, information)
    return float(error @ mixed @ error)


def odometry_of(nodes: Sequence[Keyframe]) -> PoseEdges:
    """Return the steps of a way log as edges of a graph."""
    measured, information = [], []
    for before, now in itertools.pairwise(nodes):
        step = before.pose_map_base.between(now.pose_map_base)
        measured.append(step.array())
        information.append(np.linalg.inv(_spread_between(before, now, math.hypot(step.x, step.y))))
    count = len(measured)
    ends = np.arange(count, dtype=np.intp)
    rows = np.array(measured).reshape(count, 3), np.array(information).reshape(count, 3, 3)
    return PoseEdges(ends, ends + 1, *rows, np.zeros(count, np.bool_))


def _spread_between(before: Keyframe, now: Keyframe, way_m: float) -> Floats:
    """Return the covariance of the step between two beliefs, in axes of base at the first.

    Without fixes the belief's covariance grows by exactly this: a step adds it that is independent of those before.
    """
    least_m = _LEAST_M + _LEAST_SHARE * way_m
    least = np.diag(np.square([least_m, least_m, _LEAST_RAD + _LEAST_RAD_PER_ROOT_M * math.sqrt(way_m)]))
    covariances = before.arrays[COVARIANCE], now.arrays[COVARIANCE]
    if not all(covariance.shape == (3, 3) for covariance in covariances):
        share_m = _UNKNOWN_SHARE * way_m
        turn_rad = _UNKNOWN_RAD_PER_ROOT_M * math.sqrt(way_m)
        return np.asarray(least + np.diag(np.square([share_m, share_m, turn_rad])))
    dx = now.pose_map_base.x - before.pose_map_base.x
    dy = now.pose_map_base.y - before.pose_map_base.y
    carry = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
    grown = rotate_axes(covariances[1] - carry @ covariances[0] @ carry.T, -before.pose_map_base.theta)
    values, vectors = np.linalg.eigh(grown)
    return np.asarray(least + (vectors * np.maximum(values, 0.0)) @ vectors.T)
