"""Orientation and 64-d descriptor of SURF from Haar wavelets on the integral image (Bay et al. 2006, Sec. 4)."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from trailmark.arrays import AnyArray
from trailmark.kernels import float_kernel, inlined_kernel, kernel

__all__ = ["describe", "haar", "orient", "region_weights"]


N_SAMPLES = 24  # along each side of the described square
N_REGIONS = 4
REGION_SAMPLES = 9  # neighbouring regions overlap: a point near the border counts for both (Agrawal et al. 2008)

_N_BINS = 72
_WINDOW_BINS = 12  # pi / 3
_ORIENTATION_RADIUS = 6
_ORIENTATION_SIGMA = 2.5


def region_weights() -> npt.NDArray[np.float32]:
    """Return the weight of every sample along one axis for each of the four regions, (4, 24) float32.

    The weight of a sample in a region is the product of its weights along both axes: a Gaussian about the region's
    centre (sigma 2.5 samples), times one of the region about the feature (sigma 1.5 regions).
    """
    weights = np.zeros((N_REGIONS, N_SAMPLES), np.float32)
    for region in range(N_REGIONS):
        first = 5 * region
        samples = np.arange(first, first + REGION_SAMPLES)
        inner = np.exp(-((samples - first - 4) ** 2) / (2 * 2.5**2))
        outer = math.exp(-((region - 1.5) ** 2) / (2 * 1.5**2))
        weights[region, samples] = inner * outer
    return weights


@inlined_kernel
def haar(integral: AnyArray, u: int, v: int, half: int) -> tuple[int, int]:
    """Return the Haar responses along u and v of the square of side ``2 * half`` about the pixel corner (u, v).

    The corner (u, v) lies between the pixels u - 1 and u. Near the border the square is moved into the image.

    Parameters
    ----------
    integral : (H + 1, W + 1) int
        Integral image.
    u, v : int
        Pixel corner of the square's middle [px].
    half : int
        Half the side of the square [px].

    Returns
    -------
    (int, int)
        Right minus left half, lower minus upper half [grey levels].
    """
    u = min(max(u, half), integral.shape[1] - 1 - half)
    v = min(max(v, half), integral.shape[0] - 1 - half)
    top, middle, bottom = integral[v - half], integral[v], integral[v + half]
    left, right = u - half, u + half
    top_left, top_right, bottom_left, bottom_right = top[left], top[right], bottom[left], bottom[right]
    du = (bottom_right + bottom_left - top_right - top_left) - 2 * (bottom[u] - top[u])
    dv = (bottom_right - bottom_left + top_right - top_left) - 2 * (middle[right] - middle[left])
    return du, dv


@kernel
def orient(integral: AnyArray, points: AnyArray, angles: AnyArray) -> None:
    """Write the dominant gradient direction around every point to `angles`, from +u towards +v [rad].

    Parameters
    ----------
    integral : (H + 1, W + 1) int32
        Integral image.
    points : (N, >= 3) float32
        u, v and scale [px].
    angles : (N,) float32
        Out.
    """
    bins = np.empty((_N_BINS, 2), np.float64)
    gauss = np.exp(-np.arange(_ORIENTATION_RADIUS**2) / (2.0 * _ORIENTATION_SIGMA**2))
    for n in range(points.shape[0]):
        scale = points[n, 2]
        half = max(1, int(2.0 * scale + 0.5))
        bins[:] = 0.0
        for i in range(-_ORIENTATION_RADIUS, _ORIENTATION_RADIUS + 1):
            for j in range(-_ORIENTATION_RADIUS, _ORIENTATION_RADIUS + 1):
                squared = i * i + j * j
                if squared >= _ORIENTATION_RADIUS * _ORIENTATION_RADIUS:
                    continue
                u = math.floor(points[n, 0] + j * scale + 1.0)
                v = math.floor(points[n, 1] + i * scale + 1.0)
                du, dv = haar(integral, u, v, half)
                weight = gauss[squared]
                k = int((math.atan2(dv, du) + math.pi) * (_N_BINS / (2.0 * math.pi)))
                k = min(k, _N_BINS - 1)
                bins[k, 0] += weight * du
                bins[k, 1] += weight * dv
        angles[n] = _strongest_window(bins)


@kernel
def _strongest_window(bins: AnyArray) -> float:
    """Return the direction of the largest sum within a window of pi / 3."""
    x = y = 0.0
    for k in range(_WINDOW_BINS):
        x += bins[k, 0]
        y += bins[k, 1]
    best, best_x, best_y = -1.0, 1.0, 0.0
    for k in range(_N_BINS):
        length = x * x + y * y
        if length > best:
            best, best_x, best_y = length, x, y
        leaving, entering = k, (k + _WINDOW_BINS) % _N_BINS
        x += bins[entering, 0] - bins[leaving, 0]
        y += bins[entering, 1] - bins[leaving, 1]
    return math.atan2(best_y, best_x)


@float_kernel
def describe(
    integral: AnyArray, points: AnyArray, angles: AnyArray, weights: AnyArray, spacing: np.float32, out: AnyArray
) -> None:
    """Write the descriptors, unit vectors, to `out`.

    Per region: the sums of dx, dy, abs(dx) and abs(dy), along and across the orientation. Regions are sums with
    separable weights, so rows are summed first, all columns at once.

    Parameters
    ----------
    integral : (H + 1, W + 1) int32
        Integral image.
    points : (N, >= 3) float32
        u, v and scale [px].
    angles : (N,) float32
        Orientation [rad].
    weights : (4, 24) float32
        See `region_weights`.
    spacing : float32
        From one sample to the next [scales]; the paper's is 1, and the described square 24 scales wide.
    out : (N, 64) float32
        Descriptors.
    """
    responses = np.empty((4, N_SAMPLES, N_SAMPLES), np.float32)
    columns = np.empty((N_REGIONS, 4, N_SAMPLES), np.float32)
    for n in range(points.shape[0]):
        _sample(integral, points[n], angles[n], spacing, responses)
        columns[:] = np.float32(0.0)
        for region in range(N_REGIONS):
            for i in range(5 * region, 5 * region + REGION_SAMPLES):
                weight = weights[region, i]
                for channel in range(4):
                    row, total = responses[channel, i], columns[region, channel]
                    for j in range(N_SAMPLES):
                        total[j] += weight * row[j]
        _sum_columns(columns, weights, out[n])


@float_kernel
def _sample(integral: AnyArray, point: AnyArray, angle: float, spacing: np.float32, responses: AnyArray) -> None:
    """Fill `responses` with dx, dy, abs(dx), abs(dy) on the turned grid."""
    scale = point[2]
    half = max(1, int(scale + 0.5))
    cos, sin = np.float32(math.cos(angle)), np.float32(math.sin(angle))
    step_u, step_v = spacing * scale * cos, spacing * scale * sin
    for i in range(N_SAMPLES):
        start_u = point[0] + 1.0 - (i - 11.5) * step_v - 11.5 * step_u
        start_v = point[1] + 1.0 + (i - 11.5) * step_u - 11.5 * step_v
        for j in range(N_SAMPLES):
            u = math.floor(start_u + j * step_u)
            v = math.floor(start_v + j * step_v)
            du, dv = haar(integral, u, v, half)
            along = cos * du + sin * dv
            across = cos * dv - sin * du
            responses[0, i, j], responses[1, i, j] = along, across
            responses[2, i, j], responses[3, i, j] = abs(along), abs(across)


@float_kernel
def _sum_columns(columns: AnyArray, weights: AnyArray, out: AnyArray) -> None:
    """Sum the columns of each region and make the descriptor a unit vector."""
    length = np.float32(0.0)
    k = 0
    for region_v in range(N_REGIONS):
        for region_u in range(N_REGIONS):
            for channel in range(4):
                total = np.float32(0.0)
                for j in range(5 * region_u, 5 * region_u + REGION_SAMPLES):
                    total += weights[region_u, j] * columns[region_v, channel, j]
                out[k] = total
                length += total * total
                k += 1
    scale = np.float32(1.0) / math.sqrt(length) if length > 0.0 else np.float32(0.0)
    for k in range(out.shape[0]):
        out[k] *= scale
