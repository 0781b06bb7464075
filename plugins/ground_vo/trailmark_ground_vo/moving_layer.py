"""Whether something moves beneath or beside a content that stands still: ground, past a film, a sticker or a mesh.

What is sharp and fixed to the lens holds the match, be it seen through or cover most of the picture, and looks like
ground at rest. But the difference of two pictures has no part of it: at rest it is noise, and over ground that moved
it is the ground less itself moved on. Ground seen through a film says so in most parts of the picture, ground beside a
sticker in some.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import cv2
import numpy as np

from trailmark.arrays import Float32s, Grey8
from trailmark_ground_vo.brightness import even_brightness
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.moved_texture import MovedTexture, of_parts, texture_of
from trailmark_ground_vo.moving_parts import moving_parts

__all__ = ["LayerWatch"]

#: Pixels of the picture per cell that is compared, along each axis.
_CELL_PX = 2

#: Mean of a cell from which on pixels of it may be cut off [grey levels].
_WHITE = 235

#: Pictures back to which a slow motion is looked for, and without a finding before what stands still is believed again.
_MEMORY_FRAMES = 8

#: A content that moves farther does not stand still [px]; one that moves farther than the second is not asked as a
#: whole: what is left of it when it is moved on looks as if it had moved.
_STILL_PX, _STANDS_PX = 1.0, 0.3

#: Share of the resemblance that is left after a content is moved on which has not moved itself.
_LEFT = 0.5


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
        self._since_last, self._since_first = MovedTexture(self._shape), MovedTexture(self._shape)
        self._n_doubtful = 0

    @property
    def is_doubtful(self) -> bool:
        """Whether something else was seen to move, in this picture or a few before."""
        return self._n_doubtful > 0

    def is_moving(self, before: Grey8, now: Grey8, motion: ImageMotion, *, others_rest: bool = False) -> bool:
        """Return whether something else moves than what was found.

        Parameters
        ----------
        before, now : (H, W) uint8
            The pictures.
        motion : ImageMotion
            What was found between them.
        others_rest : bool
            Whether others say that the robot stands: what moves in parts of the picture passes by.
        """
        if _size_px(motion) >= _STILL_PX:
            self._forget()
            return False
        if not self._still:
            self._still.append(_Still(self._cells(before), ImageMotion(0.0, 0.0, 0.0)))
        cells = self._cells(now)
        self._still = deque((_Still(then.cells, _after(then.motion, motion)) for then in self._still), _MEMORY_FRAMES)
        is_found = self._is_beneath(self._still[-1], cells, self._since_last, asks_parts=not others_rest)
        if not is_found and len(self._still) > 1 and _size_px(self._still[0].motion) < _STILL_PX:
            is_found = self._is_beneath(self._still[0], cells, self._since_first, asks_parts=not others_rest)
        self._still.append(_Still(cells, ImageMotion(0.0, 0.0, 0.0)))
        self._n_doubtful = _MEMORY_FRAMES if is_found else max(0, self._n_doubtful - 1)
        return is_found

    def _forget(self) -> None:
        self._still.clear()
        self._since_last.forget()
        self._since_first.forget()
        self._n_doubtful = 0

    def _cells(self, image: Grey8) -> Float32s:
        """Return a picture in even light; NaN where it is cut off at white, which takes texture away as light grows."""
        size = self._shape[1], self._shape[0]
        small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
        return np.where(small >= _WHITE, np.float32(np.nan), even_brightness(small).astype(np.float32))

    def _is_beneath(self, then: _Still, now: Float32s, whole: MovedTexture, *, asks_parts: bool) -> bool:
        """Return whether what differs is texture that has moved, be the content where it was found or where it was."""
        difference = texture_of(now - then.cells)
        in_parts = asks_parts and self._has_moved_in_parts(difference)
        shift = whole.shift(difference) if _size_px(then.motion) < _STANDS_PX else None
        if not in_parts and shift is None:
            return False
        left = texture_of(now - self._moved_on(then))
        if shift is not None and of_parts(left, shift) < _LEFT * of_parts(difference, shift):
            return True
        return in_parts and self._has_moved_in_parts(left)

    def _has_moved_in_parts(self, difference: Float32s) -> bool:
        parts = moving_parts(difference, self._since_last.is_asked)
        return parts.has_moved or (parts.changes and self.is_doubtful)

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


def _size_px(motion: ImageMotion) -> float:
    return math.hypot(motion.u, motion.v)


def _after(first: ImageMotion, then: ImageMotion) -> ImageMotion:
    """Return the motion of both; the turns are those of a content that stands still."""
    return ImageMotion(first.u + then.u, first.v + then.v, first.turn_rad + then.turn_rad)
