"""Fast Hessian: determinants of box-filtered second derivatives from the integral image (Bay et al. 2006, Sec. 3)."""

from __future__ import annotations

import numpy as np

from trailmark.arrays import AnyArray
from trailmark.kernels import kernel

__all__ = ["box_derivatives", "halve_layer", "hessian_layer", "integral_image"]


_DXY_WEIGHT = np.float32(0.81)  # 0.9^2: boxes against Gaussians, Sec. 3.2


@kernel
def integral_image(image: AnyArray, out: AnyArray) -> None:
    """Fill `out`, (H + 1, W + 1) int32: `out[v, u]` is the sum of all pixels above and left of (u, v)."""
    height, width = image.shape
    out[0] = 0
    for v in range(height):
        pixels, above, row = image[v], out[v], out[v + 1]
        row[0] = 0
        total = np.int32(0)
        for u in range(width):
            total += np.int32(pixels[u])
            row[u + 1] = above[u + 1] + total


@kernel
def hessian_layer(integral: AnyArray, size_px: int, step_px: int, out: AnyArray) -> None:
    """Fill `out` with the determinant at every `step_px`-th pixel, zero where the filter leaves the image.

    Rows are combined first and columns then, all of them and not every `step_px`-th: both loops vectorise.

    Parameters
    ----------
    integral : (H + 1, W + 1) int32
        Integral image.
    size_px : int
        Side of the filter, an odd multiple of 3.
    step_px : int
        Grid step: ``out[i, j]`` is about pixel (j * step_px, i * step_px).
    out : (ceil(H / step), ceil(W / step)) float32
        Determinant over the area of the filter squared [grey levels^2].
    """
    height, width = integral.shape[0] - 1, integral.shape[1] - 1
    lobe, border = size_px // 3, size_px // 2
    n = width - 2 * border
    if n <= 0 or height <= 2 * border:
        out[:] = np.float32(0.0)
        return
    for_xx, for_yy, for_xy = np.empty(width + 1, np.int32), np.empty(width + 1, np.int32), np.empty(width + 1, np.int32)
    determinant = np.empty(n, np.float32)
    first, last = (border + step_px - 1) // step_px, (height - border - 1) // step_px
    left, right = (border + step_px - 1) // step_px, (width - border - 1) // step_px
    scale = np.float32(1.0 / size_px**2)
    out[:first] = np.float32(0.0)
    out[last + 1 :] = np.float32(0.0)
    for i in range(first, last + 1):
        row = out[i]
        _combine_rows(integral, i * step_px, lobe, border, for_xx, for_yy, for_xy)
        row[:left] = np.float32(0.0)
        row[right + 1 :] = np.float32(0.0)
        if step_px == 1:  # straight to where it belongs: the detour costs a third
            _combine_columns(for_xx, for_yy, for_xy, lobe, border, scale, row[border : border + n])
        else:
            _combine_columns(for_xx, for_yy, for_xy, lobe, border, scale, determinant)
            for j in range(left, right + 1):
                row[j] = determinant[j * step_px - border]


@kernel
def _combine_columns(
    for_xx: AnyArray, for_yy: AnyArray, for_xy: AnyArray, lobe: int, border: int, scale: np.float32, out: AnyArray
) -> None:
    """Write the determinants of a row to `out`, the first about the pixel `border`."""
    half = lobe // 2
    far, near = for_xx[2 * border + 1 :], for_xx
    inner_far, inner_near = for_xx[border - half + lobe :], for_xx[border - half :]
    yy_far, yy_near = for_yy[border + lobe :], for_yy[border - lobe + 1 :]
    xy_4, xy_3, xy_2, xy_1 = (
        for_xy[border + lobe + 1 :],
        for_xy[border + 1 :],
        for_xy[border:],
        for_xy[border - lobe :],
    )
    for k in range(out.shape[0]):
        dxx = scale * np.float32((far[k] - near[k]) - np.int32(3) * (inner_far[k] - inner_near[k]))
        dyy = scale * np.float32(yy_far[k] - yy_near[k])
        dxy = scale * np.float32((xy_4[k] - xy_3[k]) - (xy_2[k] - xy_1[k]))
        out[k] = dxx * dyy - _DXY_WEIGHT * dxy * dxy


@kernel
def _combine_rows(
    integral: AnyArray, v: int, lobe: int, border: int, for_xx: AnyArray, for_yy: AnyArray, for_xy: AnyArray
) -> None:
    """Combine the rows of the integral image that the three filters at row v need."""
    half = lobe // 2
    xx_0, xx_1 = integral[v - lobe + 1], integral[v + lobe]
    yy_0, yy_1, yy_2, yy_3 = (
        integral[v - border],
        integral[v - half],
        integral[v - half + lobe],
        integral[v + border + 1],
    )
    xy_0, xy_1, xy_2, xy_3 = integral[v - lobe], integral[v], integral[v + 1], integral[v + lobe + 1]
    for u in range(for_xx.shape[0]):
        for_xx[u] = xx_1[u] - xx_0[u]
        for_yy[u] = (yy_3[u] - yy_0[u]) - np.int32(3) * (yy_2[u] - yy_1[u])
        for_xy[u] = (xy_1[u] - xy_0[u]) - (xy_3[u] - xy_2[u])


@kernel
def halve_layer(layer: AnyArray, out: AnyArray) -> None:
    """Take every second value: a layer of one octave is a layer of the next one too."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = layer[2 * i, 2 * j]


@kernel
def _box(integral: AnyArray, v: int, u: int, height: int, width: int) -> int:
    top, bottom = integral[v], integral[v + height]
    return int(bottom[u + width]) - int(bottom[u]) - int(top[u + width]) + int(top[u])


@kernel
def box_derivatives(integral: AnyArray, v: int, u: int, size_px: int) -> tuple[float, float, float]:
    """Return Dxx, Dyy and Dxy of the filter at one pixel, over its area [grey levels].

    Parameters
    ----------
    integral : (H + 1, W + 1) int
        Integral image.
    v, u : int
        Row and column of the filter's middle [px].
    size_px : int
        Side of the filter [px].

    Returns
    -------
    (float, float, float)
        Dxx, Dyy, Dxy [grey levels].
    """
    lobe, border = size_px // 3, size_px // 2
    half = lobe // 2
    area = size_px * size_px
    dxx = _box(integral, v - lobe + 1, u - border, 2 * lobe - 1, size_px)
    dxx -= 3 * _box(integral, v - lobe + 1, u - half, 2 * lobe - 1, lobe)
    dyy = _box(integral, v - border, u - lobe + 1, size_px, 2 * lobe - 1)
    dyy -= 3 * _box(integral, v - half, u - lobe + 1, lobe, 2 * lobe - 1)
    dxy = _box(integral, v - lobe, u + 1, lobe, lobe) + _box(integral, v + 1, u - lobe, lobe, lobe)
    dxy -= _box(integral, v - lobe, u - lobe, lobe, lobe) + _box(integral, v + 1, u + 1, lobe, lobe)
    return dxx / area, dyy / area, dxy / area
