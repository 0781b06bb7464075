"""What is known of the poses of a window, and the poses at which it is off least."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trailmark.arrays import Floats, Indices
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.smoother.normal_equations import (
    BandedFactor,
    ChainBlocks,
    ChainMotions,
    chain_blocks,
    motion_chi_squares,
)
from trailmark.estimation.smoother.robust import bounded_chi_squares, weights_of
from trailmark.estimation.smoother_config import RobustLoss
from trailmark.geometry import wrap_angles
from trailmark.values import quick_dataclass

__all__ = ["Absolutes", "Solution", "WindowProblem", "descend"]

_STEPS = 10
# Gauss-Newton converges quadratically: after a step this small the next one is rounding [m, rad].
_ENOUGH = 1e-5
_NO_WORSE = 1e-9
# Where floats cannot hold what is known best beside what is vague, all is believed no better than this [m, rad], and in
# the last resort the diagonal is raised by this share.
_COARSER = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0)
_LAST_DAMPING = 1e-6


@quick_dataclass(frozen=True, slots=True, eq=False)
class Absolutes:
    """The absolute estimates of a window.

    Attributes
    ----------
    which : (M,) int
        The pose that each is about.
    values : (M, 3) float64
        x, y and theta in the map; of a path offset anything.
    information : (M, 3, 3) float64
        Of these numbers.
    limits : (M,) float64
        Chi square from which each loses weight.
    on_path : sequence of (int, Measurement)
        Those that are path offsets, by their row here.
    """

    which: Indices
    values: Floats
    information: Floats
    limits: Floats
    on_path: Sequence[tuple[int, Measurement]]


@quick_dataclass(frozen=True, slots=True, eq=False)
class WindowProblem:
    """A chain of poses, what its first is known by, and what measured any of them.

    Attributes
    ----------
    prior_mean, prior_information : (3,), (3, 3) float64
        Of the first pose.
    motions : ChainMotions
        From each pose to the next.
    absolutes : Absolutes
        Fixes and path offsets.
    loss : {"dcs", "huber", "none"}
        How the latter lose weight.
    """

    prior_mean: Floats
    prior_information: Floats
    motions: ChainMotions
    absolutes: Absolutes
    loss: RobustLoss


@quick_dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Poses, and how well they fit.

    Attributes
    ----------
    poses : (N, 3) float64
        x, y and theta [m, m, rad].
    chi_squares, weights : (M,) float64
        Of the absolute estimates.
    cost : float
        What is least.
    factor : BandedFactor or None
        Of the normal equations of the last step.
    """

    poses: Floats
    chi_squares: Floats
    weights: Floats
    cost: float
    factor: BandedFactor | None = None


def descend(
    problem: WindowProblem, poses: Floats, *, first_weights: Floats | None = None, scale: float = 1.0
) -> Solution:
    """Return the poses from which no step leads down.

    Where rounding hides what is vague beside what is known very well, the latter is believed less.

    Parameters
    ----------
    problem : WindowProblem
        What is known.
    poses : (N, 3) float64
        Where to begin.
    first_weights : (M,) float64, optional
        Weights of the first step; left out, those at the poses.
    scale : float
        Factor on the limits: 1, or more while what contradicts is let go by and by.
    """
    try:
        return _descend(problem, poses, first_weights, scale)
    except np.linalg.LinAlgError:
        pass
    for sigma in _COARSER:
        try:
            return _descend(_coarser(problem, sigma), poses, first_weights, scale)
        except np.linalg.LinAlgError:
            continue
    return _descend(_coarser(problem, _COARSER[-1]), poses, first_weights, scale, _LAST_DAMPING)


def _coarser(problem: WindowProblem, sigma: float) -> WindowProblem:
    """Return the problem with this standard deviation added to all errors; those of path offsets stay."""

    def widened(information: Floats) -> Floats:
        found = np.linalg.solve(np.eye(3) + sigma**2 * information, information)
        return np.asarray((found + np.swapaxes(found, -1, -2)) / 2.0)

    return replace(
        problem,
        prior_information=widened(problem.prior_information),
        motions=replace(problem.motions, information=widened(problem.motions.information)),
        absolutes=replace(problem.absolutes, information=widened(problem.absolutes.information)),
    )


def _descend(
    problem: WindowProblem, poses: Floats, first_weights: Floats | None, scale: float, least_damping: float = 0.0
) -> Solution:
    found, damping, n_done = _evaluate(problem, poses, scale), least_damping, 0
    weights = found.weights if first_weights is None else first_weights
    while True:
        blocks = _blocks(problem, found.poses, weights)
        factor = BandedFactor(blocks, damping)
        step = factor.step(blocks.gradient)
        after = _evaluate(problem, found.poses + step, scale)
        n_done += 1
        is_better = after.cost <= found.cost * (1.0 + _NO_WORSE) + _NO_WORSE
        if is_better or (n_done == 1 and first_weights is not None):
            found, weights, damping = after, after.weights, max(0.1 * damping, least_damping)
        else:
            damping = max(10.0 * damping, 1e-3)
        if n_done == _STEPS or float(np.abs(step).max()) < _ENOUGH:
            break
    poses = np.column_stack([found.poses[:, :2], wrap_angles(found.poses[:, 2])])
    return Solution(poses, found.chi_squares, found.weights, found.cost, factor)


def _evaluate(problem: WindowProblem, poses: Floats, scale: float) -> Solution:
    absolutes = problem.absolutes
    errors = _errors(absolutes, poses)
    squares = np.einsum("ni,nij,nj->n", errors, absolutes.information, errors)
    for row, measurement in absolutes.on_path:
        innovation, _ = measurement.innovation(poses[absolutes.which[row]])
        squares[row] = innovation @ innovation
    limits = absolutes.limits * scale
    away = _away(problem, poses)
    cost = away @ problem.prior_information @ away + motion_chi_squares(poses, problem.motions).sum()
    cost += bounded_chi_squares(problem.loss, squares, limits).sum()
    return Solution(poses, squares, weights_of(problem.loss, squares, limits), float(cost))


def _blocks(problem: WindowProblem, poses: Floats, weights: Floats) -> ChainBlocks:
    absolutes, blocks = problem.absolutes, chain_blocks(poses, problem.motions)
    information = absolutes.information * weights[:, np.newaxis, np.newaxis]
    gradients = np.einsum("nij,nj->ni", information, _errors(absolutes, poses))
    for row, measurement in absolutes.on_path:
        innovation, jacobian = measurement.innovation(poses[absolutes.which[row]])
        information[row] = weights[row] * jacobian.T @ jacobian
        gradients[row] = -weights[row] * jacobian.T @ innovation
    np.add.at(blocks.diagonal, absolutes.which, information)
    np.add.at(blocks.gradient, absolutes.which, gradients)
    blocks.diagonal[0] += problem.prior_information
    blocks.gradient[0] += problem.prior_information @ _away(problem, poses)
    return blocks


def _errors(absolutes: Absolutes, poses: Floats) -> Floats:
    errors = poses[absolutes.which] - absolutes.values
    errors[:, 2] = wrap_angles(errors[:, 2])
    return errors


def _away(problem: WindowProblem, poses: Floats) -> Floats:
    away = poses[0] - problem.prior_mean
    away[2] = wrap_angles(away[2:])[0]
    return np.asarray(away)
