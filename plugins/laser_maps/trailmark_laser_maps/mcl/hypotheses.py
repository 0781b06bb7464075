"""Where the robot may be: places that explain what the laser saw, on the way driven until now."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.geometry import Pose2, wrap_angles
from trailmark.geometry.scans.uncertainty import match_information
from trailmark_laser_maps.mcl.field import GridField
from trailmark_laser_maps.mcl.kernels import (
    beyond_walls,
    distances_to_walls,
    explained_shares,
    normal_equations,
    refine_poses,
    score_poses,
)

__all__ = ["RankedPlaces", "ScanLook", "Search", "best_of_each_neighbourhood", "is_elsewhere", "moved_by"]

#: So near to a wall a ray ends that is explained [m].
NEAR_M = 0.15
#: Two places are different beyond this [m, rad].
APART_M, APART_RAD = 0.5, math.radians(20.0)
_PULL_IN_M = np.array([0.6, 0.6, 0.5, 0.4, 0.3, 0.25, 0.2, 0.2])
_FOLLOW_M = np.array([0.4, 0.3, 0.2])
#: Within this a ray end belongs to its wall; the least standard deviation of its distance from it [m].
_FIT_M, _SIGMA_M = 0.15, 0.015
#: Beyond this a ray end is of nothing in the map, however crooked that is [m].
_NEAR_WALL_M = 0.2
_N_COARSE = 30
_FARTHEST_M, _FARTHEST_RAD = 0.3, math.radians(8.0)


@dataclass(frozen=True, slots=True, eq=False)
class ScanLook:
    """What the laser saw at one instant.

    Attributes
    ----------
    pose_odom_base : Pose2
        Base where motion alone has carried it.
    rays : (B, 2) float64
        Ends of rays in base axes, thinned [m].
    laser : (2,) float64
        Where they begin, in base axes [m].
    """

    pose_odom_base: Pose2
    rays: Floats
    laser: Floats


@dataclass(frozen=True, slots=True, eq=False)
class RankedPlaces:
    """Different places, the best first.

    Attributes
    ----------
    poses : (K, 3) float64
        In grid axes.
    shares : (K,) float64
        How much of the rays each explains, on average over the looks.
    n_looks : int
        How many looks these were.
    """

    poses: Floats
    shares: Floats
    n_looks: int


class Search:
    """Compares places by all that was seen lately, carried back along the odometry.

    One scan fits many corridors; a way of some metres fits few. The odometry is trusted from look to look only: at each
    look a place is drawn onto the walls again, so that its drift does not add up.

    Parameters
    ----------
    field : GridField
        The map.
    """

    def __init__(self, field: GridField) -> None:
        self._field = field
        self._looks: deque[ScanLook] = deque(maxlen=12)

    def __len__(self) -> int:
        return len(self._looks)

    def forget(self) -> None:
        """Forget all looks: the robot may have been carried away."""
        self._looks.clear()

    def remember(self, look: ScanLook, every_m: float, every_rad: float) -> None:
        """Keep a look, if the robot has moved since the last one that was kept."""
        if self._looks:
            step = self._looks[-1].pose_odom_base.between(look.pose_odom_base)
            if math.hypot(step.x, step.y) < every_m and abs(step.theta) < every_rad:
                return
        self._looks.append(look)

    def refined(self, look: ScanLook, poses: Floats) -> Floats:
        """Return poses drawn onto the walls that the look shows, (K, 3)."""
        return self._refined(look, poses, _PULL_IN_M)

    def compare(self, look: ScanLook, candidates: Floats, most: int = 60) -> RankedPlaces:
        """Return the different places among candidates (K, 3) for base at `look`, judged by all looks.

        The candidates are refined first. At most so many are judged by their way.
        """
        poses = self.refined(look, candidates)
        shares = self.explained(look, poses)
        chosen = _different(poses, shares, most)
        poses, shares = poses[chosen], shares[chosen]
        total, at, reference = shares.copy(), poses, look
        earlier = [one for one in reversed(self._looks) if one is not look]
        for one in earlier:
            at = self.followed(one, moved_by(at, reference.pose_odom_base.between(one.pose_odom_base)))
            total += self.explained(one, at)
            reference = one
        mean = total / (1 + len(earlier))
        order = np.argsort(-mean, kind="stable")
        return RankedPlaces(poses[order], mean[order], 1 + len(earlier))

    def scores(self, look: ScanLook, poses: Floats) -> Floats:
        """Return the logarithm of the likelihood of some thirty rays at each pose, among wide walls, (N,)."""
        field, rays = self._field, np.ascontiguousarray(look.rays[:: max(1, len(look.rays) // _N_COARSE)])
        return score_poses(poses, rays, field.wide, field.is_free, field.cell_m, float(field.wide.min()))

    def explained(self, look: ScanLook, poses: Floats) -> Floats:
        """Return the share of a look's rays that each pose explains, (N,)."""
        field = self._field
        return explained_shares(poses, look.rays, look.laser, field.distance_m, field.cell_m, NEAR_M)

    def _refined(self, look: ScanLook, poses: Floats, gates_m: Floats) -> Floats:
        field = self._field
        return refine_poses(poses, look.rays, field.walls, field.normals, field.nearest_idx, field.cell_m, gates_m)

    def told_by_walls(self, look: ScanLook, pose: Floats) -> Floats:
        """Return the information (3, 3) on a pose (3,) that is drawn onto walls: nothing along a plain corridor."""
        field = self._field
        equations = np.empty((3, 3)), np.empty(3)
        grid = field.walls, field.normals, field.nearest_idx, field.cell_m
        normal_equations(pose, look.rays, *grid, _FIT_M, *equations)
        return match_information(equations[0], beyond_walls(pose, look.rays, *grid, _FIT_M), _SIGMA_M)

    def distances_to_walls(self, look: ScanLook, pose: Floats) -> Floats:
        """Return how far the ends of rays are from the nearest wall at a pose (3,), those that are near one, (R,) [m].

        NaN where none is near. Along a wall's normal where it is a line; to its nearest cell where it is too thick or
        too short for one.
        """
        field = self._field
        return distances_to_walls(
            pose, look.rays, field.walls, field.normals, field.nearest_idx, field.cell_m, _NEAR_WALL_M
        )

    def followed(self, look: ScanLook, expected: Floats) -> Floats:
        """Return poses refined, but no farther from where they are expected than odometry may err."""
        found = self._refined(look, expected, _FOLLOW_M)
        offset = np.hypot(found[:, 0] - expected[:, 0], found[:, 1] - expected[:, 1])
        is_far = (offset > _FARTHEST_M) | (np.abs(wrap_angles(found[:, 2] - expected[:, 2])) > _FARTHEST_RAD)
        return np.where(is_far[:, np.newaxis], expected, found)


