"""Whether something moves beneath a content that stands still: ground, under a film, a sticker or a mesh on the lens.

What is sharp, fixed to the lens and seen through holds the match, and looks like ground at rest. But the difference of
two pictures has no part of it: at rest it is noise, and over ground that moved it is the ground less itself moved on.
Such a difference resembles its own negative, shifted as the ground was; noise resembles no shift of itself, and light
that changes is even. Most parts of the picture must say so: what passes through a corner is not the ground.
"""

from __future__ import annotations

import math
from collections import deque
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from scipy import fft

from trailmark.arrays import Float32s, Grey8
from trailmark_ground_vo.brightness import even_brightness
from trailmark_ground_vo.motion import ImageMotion

__all__ = ["LayerWatch"]

#: Pixels of the picture per cell that is compared, along each axis.
_CELL_PX = 2

#: Shifts that are looked for, and those that the grain of the texture itself explains [cells].
_MOST_CELLS, _LEAST_CELLS = 28, 2.0

#: Light that bends over more than so many cells is no texture.
_LIGHT_CELLS = 17

#: Differences are clipped at so many robust standard deviations: marks on the lens have no more say than the ground.
_CLIP_SIGMAS = 1.5

#: Least resemblance to the own negative, of the whole and of the median part; parts along each side of the picture. The
#: ground alone would say -0.5, noise says at most -0.07, lamps on mains -0.07 and -0.09 (on four floors, 320 x 240).
_LEAST_OF_ALL, _LEAST_OF_PARTS, _N_SIDE = 0.1, 0.05, 4

#: Least correlation of neighbouring cells to look further; that of noise is about none.
_LEAST_GRAIN = 0.03

#: Mean of a cell from which on pixels of it may be cut off [grey levels].
_WHITE = 235

#: Pictures back to which a slow motion is looked for, and without a finding before what stands still is believed again.
_MEMORY_FRAMES = 8

#: A content that moves farther does not stand still [px].
_STILL_PX = 0.3

#: Standard deviation over median absolute deviation of a normal distribution.
_SIGMA_OVER_MEDIAN = 1.4826


class _Still(NamedTuple):
    """A picture of a content that stands still, and how far the content has come since.

    Attributes
    ----------
    cells : (H / 2, W / 2) float32
        The picture in even light.
    motion : ImageMotion
        Of the content since then.
    """

    cells: Float32s
    motion: ImageMotion


