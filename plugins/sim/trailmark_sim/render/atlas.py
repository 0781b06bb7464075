"""Textures in one flat array, each with its mip-map: every level half as large as the one before."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trailmark.arrays import AnyArray, Bytes, Float32s, Int32s
from trailmark.errors import ShapeError

__all__ = ["TEXTURE_SIZE", "Atlas", "build_atlas", "join_atlases"]

_MOST_LEVELS = 12
#: Width and height (powers of two) and number of levels of a texture.
TEXTURE_SIZE = np.dtype([(name, np.int32) for name in ("width", "height", "n_levels")])


class Atlas(NamedTuple):
    """All n textures of a scene; kernels take it whole.

    Attributes
    ----------
    texels : (N,) int32
        Red, green and blue in the lowest three bytes. Reflectance is the square of a byte over 255.
    starts : (n, 12) int32
        Where each level of each texture begins.
    sizes : (n,) TEXTURE_SIZE
        Size of each texture.
    """

    texels: Int32s
    starts: Int32s
    sizes: AnyArray


def build_atlas(images: Sequence[Bytes]) -> Atlas:
    """Return the atlas of RGB pictures (H, W, 3), whose sides are powers of two.

    Raises
    ------
    ShapeError
        If a side is not.
    """
    pieces, starts, sizes = [], np.zeros((len(images), _MOST_LEVELS), np.int32), np.zeros(len(images), TEXTURE_SIZE)
    at = 0
    for number, image in enumerate(images):
        levels = _levels(image)
        sizes[number] = image.shape[1], image.shape[0], len(levels)
        for level, small in enumerate(levels):
            starts[number, level] = at
            pieces.append(small)
            at += small.size
    return Atlas(np.concatenate(pieces), starts, sizes)


def join_atlases(first: Atlas, second: Atlas) -> Atlas:
    """Return the atlas of all textures of both; those of the second come last."""
    return Atlas(
        np.concatenate([first.texels, second.texels]),
        np.concatenate([first.starts, second.starts + np.int32(len(first.texels))]),
        np.concatenate([first.sizes, second.sizes]),
    )


def _levels(image: Bytes) -> list[Int32s]:
    height, width = image.shape[:2]
    if image.dtype != np.uint8 or image.shape[2:] != (3,) or height & (height - 1) or width & (width - 1):
        raise ShapeError(f"a texture is (H, W, 3) uint8 with powers of two as sides, not {image.shape} {image.dtype}")
    # Light adds up, not its root: the means are taken of squares.
    linear = np.square(image.astype(np.float32))
    levels = [_pack_colours(image)]
    while max(linear.shape[:2]) > 1 and len(levels) < _MOST_LEVELS:
        linear = _halve(linear)
        levels.append(_pack_colours(np.round(np.sqrt(linear)).astype(np.uint8)))
    return levels


def _halve(linear: Float32s) -> Float32s:
    if linear.shape[0] > 1:
        linear = (linear[0::2] + linear[1::2]) * np.float32(0.5)
    if linear.shape[1] > 1:
        linear = (linear[:, 0::2] + linear[:, 1::2]) * np.float32(0.5)
    return linear


def _pack_colours(image: Bytes) -> Int32s:
    wide = image.astype(np.int32)
    return np.ravel(wide[..., 0] | wide[..., 1] << 8 | wide[..., 2] << 16)
