"""The kernel of a structured-light depth camera: from true ranges to disparities in steps, with holes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trailmark.arrays import Float32s
from trailmark.kernels import kernel
from trailmark_sim.hashing import hash2, normal_of
from trailmark_sim.render.rays import RayTable

__all__ = ["DepthErrors", "Echoes", "measure_depth"]


class DepthErrors(NamedTuple):
    """What a structured-light camera can measure, and how well.

    Attributes
    ----------
    focal_px, baseline_m : float
        Focal length of the depth camera, and how far the projector stands to its right [px, m].
    nearest_m, farthest_m : float
        Depths that are measured [m].
    grazing : float
        Cosine below which nothing comes back.
    shiny : float
        Shine from which on only square hits come back.
    dropout : float
        Share of pixels that are lost for no reason.
    noise_px, step_px : float
        Of the disparity: deviation, and what it is rounded to; 0 for none [px].
    """

    focal_px: float
    baseline_m: float
    nearest_m: float
    farthest_m: float
    grazing: float
    shiny: float
    dropout: float
    noise_px: float
    step_px: float


class Echoes(NamedTuple):
    """What each ray of a depth camera meets, T tiles of 64 rays.

    Attributes
    ----------
    ranges_m : float32 array
        (T, 64), true range [m].
    cosines : float32 array
        (T, 64), of the angle between the ray and the surface's normal.
    shine : float32 array
        (T, 64), share that is mirrored.
    """

    ranges_m: Float32s
    cosines: Float32s
    shine: Float32s


@kernel(error_model="numpy")
def measure_depth(
    first: int,
    last: int,
    table: RayTable,
    echoes: Echoes,
    lit_m: Float32s,
    errors: DepthErrors,
    seed: np.uint64,
    out: Float32s,
) -> None:
    """Measure the depth of some tiles.

    Parameters
    ----------
    first, last : int
        Tiles `first` to `last` (without it) are done.
    table : RayTable
        Of the depth camera.
    echoes : Echoes
        What its rays meet.
    lit_m : (H, W) float32
        Depth that the projector sees, on a picture like the camera's [m]; empty: it lights everything.
    errors : DepthErrors
        What it can measure, and how well.
    seed : uint64
        Of this picture.
    out : (H, W) float32
        Receives depth along the optical axis, NaN for holes [m].
    """
    pixels = table.pixels
    focal_m = errors.focal_px * errors.baseline_m
    _height, width = out.shape
    flat = out.ravel()
    for tile in range(first, last):
        for lane in range(pixels.shape[1]):
            pixel = pixels[tile, lane]
            if pixel < 0:
                continue
            flat[pixel] = np.nan
            depth = echoes.ranges_m[tile, lane] * table.rays[tile, 0, lane]
            cosine = echoes.cosines[tile, lane]
            if depth < errors.nearest_m or depth > errors.farthest_m or cosine < errors.grazing:
                continue
            if echoes.shine[tile, lane] >= errors.shiny and cosine < 0.97:
                continue
            v, u = pixel // width, pixel % width
            if lit_m.size > 0:
                # Where the projector would light this point, something nearer takes the light.
                w = int(np.floor(u - focal_m / depth + 0.5))
                if 0 <= w < width and lit_m[v, w] < depth * 0.985 - 0.01:
                    continue
            h = hash2(pixel, 1, seed)
            if np.float64(h & np.uint64(0xFFFFFF)) < errors.dropout * 16777216.0:
                continue
            disparity = focal_m / depth + errors.noise_px * normal_of(hash2(pixel, 2, seed))
            if errors.step_px > 0.0:
                disparity = np.floor(disparity / errors.step_px + 0.5) * errors.step_px
            if disparity > 0.0:
                flat[pixel] = focal_m / disparity