def best_of_each_neighbourhood(poses: Floats, scores: Floats, most: int) -> Floats:
    """Return the poses with the best scores, one from each neighbourhood, (K, 3)."""
    n_looked_at = min(40 * most, len(scores))
    best = np.argpartition(-scores, n_looked_at - 1)[:n_looked_at]
    best = best[np.argsort(-scores[best], kind="stable")]
    turned = np.column_stack([poses[best, :2], poses[best, 2] % (2.0 * math.pi)])
    bins = np.floor(turned / (0.4, 0.4, math.radians(20.0))).astype(np.int64)
    _, first = np.unique(bins @ np.array([1 << 30, 64, 1]), return_index=True)
    return np.asarray(poses[best[np.sort(first)[:most]]])


def moved_by(poses: Floats, step: Pose2) -> Floats:
    """Return poses (K, 3) after a step in their own axes."""
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x = poses[:, 0] + cos * step.x - sin * step.y
    y = poses[:, 1] + sin * step.x + cos * step.y
    return np.stack([x, y, poses[:, 2] + step.theta], axis=1)


def is_elsewhere(poses: Floats, pose: Floats) -> Bools:
    """Return which poses (K, 3) are another place than `pose`, (K,)."""
    offset = np.hypot(poses[:, 0] - pose[0], poses[:, 1] - pose[1])
    return np.asarray((offset > APART_M) | (np.abs(wrap_angles(poses[:, 2] - pose[2])) > APART_RAD))


def _different(poses: Floats, shares: Floats, most: int) -> list[int]:
    """Return the indices of the best poses that are places of their own."""
    chosen: list[int] = []
    left = np.argsort(-shares, kind="stable")
    while len(left) and len(chosen) < most:
        chosen.append(int(left[0]))
        left = left[is_elsewhere(poses[left], poses[left[0]])]
    return chosen
