"""Phase correlation of two cleaned pictures: a second estimate of the shift between them.

It looks at the whole picture at a quarter of the resolution, shares no pixel, no prediction and no memory with the
search, and costs a tenth of it. So it tells where to search when the prediction fails, and whether what the search
found can be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy import fft

from trailmark.arrays import Float32s, Grey8, Int64s
from trailmark_ground_vo.brightness import EVEN_LEVEL

__all__ = ["ShiftVote", "ShiftWitness", "Spectrum"]

#: Pixels of the picture per cell of the correlation, along each axis: two halvings.
CELL_PX = 4

#: Frequencies that count [1/cell]: slower ones are light, faster ones are noise; both ends fall off smoothly.
_SLOWEST, _FASTEST = 0.02, 0.22

#: Peaks nearer than this are one [cells].
_PEAK_CELLS = 3

#: A peak this much above any other one is clear.
_CLEAR = 1.6

#: Least peak, of that of two equal pictures.
_LEAST_PEAK = 0.04

Spectrum = npt.NDArray[np.complex64]


@dataclass(frozen=True, slots=True, eq=False)
class ShiftVote:
    """How well every shift fits.

    Attributes
    ----------
    u, v : float
        The shift that fits best [px].
    clarity : float
        Its peak over the highest one elsewhere.
    surface : (H, W) float32
        The correlation by shift, in cells of `CELL_PX`; negative shifts wrap around.
    """

    u: float
    v: float
    clarity: float
    surface: Float32s

    @property
    def is_clear(self) -> bool:
        """Whether one shift stands out."""
        return self.clarity >= _CLEAR

    def support(self, u: float, v: float) -> float:
        """Return how well a shift fits, relative to the best: 1 is as well, 0 not at all."""
        near = _around(self.surface, round(v / CELL_PX), round(u / CELL_PX), 1)
        return float(near.max()) / max(float(self.surface.max()), 1e-12)

    def peaks(self, n: int) -> list[tuple[float, float]]:
        """Return the shifts (u, v) of the n highest cells that are no neighbours, the highest first [px]."""
        rest, found = self.surface.copy(), []
        for _ in range(n):
            row, column = divmod(int(rest.argmax()), rest.shape[1])
            v, u = (CELL_PX * float(_signed_index(at, n_cells)) for at, n_cells in zip((row, column), rest.shape))
            found.append((u, v))
            _blank(rest, row, column, 1)
        return found


class ShiftWitness:
    """Compares pictures of one size.

    Parameters
    ----------
    size : (int, int)
        Width and height of the pictures [px].
    """

    def __init__(self, size: tuple[int, int]) -> None:
        width, height = size[0] // CELL_PX, size[1] // CELL_PX
        self._shape = (height, width)
        self._window = np.asarray(np.outer(np.hanning(height), np.hanning(width)), np.float32)
        slow, fast = np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None, :]
        squared = slow**2 + fast**2
        band = np.exp(-squared / _FASTEST**2) * -np.expm1(-squared / _SLOWEST**2)
        self._band = np.asarray(band, np.float32)
        self._perfect = float(fft.irfft2(self._band, self._shape)[0, 0])

    def spectrum(self, image: Grey8) -> Spectrum:
        """Return what is compared of a cleaned picture."""
        height, width = self._shape
        half = cv2.resize(image, (2 * width, 2 * height), interpolation=cv2.INTER_AREA)
        small = np.asarray(cv2.resize(half, (width, height), interpolation=cv2.INTER_AREA), np.float32)
        return np.asarray(fft.rfft2((small - EVEN_LEVEL) * self._window), np.complex64)

    def compare(self, before: Spectrum, now: Spectrum) -> ShiftVote:
        """Return how the content has moved from one picture to the other."""
        cross = now * before.conj()
        cross *= self._band / (np.abs(cross) + np.float32(1e-6))
        surface = np.asarray(fft.irfft2(cross, self._shape), np.float32)
        row, column = divmod(int(surface.argmax()), self._shape[1])
        best = float(surface[row, column])
        rest = surface.copy()
        _blank(rest, row, column, _PEAK_CELLS)
        second = float(rest.max())
        v, u = (_signed_index(at, n) + _vertex(self._shape, surface, row, column, axis)
                for axis, (at, n) in enumerate(zip((row, column), self._shape)))  # fmt: skip
        clarity = best / second if second > 0.0 else math.inf
        # pictures without anything to see, or without anything in common, have no peak worth the name
        return ShiftVote(CELL_PX * u, CELL_PX * v, clarity if best > _LEAST_PEAK * self._perfect else 0.0, surface)


def _signed_index(index: int, n: int) -> int:
    return index if index < (n + 1) // 2 else index - n


def _vertex(shape: tuple[int, int], surface: Float32s, row: int, column: int, axis: int) -> float:
    """Return where the parabola through a peak and its neighbours along an axis has its top, from -0.5 to 0.5."""
    step = (1, 0) if axis == 0 else (0, 1)
    before = float(surface[(row - step[0]) % shape[0], (column - step[1]) % shape[1]])
    after = float(surface[(row + step[0]) % shape[0], (column + step[1]) % shape[1]])
    bend = before + after - 2.0 * float(surface[row, column])
    return 0.5 * (before - after) / bend if bend < 0.0 else 0.0


def _around(surface: Float32s, row: int, column: int, reach: int) -> Float32s:
    return surface[_cells_around(surface, row, column, reach)]


def _blank(surface: Float32s, row: int, column: int, reach: int) -> None:
    surface[_cells_around(surface, row, column, reach)] = 0.0


def _cells_around(surface: Float32s, row: int, column: int, reach: int) -> tuple[Int64s, ...]:
    """Return the index of a cell and of its neighbours, which wrap around at the ends."""
    rows = np.arange(row - reach, row + reach + 1) % surface.shape[0]
    columns = np.arange(column - reach, column + reach + 1) % surface.shape[1]
    return np.ix_(rows, columns)
