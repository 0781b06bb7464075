"""Whether the difference of two pictures is texture less itself moved on.

Such a difference resembles its own negative, shifted as the texture was; noise resembles no shift of itself, and light
that changes is even. Of texture that is faint beneath its noise one difference says too little: those of some pictures
in a row are asked together.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from scipy import fft

from trailmark.arrays import Bools, Float32s

__all__ = ["MovedTexture", "Shift", "correlation", "of_parts", "texture_of"]

#: Shifts that are looked for, and those that the grain of the texture itself explains [cells].
_MOST_CELLS, _LEAST_CELLS = 28, 2.0

#: Light that bends over more than so many cells is no texture.
_LIGHT_CELLS = 17

#: Variance of the means of rows over that of noise from which on rows are lit differently.
_LIT_ROWS = 3.0

#: Differences are clipped at so many robust standard deviations: marks on the lens have no more say than the ground.
_CLIP_SIGMAS = 1.5

#: Before, they are clipped at so many, and not below this: what flies through the picture dazzles no cells beside it
#: [grey levels]. One row and column in so many, another number than the blocks of compression have, tells how much.
_FOREIGN_SIGMAS, _LEAST_CLIP, _EVERY = 6.0, 4.0, 5

#: Least resemblance to the own negative, of one difference, and of many; what is kept of those before in each picture.
#: The ground alone would say -0.5, noise says at most -0.072, and of many -0.03, under lamps on mains as well (on four
#: floors, 320 x 240).
_LEAST_OF_ONE, _LEAST_OF_MANY, _KEPT = 0.1, 0.05, 0.75

#: Of the median part, of one and of many; parts along each side of the picture.
_LEAST_OF_PARTS, _LEAST_OF_PARTS_OF_MANY, _N_SIDE = 0.05, 0.03, 4

#: Least correlation of neighbouring cells to look further; that of noise is about none, under lamps on mains 0.032.
_LEAST_GRAIN = 0.04

#: Standard deviation over median absolute deviation of a normal distribution.
_SIGMA_OVER_MEDIAN = 1.4826

Shift = tuple[int, int]


def texture_of(picture: Float32s) -> Float32s:
    """Return a difference of two pictures less what is around each cell, and less what lamps on mains do to each row.

    Parameters
    ----------
    picture : (H, W) float32
        NaN counts as zero, and is changed so.
    """
    cv2.patchNaNs(picture, 0.0)
    most = max(_LEAST_CLIP, _FOREIGN_SIGMAS * _robust_sigma(picture[::_EVERY, ::_EVERY]))
    clipped = np.clip(picture, -most, most)
    clipped -= cv2.blur(clipped, (_LIGHT_CELLS, _LIGHT_CELLS))
    of_rows = clipped.mean(axis=1)
    if float(np.var(of_rows)) > _LIT_ROWS * float(np.vdot(clipped, clipped)) / clipped.shape[1] / clipped.size:
        clipped -= np.median(clipped, axis=1, keepdims=True)
    return np.asarray(clipped, np.float32)


def correlation(picture: Float32s, shape: tuple[int, int]) -> Float32s:
    """Return the sums of products of a picture with itself by shift; shifts up and to the left wrap around.

    Parameters
    ----------
    picture : (H, W) float32
        The picture.
    shape : (int, int)
        Its height and width, and the farthest shift more, at least.
    """
    spectrum = fft.rfft2(picture, shape)
    return np.asarray(fft.irfft2(spectrum.real**2 + spectrum.imag**2, shape), np.float32)


class MovedTexture:
    """Asks the differences of pictures in a row.

    Parameters
    ----------
    shape : (int, int)
        Height and width of the differences [cells].

    Attributes
    ----------
    is_asked : (H', W') bool
        Shifts that are looked for, as `correlation` has them.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        self._window = np.asarray(np.outer(*(np.hanning(side) for side in shape)), np.float32)
        height, width = (fft.next_fast_len(side + _MOST_CELLS, real=True) for side in shape)
        own = correlation(self._window, (height, width))
        self._of_window = np.maximum(own, 1e-3 * own[0, 0])
        rows, columns = np.arange(own.shape[0])[:, None], np.arange(own.shape[1])[None, :]
        columns = np.minimum(columns, own.shape[1] - columns)
        self.is_asked: Bools = np.asarray(
            (rows <= _MOST_CELLS) & (columns <= _MOST_CELLS) & (np.hypot(rows, columns) >= _LEAST_CELLS)
        )
        self._sum, self._n = np.zeros_like(own), 0.0

    def forget(self) -> None:
        """Begin another row of pictures."""
        self._sum[:], self._n = 0.0, 0.0

    def shift(self, difference: Float32s) -> Shift | None:
        """Return by how much the texture has moved, (down, right) [cells] but for the sign; None where none has.

        Parameters
        ----------
        difference : (H, W) float32
            Of `texture_of`, of the next picture.
        """
        if not _is_grainy(difference):
            self.forget()  # noise, in a part of the time
            return None
        clipped = _clipped(difference)
        surface = correlation(clipped * self._window, self.is_asked.shape)
        power = float(surface[0, 0]) / float(self._of_window[0, 0])
        surface /= max(power, 1e-9) * self._of_window
        self._sum, self._n = _KEPT * self._sum + surface, _KEPT * self._n + 1.0
        return self._found(clipped, surface, 1.0) or self._found(clipped, self._sum, self._n)

    def _found(self, clipped: Float32s, surface: Float32s, n: float) -> Shift | None:
        down, right = divmod(int(np.where(self.is_asked, surface, np.float32(np.inf)).argmin()), surface.shape[1])
        if float(surface[down, right]) / n >= -max(_LEAST_OF_MANY, _LEAST_OF_ONE / math.sqrt(n)):
            return None
        shift = down, right if right <= _MOST_CELLS else right - surface.shape[1]
        least = max(_LEAST_OF_PARTS_OF_MANY, _LEAST_OF_PARTS / math.sqrt(n))
        return shift if of_parts(clipped, shift) < -least else None


def of_parts(difference: Float32s, shift: Shift) -> float:
    """Return the correlation of a difference with itself after a shift, the median of its parts."""
    (height, width), (down, right) = difference.shape, shift
    here = difference[down:, max(0, right) : width + min(0, right)]
    there = difference[: height - down, max(0, -right) : width - max(0, right)]
    rows, columns = here.shape[0] // _N_SIDE, here.shape[1] // _N_SIDE

    def sums(picture: Float32s) -> Float32s:
        parts = picture[: rows * _N_SIDE, : columns * _N_SIDE].reshape(_N_SIDE, rows, _N_SIDE, columns)
        return np.asarray(parts.sum(axis=(1, 3)))

    norms = np.sqrt(sums(here * here) * sums(there * there))
    return float(np.median(sums(here * there) / np.maximum(norms, 1e-9)))


def _is_grainy(difference: Float32s) -> bool:
    """Return whether neighbours resemble each other, as those of noise do not."""
    flat = difference.ravel()
    products = float(flat[1:] @ flat[:-1]) + float(np.vdot(difference[1:], difference[:-1]))  # rows follow each other
    return products > 2.0 * _LEAST_GRAIN * float(flat @ flat)


def _clipped(difference: Float32s) -> Float32s:
    most = _CLIP_SIGMAS * _robust_sigma(difference)
    return np.clip(difference, -most, most)


def _robust_sigma(picture: Float32s) -> float:
    sizes = np.abs(picture).ravel()
    return _SIGMA_OVER_MEDIAN * float(np.partition(sizes, len(sizes) // 2)[len(sizes) // 2])
