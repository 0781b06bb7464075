"""Poses of a window sought anew, when what is measured contradicts those that are believed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.smoother.problem import Solution, WindowProblem, descend

__all__ = ["seek_elsewhere", "with_open_start"]

# The first pose is held to where it was believed by no more than this [m, m, rad].
_OPEN = np.array([3.0, 3.0, math.pi])
_TURNS = (0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi)
_SHRINK = 4.0
# So many of all estimates must agree with the poses found, and the newest must be known so well [m, m, rad].
_MOST = 0.7
_KNOWN = np.array([1.0, 1.0, 0.5])


def with_open_start(problem: WindowProblem, first: Floats) -> WindowProblem:
    """Return a problem whose first pose is next to unknown."""
    return replace(problem, prior_mean=first, prior_information=np.diag(_OPEN**-2.0))


def seek_elsewhere(problem: WindowProblem, poses: Floats, weights: Floats) -> Solution | None:
    """Return poses on which most absolute estimates agree, more than now; None if there are none.

    All estimates count at first, and what contradicts is let go by and by (graduated non-convexity; Yang et al., RA-L
    5(2), 2020), from four headings.

    Parameters
    ----------
    problem : WindowProblem
        What is known; what the first pose was known by is doubted.
    poses : (N, 3) float64
        As believed.
    weights : (M,) float64
        Of the absolute estimates, as believed.
    """
    opened = with_open_start(problem, poses[0])
    found = [one for turn in _TURNS if (one := _let_go(opened, _turned(poses, turn))) is not None]
    if not found:
        return None
    best = max(found, key=lambda one: (_n_agreeing(one.weights), -one.cost))
    if _n_agreeing(best.weights) <= max(_n_agreeing(weights), _MOST * len(weights)):
        return None
    assert best.factor is not None
    sigmas = np.sqrt(best.factor.covariance(len(poses) - 1).diagonal())
    return best if bool((sigmas < _KNOWN).all()) else None


def _let_go(problem: WindowProblem, poses: Floats) -> Solution | None:
    try:
        found = descend(problem, poses, first_weights=np.ones(len(problem.absolutes.which)), scale=math.inf)
        worst = float((found.chi_squares / problem.absolutes.limits).max())
        while worst > 1.0:
            found = descend(problem, found.poses, scale=worst)
            worst /= _SHRINK
        return descend(problem, found.poses)
    except np.linalg.LinAlgError:
        return None


def _turned(poses: Floats, turn: float) -> Floats:
    """Return the poses turned about the place of the newest."""
    cos, sin = math.cos(turn), math.sin(turn)
    away = poses[:, :2] - poses[-1, :2]
    turned = poses[-1, :2] + away @ np.array([[cos, sin], [-sin, cos]])
    return np.column_stack([turned, poses[:, 2] + turn])


def _n_agreeing(weights: Floats) -> int:
    return int((weights > 0.5).sum())
