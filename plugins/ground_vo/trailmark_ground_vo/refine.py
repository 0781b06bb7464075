"""Photometric refinement: the rigid motion that makes the pixels look as remembered, to a hundredth of a pixel.

Efficient second-order minimisation (ESM): the mean of the remembered slopes, turned along, and those of the new
picture is the derivative of the residual to second order. Residuals are weighted after Huber. Gauss-Newton with the
slopes of the new picture alone drifts: they share its noise with the residuals.
"""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Float32s, Floats, Grey16
from trailmark.kernels import float_kernel, inner_kernel
from trailmark_ground_vo.texture import SLOPE_U, SLOPE_V, Texture, X, Y, residuals

__all__ = ["best_start", "mean_clipped", "mean_slopes", "refine"]

#: The refinement ends when a step is smaller than this: shift [px] and turn [rad], half of it at the edges.
_STEP_PX = 0.01
_STEP_RAD = 3e-5

#: A direction with less than this share of its information left, the others known, has none: it stays as it was.
_LEAST_SHARE = 1e-6


@float_kernel
def mean_clipped(differences: Float32s, clip: float) -> float:
    """Return the mean of the absolute residuals, each at most `clip`."""
    total, most = np.float32(0.0), np.float32(clip)
    for n in range(len(differences)):
        total += min(abs(differences[n]), most)
    return float(total / max(1, len(differences)))


@float_kernel
def mean_slopes(
    picture: Grey16, texture: Texture, centre: tuple[float, float], motion: tuple[float, float, float], aspect: float
) -> tuple[Float32s, Float32s]:
    """Return the mean of the remembered slopes, turned along, and those of the picture at every pixel.

    Parameters
    ----------
    picture : (H, W) uint16
        The new picture, smoothed.
    texture : (8, N) float32
        The remembered pixels.
    centre : (float, float)
        Centre of the turn [px].
    motion : (float, float, float)
        Shift and turn [px, px, rad].
    aspect : float
        Metres per pixel along v over those along u.

    Returns
    -------
    ((N,) float32, (N,) float32)
        Slopes along u and v [grey levels/px].
    """
    height, width = picture.shape
    pixels = picture.reshape(-1)
    cos = np.float32(math.cos(motion[2]))
    across, down = np.float32(math.sin(motion[2]) * aspect), np.float32(math.sin(motion[2]) / aspect)
    from_x, from_y = np.float32(centre[0]), np.float32(centre[1])
    to_x, to_y = np.float32(centre[0] + motion[0]), np.float32(centre[1] + motion[1])
    last_u, last_v, one = np.int32(width - 2), np.int32(height - 2), np.int32(1)
    n_pixels = texture.shape[1]
    slopes_u, slopes_v = np.empty(n_pixels, np.float32), np.empty(n_pixels, np.float32)
    quarter = np.float32(0.25)
    for n in range(n_pixels):
        dx, dy = texture[X, n] - from_x, texture[Y, n] - from_y
        x, y = cos * dx + across * dy + to_x, cos * dy - down * dx + to_y
        u = min(max(np.int32(x + np.float32(0.5)), one), last_u)
        v = min(max(np.int32(y + np.float32(0.5)), one), last_v)
        at = np.uintp(v * np.int32(width) + u)
        seen_u = np.int32(pixels[at + np.uintp(1)]) - np.int32(pixels[at - np.uintp(1)])
        seen_v = np.int32(pixels[at + np.uintp(width)]) - np.int32(pixels[at - np.uintp(width)])
        turned_u = cos * texture[SLOPE_U, n] + down * texture[SLOPE_V, n]
        turned_v = cos * texture[SLOPE_V, n] - across * texture[SLOPE_U, n]
        slopes_u[n] = np.float32(0.5) * turned_u + quarter * np.float32(seen_u)
        slopes_v[n] = np.float32(0.5) * turned_v + quarter * np.float32(seen_v)
    return slopes_u, slopes_v


@float_kernel
def _normal_equations(
    texture: Texture,
    differences: Float32s,
    slopes: tuple[Float32s, Float32s],
    centre: tuple[float, float],
    turn_rad: float,
    aspect: float,
    huber: float,
) -> tuple[Floats, Floats]:
    """Return A and b of the weighted least squares A step = b, (3, 3) and (3,) float64."""
    cos = np.float32(math.cos(turn_rad))
    across, down = np.float32(math.sin(turn_rad) * aspect), np.float32(math.sin(turn_rad) / aspect)
    from_x, from_y = np.float32(centre[0]), np.float32(centre[1])
    stretch, squeeze = np.float32(aspect), np.float32(1.0 / aspect)
    limit, least, one = np.float32(huber), np.float32(1e-3), np.float32(1.0)
    uu = uv = ut = vv = vt = tt = ru = rv = rt = np.float32(0.0)
    for n in range(texture.shape[1]):
        dx, dy = texture[X, n] - from_x, texture[Y, n] - from_y
        slope_u, slope_v, difference = slopes[0][n], slopes[1][n], differences[n]
        # derivative of the place with respect to the turn, times the slopes
        slope_t = slope_u * stretch * (cos * dy - down * dx) - slope_v * squeeze * (cos * dx + across * dy)
        weight = min(one, limit / max(abs(difference), least))
        weighted_u, weighted_v, weighted_t = weight * slope_u, weight * slope_v, weight * slope_t
        uu += weighted_u * slope_u
        uv += weighted_u * slope_v
        ut += weighted_u * slope_t
        vv += weighted_v * slope_v
        vt += weighted_v * slope_t
        tt += weighted_t * slope_t
        ru -= weighted_u * difference
        rv -= weighted_v * difference
        rt -= weighted_t * difference
    a, b = np.empty((3, 3), np.float64), np.empty(3, np.float64)
    a[0, 0], a[1, 1], a[2, 2] = uu, vv, tt
    a[0, 1] = a[1, 0] = uv
    a[0, 2] = a[2, 0] = ut
    a[1, 2] = a[2, 1] = vt
    b[0], b[1], b[2] = ru, rv, rt
    return a, b


