"""Motions chained into longer ones, with the covariance that their own say."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from trailmark.arrays import Floats, Indices
from trailmark.geometry import wrap_angles

__all__ = ["chain_windows", "chained_motion", "covariances_of", "windows"]

_SAME_INSTANT_S = 1e-6
# What was not measured is as wide as this [m^2, rad^2].
_UNMEASURED = 1e6
_RANK_TOLERANCE = 1e-12


def covariances_of(information: Floats) -> Floats:
    """Return the covariances (N, 3, 3) of information matrices; directions that were not measured are very wide."""
    diagonal = np.sqrt(np.maximum(np.diagonal(information, axis1=1, axis2=2), 0.0))
    scale = 1.0 / np.where(diagonal > 0.0, diagonal, 1.0)
    values, vectors = np.linalg.eigh(information * scale[:, :, None] * scale[:, None, :])
    known = values > _RANK_TOLERANCE
    spread = np.einsum("nij,nj,nkj->nik", vectors, np.where(known, 1.0 / np.where(known, values, 1.0), 0.0), vectors)
    blind = vectors * scale[:, :, None]  # in metres and radians again
    blind = np.where(known[:, None, :], 0.0, blind / np.linalg.norm(blind, axis=1, keepdims=True))
    return np.asarray(spread * scale[:, :, None] * scale[:, None, :] + _UNMEASURED * blind @ blind.transpose(0, 2, 1))


def chained_motion(steps: Floats, covariances: Floats) -> tuple[Floats, Floats]:
    """Return motions that follow each other as one, (3,), and its covariance, (3, 3).

    An error of step k shifts the end along the axes at its beginning and turns all that follows about its own end:
    ``J_k = [R_k-1, S (p - p_k); 0, 1]`` with S the quarter turn. Independent errors add.

    Parameters
    ----------
    steps : (N, 3) float64
        x, y, theta of each, seen from where it begins [m, m, rad].
    covariances : (N, 3, 3) float64
        Of each.
    """
    headings = np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    cos, sin = np.cos(headings[:-1]), np.sin(headings[:-1])
    ends = np.cumsum(
        np.stack([cos * steps[:, 0] - sin * steps[:, 1], sin * steps[:, 0] + cos * steps[:, 1]], axis=1), axis=0
    )
    rest = ends[-1] - ends
    J = np.zeros((len(steps), 3, 3))
    J[:, 0, 0], J[:, 0, 1], J[:, 0, 2] = cos, -sin, -rest[:, 1]
    J[:, 1, 0], J[:, 1, 1], J[:, 1, 2] = sin, cos, rest[:, 0]
    J[:, 2, 2] = 1.0
    end = np.array([*ends[-1], float(wrap_angles(headings[-1:])[0])])
    return end, np.einsum("nij,njk,nlk->il", J, covariances, J)


def windows(since_s: Floats, stamp_s: Floats, way: Floats, length: float) -> Iterator[tuple[int, int]]:
    """Yield ``(first, behind)`` of pieces that follow each other without a gap and without overlap.

    Parameters
    ----------
    since_s, stamp_s : (N,) float64
        Of the motions, in their order [s].
    way : (N,) float64
        What each adds to a piece, in the unit of `length`: its duration, or the true way.
    length : float
        A piece ends as soon as it is this long.
    """
    first, sofar = 0, 0.0
    for index in range(len(stamp_s)):
        if index > first and abs(since_s[index] - stamp_s[index - 1]) > _SAME_INSTANT_S:
            first, sofar = index, 0.0
        sofar += float(way[index])
        if sofar >= length * (1.0 - 1e-9):
            yield first, index + 1
            first, sofar = index + 1, 0.0


def chain_windows(
    steps: Floats, covariances: Floats, pieces: list[tuple[int, int]]
) -> tuple[Floats, Floats, Indices, Indices]:
    """Return each piece as one motion (M, 3), its covariance (M, 3, 3), and its first and last row (M,)."""
    chained = [chained_motion(steps[first:behind], covariances[first:behind]) for first, behind in pieces]
    motions = np.array([motion for motion, _ in chained]).reshape(-1, 3)
    spreads = np.array([spread for _, spread in chained]).reshape(-1, 3, 3)
    rows = np.array(pieces, dtype=np.intp).reshape(-1, 2)
    return motions, spreads, rows[:, 0], rows[:, 1] - 1
