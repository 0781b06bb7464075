"""Photographs as floors: endless, never twice the same, and still the photograph's look.

A triangle grid lies over the floor. Each of its corners shows its own piece of the photograph around itself, and
every place blends the pieces of its three corners so that contrast and histogram stay those of the photograph
(Heitz & Neyret, High-Performance By-Example Noise using a Histogram-Preserving Blending Operator, 2018).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.special import ndtri

from trailmark.errors import ConfigError
from trailmark_sim.hashing import hash2, mixed, unit_of
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


@dataclass(frozen=True, slots=True, eq=False)
class Photo:
    """A photograph, ready to be painted from.

    Attributes
    ----------
    normal : (H, W) float32
        Greys by their rank, as values of a normal distribution.
    greys : (N,) float32
        Grey of a normal value: its inverse.
    pitch_m : float
        Size of one of its pixels on the floor [m].
    """

    normal: npt.NDArray[np.float32]
    greys: npt.NDArray[np.float32]
    pitch_m: float

    def paint(self, x: npt.NDArray[np.float64], y: npt.NDArray[np.float64], seed: int) -> npt.NDArray[np.float32]:
        """Return the greys at places (N, N), in the floor's own axes [m]."""
        out = np.empty(x.shape, dtype=np.float32)
        side_m = _TRIANGLE_SHARE * min(self.normal.shape) * self.pitch_m
        key = np.uint64(stream_key(seed, "photo"))
        _paint_pieces(out, x, y, self.normal, self.greys, side_m, self.pitch_m, key)
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
    data = np.fromfile(path, dtype=np.uint8) if path.is_file() else None
    if data is None:
        raise ConfigError(f"sim: the photograph {str(path)!r} of a floor is not there")
    grey = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if data.size else None
    if grey is None:
        raise ConfigError(f"sim: {str(path)!r} is not a picture that OpenCV can read")
    pitch_m = PHOTO_PITCH_M if width_m is None else width_m / grey.shape[1]
    if texel_m > 1.2 * pitch_m:
        size = [max(1, round(n * pitch_m / texel_m)) for n in (grey.shape[1], grey.shape[0])]
        pitch_m *= grey.shape[1] / size[0]
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    if min(grey.shape) < _SMALLEST_PX:
        raise ConfigError(
            f"sim: the photograph {str(path)!r} covers {grey.shape[1]} x {grey.shape[0]} texels of"
            f" {texel_m * 1e3:.2f} mm; at least {_SMALLEST_PX} x {_SMALLEST_PX} are needed (is its width right?)"
        )
    return Photo(*_by_rank(np.asarray(grey, dtype=np.uint8)), pitch_m)


def _by_rank(grey: npt.NDArray[np.uint8]) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Return the picture as normal values by rank, and the table that leads back."""
    counts = np.bincount(grey.ravel(), minlength=256)
    ranks = (np.cumsum(counts) - counts / 2.0) / grey.size
    present = np.flatnonzero(counts)
    normal_of_grey = np.zeros(256)
    normal_of_grey[present] = ndtri(ranks[present])
    steps = np.linspace(-_SPAN, _SPAN, _N_GREYS)
    greys = np.interp(steps, normal_of_grey[present], present.astype(np.float64))
    return normal_of_grey[grey].astype(np.float32), greys.astype(np.float32)


@njit(cache=True, nogil=True)
def _paint_pieces(
    out: npt.NDArray[Any],
    x: npt.NDArray[Any],
    y: npt.NDArray[Any],
    normal: npt.NDArray[Any],
    greys: npt.NDArray[Any],
    side_m: float,
    pitch_m: float,
    seed: np.uint64,
) -> None:
    root3 = math.sqrt(3.0)
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
                du, dv = (px - side_m * (ci + 0.5 * cj)) / pitch_m, (py - side_m * cj * root3 / 2.0) / pitch_m
                total += weight * _piece(normal, du, dv, side_m / pitch_m, hash2(ci, cj, seed))
                squares += weight * weight
            value = (total / math.sqrt(squares) + _SPAN) * scale
            value = min(max(value, 0.0), greys.shape[0] - 1.001)
            k = int(value)
            out[row, col] = greys[k] + (greys[k + 1] - greys[k]) * (value - k)


@njit(cache=True, nogil=True)
def _piece(normal: npt.NDArray[Any], du: float, dv: float, reach: float, h: np.uint64) -> float:
    """Return the photograph at an offset from a corner's own place in it, bilinear [px]."""
    height, width = normal.shape
    u = reach + 1.0 + (width - 3.0 - 2.0 * reach) * unit_of(h) + du
    v = reach + 1.0 + (height - 3.0 - 2.0 * reach) * unit_of(mixed(h)) + dv
    i, j = int(u), int(v)
    fu, fv = u - i, v - j
    above = normal[j, i] + (normal[j, i + 1] - normal[j, i]) * fu
    below = normal[j + 1, i] + (normal[j + 1, i + 1] - normal[j + 1, i]) * fu
    return float(above + (below - above) * fv)
