"""Maxima of the Hessian determinant in place and scale, located between the grid points."""

from __future__ import annotations

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.kernels import kernel

__all__ = ["find_maxima"]


@kernel
def find_maxima(
    layers: AnyArray, first_size_px: int, size_step_px: int, step_px: int, threshold: float, out: AnyArray
) -> int:
    """Write the maxima of one octave to `out` and return how many there are (at most as many as fit).

    Parameters
    ----------
    layers : (L, h, w) float32
        Determinants; layer l has filters of ``first_size_px + l * size_step_px``.
    first_size_px, size_step_px : int
        Filter sizes of the octave [px].
    step_px : int
        Grid step of the octave [px].
    threshold : float
        Smallest determinant of a feature.
    out : (N, 6) float32
        u, v, scale [px], determinant, layer, and the size of its filter [px].
    """
    n_layers, height, width = layers.shape
    is_peak = np.zeros(width, np.int32)  # as wide as a determinant, so that the marking vectorises
    count = 0
    limit = np.float32(threshold)
    for layer in range(1, n_layers - 1):
        below, here, above = layers[layer - 1], layers[layer], layers[layer + 1]
        for i in range(1, height - 1):
            if not _mark_peaks(here[i - 1], here[i], here[i + 1], below[i], above[i], limit, is_peak):
                continue
            for j in range(1, width - 1):
                if is_peak[j] and _is_maximum(layers, layer, i, j) and count < out.shape[0]:
                    du, dv, ds = _offset(layers, layer, i, j)
                    if abs(du) > 1.0 or abs(dv) > 1.0 or abs(ds) > 1.0:
                        continue  # the parabola has its top elsewhere: no peak of its own
                    size_px = first_size_px + layer * size_step_px
                    out[count, 0] = (j + du) * step_px
                    out[count, 1] = (i + dv) * step_px
                    out[count, 2] = 1.2 / 9.0 * (size_px + ds * size_step_px)  # the 9 px filter is a sigma of 1.2
                    out[count, 3] = here[i, j]
                    out[count, 4] = layer
                    out[count, 5] = size_px
                    count += 1
    return count


@kernel
def _mark_peaks(
    up: AnyArray, here: AnyArray, down: AnyArray, below: AnyArray, above: AnyArray, limit: np.float32, is_peak: AnyArray
) -> bool:
    """Mark what beats its four neighbours and both scales: a cheap, vectorised pass that leaves few to look at."""
    n = here.shape[0] - 2
    left, centre, right = here, here[1:], here[2:]
    up, down, below, above, marks = up[1:], down[1:], below[1:], above[1:], is_peak[1:]
    total = np.int32(0)
    for k in range(n):
        value = centre[k]
        mark = np.int32(
            (value > limit)
            & (value >= left[k])
            & (value > right[k])
            & (value >= up[k])
            & (value > down[k])
            & (value > below[k])
            & (value >= above[k])
        )
        marks[k] = mark
        total += mark
    return bool(total > 0)


@kernel
def _is_maximum(layers: AnyArray, layer: int, i: int, j: int) -> bool:
    """Whether nothing among the 26 neighbours is larger; of equal ones the first counts."""
    value = layers[layer, i, j]
    for dl in range(-1, 2):
        for di in range(-1, 2):
            for dj in range(-1, 2):
                other = layers[layer + dl, i + di, j + dj]
                comes_first = dl * 9 + di * 3 + dj < 0
                if other > value or (other == value and comes_first):
                    return False
    return True


@kernel
def _offset(layers: AnyArray, layer: int, i: int, j: int) -> tuple[float, float, float]:
    """Return where the parabola through the neighbours has its top: (du, dv, ds) in grid steps (Brown & Lowe)."""
    c = 2.0 * layers[layer, i, j]
    gu = (layers[layer, i, j + 1] - layers[layer, i, j - 1]) / 2.0
    gv = (layers[layer, i + 1, j] - layers[layer, i - 1, j]) / 2.0
    gs = (layers[layer + 1, i, j] - layers[layer - 1, i, j]) / 2.0
    uu = layers[layer, i, j + 1] + layers[layer, i, j - 1] - c
    vv = layers[layer, i + 1, j] + layers[layer, i - 1, j] - c
    ss = layers[layer + 1, i, j] + layers[layer - 1, i, j] - c
    here, below, above = layers[layer], layers[layer - 1], layers[layer + 1]
    uv = (here[i + 1, j + 1] - here[i + 1, j - 1] - here[i - 1, j + 1] + here[i - 1, j - 1]) / 4.0
    us = (above[i, j + 1] - above[i, j - 1] - below[i, j + 1] + below[i, j - 1]) / 4.0
    vs = (above[i + 1, j] - above[i - 1, j] - below[i + 1, j] + below[i - 1, j]) / 4.0
    a, b, d = vv * ss - vs * vs, us * vs - uv * ss, uv * vs - us * vv
    determinant = uu * a + uv * b + us * d
    if determinant == 0.0:
        return 9.0, 9.0, 9.0
    e, f, h = uu * ss - us * us, uv * us - uu * vs, uu * vv - uv * uv
    du = -(a * gu + b * gv + d * gs) / determinant
    dv = -(b * gu + e * gv + f * gs) / determinant
    ds = -(d * gu + f * gv + h * gs) / determinant
    return du, dv, ds