class LayerWatch:
    """Watches contents that stand still.

    Parameters
    ----------
    size : (int, int)
        Width and height of the pictures [px].
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self._shape = (size[1] // _CELL_PX, size[0] // _CELL_PX)
        self._still: deque[_Still] = deque(maxlen=_MEMORY_FRAMES)
        self._n_doubtful = 0

    @property
    def is_doubtful(self) -> bool:
        """Whether something else was seen to move beneath this content, in this picture or a few before."""
        return self._n_doubtful > 0

    def is_moving(self, before: Grey8, now: Grey8, motion: ImageMotion) -> bool:
        """Return whether something else moves than what was found.

        Parameters
        ----------
        before, now : (H, W) uint8
            The pictures.
        motion : ImageMotion
            What was found between them.
        """
        if not _is_still(motion):
            self._still.clear()
            self._n_doubtful = 0
            return False
        if not self._still:
            self._still.append(_Still(self._cells(before), ImageMotion(0.0, 0.0, 0.0)))
        cells = self._cells(now)
        self._still = deque((_Still(then.cells, _after(then.motion, motion)) for then in self._still), _MEMORY_FRAMES)
        asked = [self._still[-1], self._still[0]] if len(self._still) > 1 else [self._still[-1]]
        is_found = any(_is_still(then.motion) and self._is_beneath(then, cells) for then in asked)
        self._still.append(_Still(cells, ImageMotion(0.0, 0.0, 0.0)))
        self._n_doubtful = _MEMORY_FRAMES if is_found else max(0, self._n_doubtful - 1)
        return is_found

    def _cells(self, image: Grey8) -> Float32s:
        """Return a picture in even light; NaN where it is cut off at white, which takes texture away as light grows."""
        size = self._shape[1], self._shape[0]
        even = cv2.resize(even_brightness(image), size, interpolation=cv2.INTER_AREA)
        is_cut_off = cv2.resize(image, size, interpolation=cv2.INTER_AREA) >= _WHITE
        return np.where(is_cut_off, np.float32(np.nan), even.astype(np.float32))

    def _is_beneath(self, then: _Still, now: Float32s) -> bool:
        """Return whether what differs is texture that has moved, be the content where it was found or where it was."""
        return all(self._has_moved(now, before) for before in (then.cells, self._moved_on(then)))

    def _moved_on(self, then: _Still) -> Float32s:
        """Return a picture after the motion of the content."""
        (height, width), motion = self._shape, then.motion
        cos, sin = math.cos(motion.turn_rad), math.sin(motion.turn_rad)
        middle_u, middle_v = (width - 1) / 2.0, (height - 1) / 2.0
        to_u = middle_u - cos * middle_u - sin * middle_v + motion.u / _CELL_PX
        to_v = middle_v + sin * middle_u - cos * middle_v + motion.v / _CELL_PX
        turned = np.array([[cos, sin, to_u], [-sin, cos, to_v]])
        return np.asarray(
            cv2.warpAffine(then.cells, turned, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT),
            np.float32,
        )

    def _has_moved(self, now: Float32s, before: Float32s) -> bool:
        """Return whether the difference of two pictures is texture less itself moved on."""
        difference = _texture(np.nan_to_num(now - before))
        if not _is_grainy(difference):
            return False  # noise, in a part of the time
        most = _CLIP_SIGMAS * _SIGMA_OVER_MEDIAN * float(np.median(np.abs(difference)))
        clipped = np.clip(difference, -most, most)
        (down, right), resemblance = self._least_resemblance(clipped)
        return resemblance < -_LEAST_OF_ALL and _of_parts(clipped, down, right) < -_LEAST_OF_PARTS

    def _least_resemblance(self, difference: Float32s) -> tuple[tuple[int, int], float]:
        """Return the shift (down, right), `down` not negative, with the least correlation, and that [cells], [1]."""
        window, of_window, is_asked = self._window
        surface = _correlation(difference * window)
        power = float(surface[0, 0]) / float(of_window[0, 0])
        surface = np.where(is_asked, surface / of_window, np.float32(np.inf))
        down, right = divmod(int(surface.argmin()), surface.shape[1])
        least = float(surface[down, right]) / max(power, 1e-9)
        return (down, right if right <= _MOST_CELLS else right - surface.shape[1]), least

    @cached_property
    def _window(self) -> tuple[Float32s, Float32s, Float32s]:
        """Window of the correlation, its own correlation, and which shifts are asked."""
        height, width = self._shape
        window = np.asarray(np.outer(np.hanning(height), np.hanning(width)), np.float32)
        own = _correlation(window)
        rows, columns = np.arange(own.shape[0])[:, None], np.arange(own.shape[1])[None, :]
        columns = np.minimum(columns, own.shape[1] - columns)
        is_asked = (rows <= _MOST_CELLS) & (columns <= _MOST_CELLS) & (np.hypot(rows, columns) >= _LEAST_CELLS)
        return window, np.maximum(own, 1e-3 * own[0, 0]), is_asked


def _texture(picture: Float32s) -> Float32s:
    """Return a picture less what is around each cell."""
    return np.asarray(picture - cv2.blur(picture, (_LIGHT_CELLS, _LIGHT_CELLS)), np.float32)


def _is_grainy(difference: Float32s) -> bool:
    """Return whether neighbours resemble each other, as those of noise do not."""
    products = float(np.mean(difference[:, 1:] * difference[:, :-1]) + np.mean(difference[1:] * difference[:-1]))
    return products > 2.0 * _LEAST_GRAIN * float(np.mean(difference * difference))


def _is_still(motion: ImageMotion) -> bool:
    return math.hypot(motion.u, motion.v) < _STILL_PX


def _after(first: ImageMotion, then: ImageMotion) -> ImageMotion:
    """Return the motion of both; the turns are those of a content that stands still."""
    return ImageMotion(first.u + then.u, first.v + then.v, first.turn_rad + then.turn_rad)


def _correlation(picture: Float32s) -> Float32s:
    """Return the correlation of a picture with itself by shift; shifts to the left wrap around."""
    shape = [fft.next_fast_len(side + _MOST_CELLS, real=True) for side in picture.shape]
    spectrum = fft.rfft2(picture, shape)
    return np.asarray(fft.irfft2(spectrum.real**2 + spectrum.imag**2, shape), np.float32)


def _of_parts(difference: Float32s, down: int, right: int) -> float:
    """Return the correlation of a picture with itself after a shift, the median of its parts."""
    height, width = difference.shape
    here = difference[down:, max(0, right) : width + min(0, right)]
    there = difference[: height - down, max(0, -right) : width - max(0, right)]
    rows, columns = here.shape[0] // _N_SIDE, here.shape[1] // _N_SIDE

    def sums(picture: Float32s) -> Float32s:
        parts = picture[: rows * _N_SIDE, : columns * _N_SIDE].reshape(_N_SIDE, rows, _N_SIDE, columns)
        return np.asarray(parts.sum(axis=(1, 3)))

    norms = np.sqrt(sums(here * here) * sums(there * there))
    return float(np.median(sums(here * there) / np.maximum(norms, 1e-9)))
