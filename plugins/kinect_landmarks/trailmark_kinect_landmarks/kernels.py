"""Loops that would be many calls of numpy: over pixels with depth, and over landmarks and the pose they agree on."""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Depth, Float32s, Floats, Grey8, Indices
from trailmark.kernels import kernel

__all__ = [
    "believed_depth",
    "best_pixels",
    "colour_counts",
    "keep_apart",
    "normal_equations",
    "whitened_misses",
    "widest_pair",
]


@kernel
def believed_depth(
    depth_m: Depth, median_m: Depth, n_known: Grey8, brightest: Grey8, share: np.float32, counts: tuple[int, int, int]
) -> Depth:
    """Return depth without what flies between two surfaces and what shines, small holes filled.

    Parameters
    ----------
    depth_m, median_m : (H, W) float32
        Depth, 0 where unknown, and its median around each pixel [m].
    n_known, brightest : (H, W) uint8
        How many pixels around each have depth, and the grey level of the brightest of them.
    share : float32
        How far from the median depth may be, as a share of it.
    counts : (int, int, int)
        More pixels than the first must have depth for a hole to be filled with the median; around something as bright
        as the third, fewer than the second are gloss.

    Returns
    -------
    (H, W) float32
        NaN where unknown [m].
    """
    believed = np.empty_like(depth_m)
    enough, gloss, saturated = counts
    for v in range(depth_m.shape[0]):
        for u in range(depth_m.shape[1]):
            depth, median, n = depth_m[v, u], median_m[v, u], n_known[v, u]
            value = median if n > enough and median > 0.0 else np.float32(np.nan)
            if depth > 0.0 and abs(depth - median) <= share * median:
                value = depth
            believed[v, u] = np.float32(np.nan) if brightest[v, u] >= saturated and n < gloss else value
    return believed


@kernel
def best_pixels(cornerness: Float32s, boxes: Floats, most_px: float, around_px: float) -> tuple[Floats, Floats]:
    """Return the best marked pixel in each box, (N, 2), and how well marked it is, (N,).

    Parameters
    ----------
    cornerness : (H, W) float32
        How well each pixel is marked.
    boxes : (N, 4) float64
        Upper left corner, width and height [px].
    most_px, around_px : float
        A side counts no more than `most_px`, and `around_px` is added on either side.

    Returns
    -------
    (N, 2), (N,) float64
        Of several the first, line by line. A box beyond the border has the nearest pixel of the picture, and 0.
    """
    height, width = cornerness.shape
    uv, strength = np.empty((len(boxes), 2)), np.zeros(len(boxes))
    for row in range(len(boxes)):
        u, v = boxes[row, 0] + (boxes[row, 2] - 1.0) / 2.0, boxes[row, 1] + (boxes[row, 3] - 1.0) / 2.0
        half_u, half_v = min(boxes[row, 2], most_px) / 2.0 + around_px, min(boxes[row, 3], most_px) / 2.0 + around_px
        u0, v0 = max(0, int(u - half_u)), max(0, int(v - half_v))
        u1, v1 = min(width, max(0, int(u + half_u) + 1)), min(height, max(0, int(v + half_v) + 1))
        if u0 >= u1 or v0 >= v1:  # an ellipse that is cut by the border may have its centre beyond
            uv[row, 0], uv[row, 1] = min(max(u, 0.0), width - 1.0), min(max(v, 0.0), height - 1.0)
            continue
        best, best_u, best_v = cornerness[v0, u0], u0, v0
        for at_v in range(v0, v1):
            for at_u in range(u0, u1):
                if cornerness[at_v, at_u] > best:
                    best, best_u, best_v = cornerness[at_v, at_u], at_u, at_v
        uv[row, 0], uv[row, 1], strength[row] = best_u, best_v, best
    return uv, strength


@kernel
def keep_apart(uv: Floats, order: Indices, taken_uv: Floats, apart_px: float, n: int) -> Indices:
    """Return rows of `uv`, as they come in `order`, none within a square around one before it or one that is taken.

    Parameters
    ----------
    uv, taken_uv : (N, 2), (K, 2) float64
        Pixels [px].
    order : (N,) int
        Rows of `uv`, the best first.
    apart_px : float
        Half the side of the square [px].
    n : int
        How many at the most.
    """
    kept, n_kept = np.empty(len(order), np.intp), 0
    for row in order:
        if n_kept >= n:
            break
        u, v = uv[row, 0], uv[row, 1]
        is_free = True
        for other in range(len(taken_uv)):
            if max(abs(u - taken_uv[other, 0]), abs(v - taken_uv[other, 1])) < apart_px:
                is_free = False
                break
        for i in range(n_kept):
            if not is_free or max(abs(u - uv[kept[i], 0]), abs(v - uv[kept[i], 1])) < apart_px:
                is_free = False
                break
        if is_free:
            kept[n_kept] = row
            n_kept += 1
    return kept[:n_kept]


@kernel
def colour_counts(index: Grey8, centres: Indices, radius_px: int, n_bins: int) -> Float32s:
    """Return how many pixels of each colour class lie in the square around each centre, (N, B).

    Parameters
    ----------
    index : (H, W) uint8
        Colour class of every pixel.
    centres : (N, 2) int
        Pixels (u, v); those beyond the border are moved to it, and the square ends there [px].
    radius_px : int
        Half the side of the square [px].
    n_bins : int
        B, more than the greatest class.
    """
    height, width = index.shape
    counts = np.zeros((len(centres), n_bins), np.float32)
    for row in range(len(centres)):
        u, v = min(max(centres[row, 0], 0), width - 1), min(max(centres[row, 1], 0), height - 1)
        for at_v in range(max(0, v - radius_px), min(height, v + radius_px + 1)):
            for at_u in range(max(0, u - radius_px), min(width, u + radius_px + 1)):
                counts[row, index[at_v, at_u]] += 1.0
    return counts


