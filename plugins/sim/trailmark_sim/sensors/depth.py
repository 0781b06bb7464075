"""The kernel of a structured-light depth camera: from true ranges to disparities in steps, with holes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.kernels import kernel
from trailmark_sim.hashing import hash2, normal_of

__all__ = ["measure_depth"]


@kernel(error_model="numpy")
def measure_depth(
    first: int,
    last: int,
    rays: npt.NDArray[Any],
    pixels: npt.NDArray[Any],
    ranges: npt.NDArray[Any],
    cosines: npt.NDArray[Any],
    shine: npt.NDArray[Any],
    lit_m: npt.NDArray[Any],
    lens: tuple[float, float, float, float],
    baseline_m: float,
    limits: tuple[float, float],
    holes: tuple[float, float, float],
    noise: tuple[float, float],
    seed: np.uint64,
    out: npt.NDArray[Any],
) -> None:
    """Measure the depth of some tiles.

    Parameters
    ----------
    first, last : int
        Tiles `first` to `last` (without it) are done.
    rays, pixels
        Of the depth camera's `RayTable`.
    ranges, cosines, shine : (T, 64) float32
        True range, steepness and shine of what each ray meets [m, 1, 1].
    lit_m : (H, W) float32
        Depth that the projector sees, on a picture like the camera's [m]; empty: it lights everything.
    lens : (focal_u, focal_v, cu, cv)
        Of the depth camera [px].
    baseline_m : float
        How far the projector stands to the right [m].
    limits : (float, float)
        Depths that are measured [m].
    holes : (grazing, shiny, dropout)
        Cosine below which nothing comes back; shine from which on only square hits do; share lost for no reason.
    noise : (sigma, step)
        Of the disparity: deviation, and what it is rounded to; 0 for none [px].
    seed : uint64
        Of this picture.
    out : (H, W) float32
        Receives depth along the optical axis, NaN for holes [m].
    """
    _height, width = out.shape
    flat = out.ravel()
    for tile in range(first, last):
        for lane in range(pixels.shape[1]):
            pixel = pixels[tile, lane]
            if pixel < 0:
                continue
            flat[pixel] = np.nan
            depth = ranges[tile, lane] * rays[tile, 0, lane]
            cosine = cosines[tile, lane]
            if depth < limits[0] or depth > limits[1] or cosine < holes[0]:
                continue
            if shine[tile, lane] >= holes[1] and cosine < 0.97:
                continue
            v, u = pixel // width, pixel % width
            if lit_m.size > 0:
                # Where the projector would light this point, something nearer takes the light.
                w = int(np.floor(u - lens[0] * baseline_m / depth + 0.5))
                if 0 <= w < width and lit_m[v, w] < depth * 0.985 - 0.01:
                    continue
            h = hash2(pixel, 1, seed)
            if np.float64(h & np.uint64(0xFFFFFF)) < holes[2] * 16777216.0:
                continue
            disparity = lens[0] * baseline_m / depth + noise[0] * normal_of(hash2(pixel, 2, seed))
            if noise[1] > 0.0:
                disparity = np.floor(disparity / noise[1] + 0.5) * noise[1]
            if disparity > 0.0:
                flat[pixel] = lens[0] * baseline_m / disparity
