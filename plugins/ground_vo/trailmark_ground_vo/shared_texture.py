"""Whether two pictures share texture where a motion says so: ground that moved, and no light, noise or cover.

A motion can be found between pictures of nothing: noise has a best match too, and so have two over-exposed pictures.
Each pixel of a regular grid, less the mean of four around it, is correlated with what the motion brings there. Light,
vignettes and covers out of focus hardly bend over so few pixels, what is cut off at white has no texture, and noise is
another in every picture. Sixteen parts of the picture are asked separately.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Bools, Floats, Grey16
from trailmark.kernels import float_kernel
from trailmark_ground_vo.filters import SMOOTH_SCALE
from trailmark_ground_vo.motion import ImageMotion

__all__ = ["SharedTexture", "TextureComparison"]

#: Parts of the picture along each side, and pixels that a part needs.
_N_SIDE, _LEAST_PIXELS = 4, 20

#: Distance of the grid's pixels, at first and where that does not tell [px].
_STEPS_PX = (10, 4)

#: Distance of the four pixels around each; the near ones tell what is in focus [px].
_REACH_PX, _NEAR_PX = 8, 3

#: Texture is cut off here, so that single marks have no more say than the ground [grey levels].
_MOST_LEVELS = 12.0

#: Standard errors of a correlation that are no chance: of all, and the median of the parts. Right motions on five
#: floors under eight conditions said 12 and more, the parts 2.5; wrong ones between over-exposed pictures 5 and 0.
_LEAST_SIGMAS, _LEAST_PART_SIGMAS = 6.0, 1.0

#: Standard errors with which the wide grid is enough.
_PLENTY_SIGMAS = 12.0

#: Standard deviation of texture that is shared [grey levels]: what evens the light out has steps, which stand still.
_LEAST_LEVELS = 0.6

#: Texture among near pixels over that among farther ones, of ground in focus: blobs wider than 6 px have less; and its
#: standard errors.
_LEAST_SHARPNESS, _LEAST_SHARP_SIGMAS = 0.2, 4.0


@dataclass(frozen=True, slots=True)
class SharedTexture:
    """The texture that two pictures share after a motion.

    Attributes
    ----------
    sigmas : float
        Correlation over its standard error if there were none.
    part_sigmas : float
        The same, median of the parts of the picture.
    levels : float
        Standard deviation of the texture that both have [grey levels].
    """

    sigmas: float
    part_sigmas: float
    levels: float

    @property
    def is_there(self) -> bool:
        """Whether both pictures, and most of their parts, show the same thing."""
        is_chance = self.sigmas < _LEAST_SIGMAS or self.part_sigmas < _LEAST_PART_SIGMAS
        return not is_chance and self.levels >= _LEAST_LEVELS


class TextureComparison:
    """Compares pictures of one size.

    Parameters
    ----------
    size : (int, int)
        Width and height of the pictures [px].
    aspect : float
        Metres per pixel along v over those along u.
    """

    def __init__(self, size: tuple[int, int], aspect: float) -> None:
        self._aspect = aspect
        self._closed = np.zeros((size[1], size[0]), np.bool_)

    def ignore(self, closed: Bools | None) -> None:
        """Compare no pixel where something is fixed to the lens, (H, W) bool; None: compare all."""
        self._closed = np.zeros_like(self._closed) if closed is None else closed

    def compare(self, before: Grey16, now: Grey16, motion: ImageMotion) -> SharedTexture:
        """Return the texture that two smoothed pictures (see `filters.smooth`) share after a motion of the content."""
        shared = SharedTexture(0.0, 0.0, 0.0)
        for step_px in _STEPS_PX:
            shared = self._at(before, now, motion, (step_px, _REACH_PX))
            if shared.sigmas >= _PLENTY_SIGMAS and shared.part_sigmas >= _LEAST_PART_SIGMAS:
                break
        return shared

    def is_in_focus(self, before: Grey16, now: Grey16, motion: ImageMotion) -> bool:
        """Return whether the texture that they share is as fine as that of ground is, and of a lens cap is not."""
        far = self._at(before, now, motion, (_STEPS_PX[-1], _REACH_PX))
        if not far.is_there:
            return False
        near = self._at(before, now, motion, (_STEPS_PX[-1], _NEAR_PX))
        return near.sigmas >= _LEAST_SHARP_SIGMAS and near.levels >= _LEAST_SHARPNESS * far.levels

    def _at(self, before: Grey16, now: Grey16, motion: ImageMotion, grid: tuple[int, int]) -> SharedTexture:
        moved = (motion.u, motion.v, motion.turn_rad)
        sums = _sums_of_parts(before, now, self._closed, moved, self._aspect, grid)
        sums = sums[sums[:, 0] >= _LEAST_PIXELS]
        n = sums[:, 0]
        total = float(n.sum())
        if total == 0.0:
            return SharedTexture(0.0, 0.0, 0.0)
        variances = np.maximum(sums[:, 3:5] - sums[:, 1:3] ** 2 / n[:, None], 1.0)
        products = sums[:, 5] - sums[:, 1] * sums[:, 2] / n  # a vignette bends the same way all over a part
        correlation = products / np.sqrt(variances[:, 0] * variances[:, 1])
        levels = math.sqrt(max(0.0, float(products.sum()) / total)) / SMOOTH_SCALE
        parts = float(np.median(correlation * np.sqrt(n)))
        return SharedTexture(float(correlation @ n) / math.sqrt(total), parts, levels)


@float_kernel
def _sums_of_parts(
    before: Grey16,
    now: Grey16,
    closed: Bools,
    motion: tuple[float, float, float],
    aspect: float,
    grid: tuple[int, int],
) -> Floats:
    """Return how many pixels each part has, and the sums of both textures, of their squares and product, (16, 6)."""
    height, width = before.shape
    step, reach = grid
    cos = np.float32(math.cos(motion[2]))
    across, down = np.float32(math.sin(motion[2]) * aspect), np.float32(math.sin(motion[2]) / aspect)
    from_x, from_y, half = np.float32((width - 1) / 2.0), np.float32((height - 1) / 2.0), np.float32(0.5)
    to_x, to_y = from_x + np.float32(motion[0]) + half, from_y + np.float32(motion[1]) + half
    most, four = np.int32(4 * _MOST_LEVELS * SMOOTH_SCALE), np.float32(0.25)
    out = np.zeros((_N_SIDE * _N_SIDE, 6), np.float64)
    for v in range(reach, height - reach, step):
        for u in range(reach, width - reach, step):
            dx, dy = np.float32(u) - from_x, np.float32(v) - from_y
            i, j = math.floor(cos * dx + across * dy + to_x), math.floor(cos * dy - down * dx + to_y)
            if i < reach or j < reach or i >= width - reach or j >= height - reach or closed[v, u] or closed[j, i]:
                continue
            around = np.int32(before[v, u - reach]) + np.int32(before[v, u + reach])
            around += np.int32(before[v - reach, u]) + np.int32(before[v + reach, u])
            a = four * np.float32(min(max(np.int32(4) * np.int32(before[v, u]) - around, -most), most))
            around = np.int32(now[j, i - reach]) + np.int32(now[j, i + reach])
            around += np.int32(now[j - reach, i]) + np.int32(now[j + reach, i])
            b = four * np.float32(min(max(np.int32(4) * np.int32(now[j, i]) - around, -most), most))
            part = v * _N_SIDE // height * _N_SIDE + u * _N_SIDE // width
            out[part, 0] += 1.0
            out[part, 1] += a
            out[part, 2] += b
            out[part, 3] += a * a
            out[part, 4] += b * b
            out[part, 5] += a * b
    return out
