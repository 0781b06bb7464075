"""Photographs as floors: endless, never twice the same, and still the photograph's look.

A triangle grid lies over the floor. Each of its corners shows its own piece of the photograph around itself, and
every place blends the pieces of its three corners so that contrast and histogram stay those of the photograph
(Heitz & Neyret, High-Performance By-Example Noise using a Histogram-Preserving Blending Operator, 2018).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from trailmark.arrays import AnyArray, Float32s, Floats, Grey8
from trailmark.errors import ConfigError
from trailmark.kernels import kernel
from trailmark_sim.hashing import hash2, mix_bits, unit_of
from trailmark_sim.interpolation import between
from trailmark_sim.pictures import read_grey
from trailmark_sim.rng import stream_key

__all__ = ["Photo", "load_photo"]

#: Metres of floor per pixel of a photograph whose width is not given: one camera pixel of the paper's rig.
PHOTO_PITCH_M = 0.200 / 512
#: Side of the triangles, in shorter sides of the photograph.
_TRIANGLE_SHARE = 0.3
#: Grey of Gaussian values -4 .. 4, in this many steps.
_N_GREYS = 2048
_SPAN = 4.0
_SMALLEST_PX = 64
_MOST_TEXELS = 200_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Photo:
    """A photograph, ready to be painted from.

    Attributes
    ----------
    grey : (H, W) uint8
        The picture.
    normals : (256,) float32
        Value of a normal distribution for every grey, by its rank in the picture.
    greys : (N,) float32
        Grey of a normal value: its inverse.
    pitch_m : float
        Size of one of its pixels on the floor [m].
    """

    grey: Grey8
    normals: Float32s
    greys: Float32s
    pitch_m: float

    def paint(self, x: Floats, y: Floats, seed: int) -> Float32s:
        """Return the greys at places (N, N), in the floor's own axes [m]."""
        out = np.empty(x.shape, dtype=np.float32)
        side_m = _TRIANGLE_SHARE * min(self.grey.shape) * self.pitch_m
        key = np.uint64(stream_key(seed, "photo"))
        _paint_pieces(out, x, y, self.grey, self.normals, self.greys, side_m, self.pitch_m, key)
        return out


def load_photo(path: Path, width_m: float | None, texel_m: float) -> Photo:
    """Read a photograph and prepare it.

    Parameters
    ----------
    path : Path
        Any picture that OpenCV reads.
    width_m : float or None
        Width of the floor that it shows [m]; None: one pixel is one of the paper's camera.
    texel_m : float
        Texels that will be painted [m]; a finer photograph is reduced to them first.

    Raises
    ------
    ConfigError
        If it cannot be read, or is too small.
    """
    grey = read_grey(path)
    pitch_m = PHOTO_PITCH_M if width_m is None else width_m / grey.shape[1]
    size = [max(1, round(n * pitch_m / texel_m)) for n in (grey.shape[1], grey.shape[0])]
    _refuse_too_large(path, size)
    # One pixel a texel: read at whole pixels, the pieces lose no sharpness. One per cent is not worth a loss either.
    if abs(size[0] / grey.shape[1] - 1.0) > 0.01:
        filtering = cv2.INTER_AREA if size[0] < grey.shape[1] else cv2.INTER_CUBIC
        grey = np.asarray(cv2.resize(grey, size, interpolation=filtering), dtype=np.uint8)
    if min(grey.shape) < _SMALLEST_PX:
        raise ConfigError(
            f"sim: the photograph {str(path)!r} covers {grey.shape[1]} x {grey.shape[0]} texels of"
            f" {texel_m * 1e3:.2f} mm; at least {_SMALLEST_PX} x {_SMALLEST_PX} are needed (is its width right?)"
        )
    return Photo(grey, *_by_rank(grey), texel_m)


def _refuse_too_large(path: Path, size: list[int]) -> None:
    if size[0] * size[1] > _MOST_TEXELS:
        raise ConfigError(
            f"sim: the photograph {str(path)!r} covers {size[0]} x {size[1]} texels of the floor, more than"
            f" {_MOST_TEXELS // 10**6} million; make it smaller, or is its width wrong?"
        )


def _by_rank(grey: Grey8) -> tuple[Float32s, Float32s]:
    """Return the normal value of every grey by its rank, and the table that leads back."""
    from scipy.special import ndtri  # here: few floors are photographs

    counts = np.bincount(grey.ravel(), minlength=256)
    ranks = (np.cumsum(counts) - counts / 2.0) / grey.size
    present = np.flatnonzero(counts)
    normals = np.zeros(256)
    normals[present] = ndtri(ranks[present])
    steps = np.linspace(-_SPAN, _SPAN, _N_GREYS)
    greys = np.interp(steps, normals[present], present.astype(np.float64))
    return normals.astype(np.float32), greys.astype(np.float32)


@kernel
def _paint_pieces(
    out: AnyArray,
    x: AnyArray,
    y: AnyArray,
    grey: AnyArray,
    normals: AnyArray,
    greys: AnyArray,
    side_m: float,
    pitch_m: float,
    seed: np.uint64,
) -> None:
    root3, reach = math.sqrt(3.0), side_m / pitch_m
    scale = (greys.shape[0] - 1) / (2.0 * _SPAN)
    for row in range(out.shape[0]):
        for col in range(out.shape[1]):
            px, py = x[row, col], y[row, col]
            a, b = (px - py / root3) / side_m, 2.0 * py / root3 / side_m
            i, j = math.floor(a), math.floor(b)
            fa, fb = a - i, b - j
            upper = 1 if fa + fb > 1.0 else 0
            total = squares = 0.0
            for n in range(3):  # corners of the triangle that the place lies in
                if n == 0:
                    ci, cj = i + upper, j + upper
                    weight = abs(1.0 - fa - fb)
                elif n == 1:
                    ci, cj = i + 1, j
                    weight = 1.0 - fb if upper else fa
                else:
                    ci, cj = i, j + 1
                    weight = 1.0 - fa if upper else fb
                weight = (weight * weight * weight) ** 2  # sixth power: narrow seams, large pieces
                if weight < 1e-4:
                    continue
                corner_u, corner_v = side_m * (ci + 0.5 * cj) / pitch_m, side_m * cj * root3 / 2.0 / pitch_m
                h = hash2(ci, cj, seed)
                u = px / pitch_m + _piece_offset(grey.shape[1], reach, corner_u, h)
                v = py / pitch_m + _piece_offset(grey.shape[0], reach, corner_v, mix_bits(h))
                total += weight * _bilinear(grey, normals, u, v)
                squares += weight * weight
            value = (total / math.sqrt(squares) + _SPAN) * scale
            value = min(max(value, 0.0), greys.shape[0] - 1.001)
            k = int(value)
            out[row, col] = greys[k] + (greys[k + 1] - greys[k]) * (value - k)


@kernel
def _piece_offset(size: int, reach: float, corner: float, h: np.uint64) -> float:
    """Return by how many whole pixels a corner's piece is moved, so that all of it lies in the photograph."""
    place = reach + 2.0 + (size - 5.0 - 2.0 * reach) * unit_of(h)
    return float(math.floor(place - corner))


@kernel
def _bilinear(grey: AnyArray, normals: AnyArray, u: float, v: float) -> float:
    i, j = int(u), int(v)
    fu, fv = u - i, v - j
    a, b = normals[grey[j, i]], normals[grey[j, i + 1]]
    c, d = normals[grey[j + 1, i]], normals[grey[j + 1, i + 1]]
    return float(between(a, b, c, d, fu, fv))
