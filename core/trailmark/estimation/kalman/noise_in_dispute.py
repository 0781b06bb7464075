"""Noise that looks like a lie: what localizers differ by while somebody is accused, but differently every time."""

from __future__ import annotations

from collections.abc import Collection
from itertools import pairwise

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.noise_residuals import Residual
from trailmark.estimation.kalman.variance_components import AT_ITS_WORD

__all__ = ["is_lasting", "is_white", "noise_of_alternating"]

#: Correlation from one difference to the next: of poses that jump to and fro (expected: -0.5), and of white noise. How
#: many in a row tell, and beyond how many medians one is clipped. Median of the squared length of three normal numbers.
_ALTERNATES, _WHITE, _ENOUGH_IN_A_ROW, _LONGEST, _MEDIAN_OF_THREE = -0.25, 0.3, 14, 2.0, 2.366
_SAME_S = 0.25
#: As many tell that there is more than noise: until it is known, nothing is learned.
_FEW_IN_A_ROW = 6


def noise_of_alternating(found: Collection[Residual]) -> float | None:
    """Return how many times as large as stated the variance of absolute estimates is that jump to and fro.

    No wrong motion makes them do so: what is off after one step, is off to the other side after the next by noise of
    the estimate between the two alone. None where they do not, or are as good as stated.
    """
    told = _whitened(found, 2)
    if told is None:
        return None
    correlation, squares = told
    ratio = float(np.median(squares)) / _MEDIAN_OF_THREE
    return ratio if correlation < _ALTERNATES and ratio > AT_ITS_WORD**2 else None


def is_white(found: Collection[Residual]) -> bool:
    """Return whether motions that contradict each other do so differently all the time: it is noise, and no lie."""
    told = _whitened(found, 2)
    return told is not None and abs(told[0]) < _WHITE


def is_lasting(found: Collection[Residual]) -> bool:
    """Return whether motions differ the same way all the time: that is an error of one of them, and no noise."""
    told = _whitened(found, 2, n_least=_FEW_IN_A_ROW)
    return told is not None and told[0] > _WHITE


def _whitened(
    found: Collection[Residual], n_shares: int, n_least: int = _ENOUGH_IN_A_ROW
) -> tuple[float, Floats] | None:
    """Return how differences hang together from one to the next, and their squares; None for too few, or with gaps.

    In units of the first `n_shares` of their covariances; clipped, so that single outliers decide nothing.
    """
    if len(found) < n_least or any(abs(a.stamp_s - b.since_s) > _SAME_S for a, b in pairwise(found)):
        return None
    values = np.stack([one.value for one in found])
    spread = np.stack([one.covariances[:n_shares].sum(axis=0) for one in found])
    roots = np.sqrt(np.diagonal(spread, axis1=1, axis2=2))
    lower = np.linalg.cholesky(spread / (roots[:, :, None] * roots[:, None, :]))
    steps = np.linalg.solve(lower, (values / roots)[:, :, None])[:, :, 0]
    squares = np.einsum("ni,ni->n", steps, steps)
    clip = np.minimum(1.0, _LONGEST * np.sqrt(np.median(squares) / np.maximum(squares, 1e-300)))
    clipped = steps * clip[:, None]
    together, size = (
        float(np.einsum("ni,ni->", clipped[:-1], clipped[1:])),
        float(np.einsum("ni,ni->", clipped, clipped)),
    )
    return (together / size, squares) if size > 0.0 else None
