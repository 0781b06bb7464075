"""A graph of planar poses: odometry from each to the next, relations between places seen twice, solved together.

Gauss-Newton with Levenberg's damping on sparse normal equations. Relations are switchable: one that contradicts the
others loses its weight (dynamic covariance scaling; Agarwal et al., "Robust map optimization using dynamic covariance
scaling", ICRA 2013), so that a wrong one does not bend the map. At first all count; what contradicts is let go by
and by (graduated non-convexity; Yang et al., RA-L 5(2), 2020): where the poses begin does not decide who is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import splu

from trailmark.arrays import Bools, Floats, Indices
from trailmark.geometry import wrap_angles

__all__ = ["PoseEdges", "SolvedGraph", "chi_squares", "solve_pose_graph"]

_STEPS = 40
_SHRINK = 4.0
_ENOUGH = 1e-6
#: Chi square beyond which a relation loses weight: 99 % of right ones of three numbers stay below.
_SWITCH = 11.3


@dataclass(frozen=True, slots=True, eq=False)
class PoseEdges:
    """What is known of how poses lie to each other.

    Attributes
    ----------
    first, second : (E,) int
        Which poses.
    measured : (E, 3) float64
        The second as seen from the first, x, y and theta [m, m, rad].
    information : (E, 3, 3) float64
        Of these numbers.
    is_switchable : (E,) bool
        Whether the edge may be wrong altogether.
    """

    first: Indices
    second: Indices
    measured: Floats
    information: Floats
    is_switchable: Bools

    def __len__(self) -> int:
        return len(self.first)

    def __add__(self, other: PoseEdges) -> PoseEdges:
        return PoseEdges(
            *(np.concatenate([getattr(self, name), getattr(other, name)]) for name in self.__dataclass_fields__)
        )

    def select(self, which: Bools) -> PoseEdges:
        """Return some of the edges."""
        return PoseEdges(*(getattr(self, name)[which] for name in self.__dataclass_fields__))


@dataclass(frozen=True, slots=True, eq=False)
class SolvedGraph:
    """The poses that agree best.

    Attributes
    ----------
    poses : (N, 3) float64
        x, y and theta; the first is where it was [m, m, rad].
    chi_squares : (E,) float64
        How far each edge is off, in the measure of its information.
    weights : (E,) float64
        1 for an edge that counts in full, near 0 for one that is switched off.
    """

    poses: Floats
    chi_squares: Floats
    weights: Floats


def solve_pose_graph(poses: Floats, edges: PoseEdges) -> SolvedGraph:
    """Return the poses at which the edges are off least, the first held.

    Parameters
    ----------
    poses : (N, 3) float64
        To begin with; every pose is tied to the first by edges.
    edges : PoseEdges
        At least those that tie.
    """
    found = _state_of(poses, edges, np.inf)
    is_loop = edges.is_switchable
    scale = float(found.chi_squares[is_loop].max()) if is_loop.any() else 0.0
    while scale > _SWITCH:
        found = _descend(found, edges, scale)
        scale /= _SHRINK
    found = _descend(found, edges, _SWITCH)
    return replace(found, poses=np.column_stack([found.poses[:, :2], wrap_angles(found.poses[:, 2])]))


def _descend(found: SolvedGraph, edges: PoseEdges, scale: float) -> SolvedGraph:
    """Return the poses from which no step leads down, with relations switched at a scale."""
    found, damping = _state_of(found.poses, edges, scale), 1e-6
    for _ in range(_STEPS):
        step = _step(found, edges, damping)
        after = _state_of(found.poses + step, edges, scale)
        if _cost(after, edges, scale) <= _cost(found, edges, scale) * (1.0 + 1e-12):
            found, damping = after, max(0.1 * damping, 1e-12)
            if np.abs(step).max() < _ENOUGH:
                break
        else:
            damping *= 10.0
            if damping > 1e6:
                break
    return found


def chi_squares(poses: Floats, edges: PoseEdges) -> Floats:
    """Return how far edges are off at some poses, (E,)."""
    errors = _errors(poses, edges)
    return np.asarray(np.einsum("ni,nij,nj->n", errors, edges.information, errors))


def _state_of(poses: Floats, edges: PoseEdges, scale: float) -> SolvedGraph:
    squares = chi_squares(poses, edges)
    weights = np.ones(len(edges))
    if np.isfinite(scale):
        weights = np.where(edges.is_switchable, np.minimum(1.0, 2.0 * scale / (scale + squares)) ** 2, 1.0)
    return SolvedGraph(poses, squares, weights)


def _cost(state: SolvedGraph, edges: PoseEdges, scale: float) -> float:
    """Return what is least: the squares, of switchable edges bounded as Geman and McClure have it."""
    squares = state.chi_squares
    bounded = np.where(squares <= scale, squares, scale * (3.0 * squares - scale) / (scale + squares))
    return float(np.where(edges.is_switchable, bounded, squares).sum())


def _errors(poses: Floats, edges: PoseEdges) -> Floats:
    first, second = poses[edges.first], poses[edges.second]
    cos, sin = np.cos(first[:, 2]), np.sin(first[:, 2])
    dx, dy = (second[:, :2] - first[:, :2]).T
    between = np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx, second[:, 2] - first[:, 2]])
    errors = between - edges.measured
    errors[:, 2] = wrap_angles(errors[:, 2])
    return errors


def _step(state: SolvedGraph, edges: PoseEdges, damping: float) -> Floats:
    """Return the change of all poses, (N, 3)."""
    poses, n_poses = state.poses, len(state.poses)
    first, second = poses[edges.first], poses[edges.second]
    cos, sin = np.cos(first[:, 2]), np.sin(first[:, 2])
    dx, dy = (second[:, :2] - first[:, :2]).T
    at_second = np.zeros((len(edges), 3, 3))
    at_second[:, 0, 0], at_second[:, 0, 1], at_second[:, 1, 0], at_second[:, 1, 1] = cos, sin, -sin, cos
    at_second[:, 2, 2] = 1.0
    at_first = -at_second
    at_first[:, 0, 2], at_first[:, 1, 2] = cos * dy - sin * dx, -cos * dx - sin * dy
    errors = _errors(poses, edges)
    information = edges.information * state.weights[:, np.newaxis, np.newaxis]
    jacobian = np.concatenate([at_first, at_second], axis=2)  # (E, 3, 6)
    weighted = np.swapaxes(jacobian, 1, 2) @ information
    blocks, rights = weighted @ jacobian, weighted @ errors[:, :, np.newaxis]
    columns = np.concatenate([3 * edges.first[:, None] + np.arange(3), 3 * edges.second[:, None] + np.arange(3)], 1)
    rows = np.repeat(columns, 6, axis=1).ravel()
    matrix = coo_array((blocks.ravel(), (rows, np.tile(columns, (1, 6)).ravel())), shape=(3 * n_poses,) * 2).tocsc()
    right = np.bincount(columns.ravel(), weights=rights.ravel(), minlength=3 * n_poses)
    free = matrix[3:, 3:]
    damped = (free + diags_array(damping * free.diagonal())).tocsc()
    change = np.zeros(3 * n_poses)
    change[3:] = -splu(damped).solve(right[3:])
    return change.reshape(n_poses, 3)