@inner_kernel
def _solve(a: Floats, b: Floats) -> tuple[float, float, float]:
    """Return the solution of a symmetric (3, 3) system; what the system does not determine is left at zero."""
    d_0 = a[0, 0]
    i_0 = 1.0 / d_0 if d_0 > 0.0 else 0.0  # inverse pivots, zero where there is nothing left to divide by
    l_10, l_20 = a[0, 1] * i_0, a[0, 2] * i_0
    d_1 = a[1, 1] - l_10 * a[0, 1]
    i_1 = 1.0 / d_1 if d_1 > _LEAST_SHARE * a[1, 1] else 0.0
    c_21 = a[1, 2] - l_20 * a[0, 1]
    l_21 = c_21 * i_1
    d_2 = a[2, 2] - l_20 * a[0, 2] - l_21 * c_21
    i_2 = 1.0 / d_2 if d_2 > _LEAST_SHARE * a[2, 2] else 0.0
    z_1 = b[1] - l_10 * b[0]
    x_2 = (b[2] - l_20 * b[0] - l_21 * z_1) * i_2
    x_1 = z_1 * i_1 - l_21 * x_2
    return b[0] * i_0 - l_10 * x_1 - l_20 * x_2, x_1, x_2


@float_kernel
def refine(
    picture: Grey16,
    texture: Texture,
    centre: tuple[float, float],
    start: tuple[float, float, float],
    aspect: float,
    huber: float,
    max_iterations: int,
) -> tuple[tuple[float, float, float], Floats, int]:
    """Return the motion that makes the pixels look as remembered.

    Parameters
    ----------
    picture : (H, W) uint16
        The new picture, smoothed.
    texture : (8, N) float32
        The remembered pixels.
    centre : (float, float)
        Centre of the turn [px].
    start : (float, float, float)
        Shift and turn to start from [px, px, rad].
    aspect : float
        Metres per pixel along v over those along u.
    huber : float
        Residual beyond which a pixel counts linearly, in units of `picture`.
    max_iterations : int
        End of patience.

    Returns
    -------
    motion : (float, float, float)
        Shift and turn [px, px, rad].
    curvature : (3, 3) float64
        Half the second derivative of the cost: inverse covariance of the motion for residuals of variance 1.
    iterations : int
        Steps taken.
    """
    u, v, turn = start
    curvature = np.zeros((3, 3), np.float64)
    iterations = 0
    while iterations < max_iterations:
        iterations += 1
        motion = (u, v, turn)
        differences = residuals(picture, texture, centre, motion, aspect)
        slopes = mean_slopes(picture, texture, centre, motion, aspect)
        curvature, b = _normal_equations(texture, differences, slopes, centre, turn, aspect, huber)
        step_u, step_v, step_turn = _solve(curvature, b)
        u, v, turn = u + step_u, v + step_v, turn + step_turn
        if abs(step_u) < _STEP_PX and abs(step_v) < _STEP_PX and abs(step_turn) < _STEP_RAD:
            break
    return (u, v, turn), curvature, iterations


@float_kernel
def best_start(
    picture: Grey16, texture: Texture, centre: tuple[float, float], starts: Floats, aspect: float, clip: float
) -> int:
    """Return which of the motions in `starts`, (M, 3), leaves the least clipped residual.

    Parameters
    ----------
    picture : (H, W) uint16
        The new picture, smoothed.
    texture : (8, N) float32
        The remembered pixels.
    centre : (float, float)
        Centre of the turn [px].
    starts : (M, 3) float64
        Shifts and turns [px, px, rad].
    aspect : float
        Metres per pixel along v over those along u.
    clip : float
        Residuals count at most so much [grey levels].

    Returns
    -------
    int
        Row of `starts`.
    """
    best, least = 0, math.inf
    for m in range(len(starts)):
        motion = (starts[m, 0], starts[m, 1], starts[m, 2])
        cost = mean_clipped(residuals(picture, texture, centre, motion, aspect), clip)
        if cost < least:
            best, least = m, cost
    return best