@kernel
def widest_pair(points: Floats) -> tuple[float, float]:
    """Return the largest distance between two of the points, (N, D), and the least cosine between two directions."""
    n, D = points.shape
    lengths = np.empty(n)
    for row in range(n):
        squared = 0.0
        for i in range(D):
            squared += points[row, i] ** 2
        lengths[row] = max(math.sqrt(squared), 1e-9)
    apart, cosine = 0.0, 1.0
    for row in range(n):
        for other in range(row):
            squared = product = 0.0
            for i in range(D):
                squared += (points[row, i] - points[other, i]) ** 2
                product += points[row, i] * points[other, i]
            apart = max(apart, squared)
            cosine = min(cosine, product / (lengths[row] * lengths[other]))
    return math.sqrt(apart), cosine


@kernel(error_model="numpy")
def whitened_misses(
    points_a: Floats, points_b: Floats, cov_a: Floats, cov_b: Floats, R: Floats, t: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return by how much points miss ``points_a = R points_b + t``, in sigmas.

    Parameters
    ----------
    points_a, points_b : (N, D) float64
        Row by row the same point [m].
    cov_a, cov_b : (N, D, D) float64
        Their covariances, in the axes of their points [m^2].
    R, t : (D, D), (D,) float64
        The motion.

    Returns
    -------
    misses : (N, D) float64
        Of unit covariance each.
    whitening : (N, D, D) float64
        Lower triangles that make metres of them; the product with their transpose, which comes first, is information.
    squared : (N,) float64
        Squared lengths of the misses; NaN where a covariance is none.
    """
    n, D = points_a.shape
    misses, whitening, squared = np.zeros((n, D)), np.zeros((n, D, D)), np.zeros(n)
    turned, root, miss = np.empty((D, D)), np.empty((D, D)), np.empty(D)
    for row in range(n):
        W = whitening[row]
        for i in range(D):
            miss[i] = points_a[row, i] - t[i]
            for j in range(D):
                miss[i] -= R[i, j] * points_b[row, j]
                turned[i, j] = 0.0
                for k in range(D):
                    turned[i, j] += R[i, k] * cov_b[row, k, j]
        for j in range(D):  # the root of the covariance (Cholesky), column by column
            for i in range(j, D):
                rest = cov_a[row, i, j]
                for k in range(D):
                    rest += turned[i, k] * R[j, k]
                for k in range(j):
                    rest -= root[i, k] * root[j, k]
                root[i, j] = math.sqrt(rest) if i == j else rest / root[j, j]
        for j in range(D):  # and its inverse
            W[j, j] = 1.0 / root[j, j]
            for i in range(j + 1, D):
                for k in range(j, i):
                    W[i, j] -= root[i, k] * W[k, j]
                W[i, j] /= root[i, i]
        for i in range(D):
            for k in range(i + 1):
                misses[row, i] += W[i, k] * miss[k]
            squared[row] += misses[row, i] ** 2
    return misses, whitening, squared


@kernel(error_model="numpy")
def normal_equations(
    turned: Floats, misses: Floats, whitening: Floats, weights: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return the sums of a Gauss-Newton step over points that count.

    Parameters
    ----------
    turned : (N, D) float64
        ``R points_b``, D 2 or 3 [m].
    misses, whitening
        Of `whitened_misses`.
    weights : (N,) float64
        0: the point does not count.

    Returns
    -------
    weighted, gradient : (P, P), (P,) float64
        Of translation and left rotation, P 3 or 6.
    information : (P, P) float64
        The same as `weighted` with all that count counting fully.
    """
    n, D = turned.shape
    P = 3 if D == 2 else 6
    weighted, information, gradient = np.zeros((P, P)), np.zeros((P, P)), np.zeros(P)
    J, turn = np.empty((D, P)), np.zeros((D, P - D))
    for row in range(n):
        weight = weights[row]
        if weight == 0.0:
            continue
        if D == 2:
            turn[0, 0], turn[1, 0] = -turned[row, 1], turned[row, 0]
        else:
            x, y, z = turned[row, 0], turned[row, 1], turned[row, 2]
            turn[0, 1], turn[0, 2], turn[1, 0] = z, -y, -z
            turn[1, 2], turn[2, 0], turn[2, 1] = x, y, -x
        for i in range(D):
            for p in range(P):
                J[i, p] = whitening[row, i, p] if p < D else 0.0
                for k in range(D):
                    if p >= D:
                        J[i, p] += whitening[row, i, k] * turn[k, p - D]
        for p in range(P):
            for i in range(D):
                gradient[p] += weight * J[i, p] * misses[row, i]
            for q in range(p + 1):
                product = 0.0
                for i in range(D):
                    product += J[i, p] * J[i, q]
                information[p, q] += product
                weighted[p, q] += weight * product
    for p in range(P):
        for q in range(p):
            information[q, p], weighted[q, p] = information[p, q], weighted[p, q]
    return weighted, gradient, information
