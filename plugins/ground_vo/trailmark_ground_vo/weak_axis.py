"""How far a motion may be off along the direction that the ground holds least: along a grain, along grooves.

The curvature at the minimum tells how well a motion is known if the minimum is the right one. Along a grain the match
hardly changes with the shift, so whatever ends, crosses or stands still there (a mark on the lens, a shadow, a knot)
makes a minimum of its own, narrow and wrong. So the match is followed along its weak axis, over pixels that had no
part in finding it. Sixteen parts of the picture are the samples of a paired test: a motion that is not worse than what
was found, by two standard errors of the parts' mean difference, may be the right one, and the covariance spans it.
"""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Bools, Float32s, Floats, Grey16, Int64s
from trailmark.kernels import float_kernel
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.regular_grid import N_SIDE, regular_grid

__all__ = ["WeakAxis", "mean_square_within"]

#: Axes that are followed, the weakest first.
_N_AXES = 1

#: Shifts along the axis that are tried, to either side [px]; so many in a row that are worse end the search.
_SHIFTS_PX = (0.5, 1.0, 2.0, 3.0, 4.5, 6.5, 9.0, 12.0, 16.0, 20.0, 24.0, 28.0)
_N_WORSE = 3

#: Standard errors by which a motion must be worse to be excluded, one-sided.
_STANDARD_ERRORS = 2.0

#: Pixels that a part needs in both motions, and parts that the test needs.
_LEAST_PIXELS, _LEAST_PARTS = 20, 4

#: Differences are clipped at so many times their mean: what differs more is something else.
_CLIP_MEANS = 4.0


class WeakAxis:
    """Follows the match of two pictures along its weak axis.

    Parameters
    ----------
    size : (int, int)
        Width and height of the pictures [px].
    aspect : float
        Metres per pixel along v over those along u.
    """

    def __init__(self, size: tuple[int, int], aspect: float) -> None:
        self._grid = regular_grid(size)
        self._aspect = aspect
        # a turn counts by how far it moves what lies halfway to the shorter edge
        self._units = np.array([1.0, 1.0, 4.0 / min(size)])
        self._closed = np.zeros((size[1], size[0]), np.bool_)

    def ignore(self, closed: Bools | None) -> None:
        """Compare no pixel where something is fixed to the lens, (H, W) bool; None: compare all."""
        self._closed = np.zeros_like(self._closed) if closed is None else closed

    def widened(self, before: Grey16, now: Grey16, motion: ImageMotion, information: Floats) -> Floats:
        """Return the information of a motion, less along its weak axis where other motions fit as well.

        Parameters
        ----------
        before, now : (H, W) uint16
            Smoothed pictures (see `filters.smooth`).
        motion : ImageMotion
            Of the content between them, as it was found.
        information : (3, 3) float64
            Of it (u, v, turn).
        """
        scaled = information * np.outer(self._units, self._units)
        values, vectors = np.linalg.eigh(scaled)
        clip = self._clip(before, now, motion)
        weaker = scaled
        for value, axis in zip(values[:_N_AXES], vectors.T):
            reaches = self._reaches(before, now, motion, axis * self._units, clip)
            spread = mean_square_within(*reaches)
            if spread * value > 1.0:
                weaker = weaker + (1.0 / spread - value) * np.outer(axis, axis)
        return np.asarray(weaker / np.outer(self._units, self._units), np.float64)

    def _reaches(
        self, before: Grey16, now: Grey16, motion: ImageMotion, axis: Floats, clip: float
    ) -> tuple[float, float]:
        """Return how far to either side motions fit as well as what was found [px]."""
        found = self._costs(before, now, motion, clip)
        reaches = []
        for side in (-1.0, 1.0):
            farthest, n_worse = 0.0, 0
            for shift in _SHIFTS_PX:
                u, v, turn = motion.array() + side * shift * axis
                other = self._costs(before, now, ImageMotion(u, v, turn), clip)
                is_worse = _is_worse(found, other)
                farthest, n_worse = (farthest, n_worse + 1) if is_worse else (shift, 0)
                if n_worse == _N_WORSE:
                    break
            reaches.append(farthest)
        return reaches[0], reaches[1]

    def _clip(self, before: Grey16, now: Grey16, motion: ImageMotion) -> float:
        costs = self._costs(before, now, motion, math.inf)
        return _CLIP_MEANS * max(1.0, float(costs[:, 0].sum() / max(1.0, costs[:, 1].sum())))

    def _costs(self, before: Grey16, now: Grey16, motion: ImageMotion, clip: float) -> Floats:
        moved = (motion.u, motion.v, motion.turn_rad)
        pixels = (self._grid.places, self._grid.parts, self._closed)
        return _sums_of_parts(before, now, pixels, self._grid.centre, moved, self._aspect, clip)


def mean_square_within(below: float, above: float) -> float:
    """Return the mean square of what lies evenly from -`below` to `above`; 0 where that is nothing."""
    width = below + above
    return (below**3 + above**3) / (3.0 * width) if width > 0.0 else 0.0


def _is_worse(found: Floats, other: Floats) -> bool:
    """Return whether a motion fits worse than what was found, by a paired test of the parts of the picture."""
    both = (found[:, 1] >= _LEAST_PIXELS) & (other[:, 1] >= _LEAST_PIXELS)
    n_parts = int(np.count_nonzero(both))
    if n_parts < _LEAST_PARTS:
        return True  # what leaves the picture cannot be asked
    excess = other[both, 0] / other[both, 1] - found[both, 0] / found[both, 1]
    return bool(excess.mean() >= _STANDARD_ERRORS * excess.std(ddof=1) / math.sqrt(n_parts))


@float_kernel
def _sums_of_parts(
    before: Grey16,
    now: Grey16,
    pixels: tuple[Float32s, Int64s, Bools],
    centre: tuple[float, float],
    motion: tuple[float, float, float],
    aspect: float,
    clip: float,
) -> Floats:
    """Return the sum of the clipped absolute differences after a motion, and the pixels, of each part, (16, 2)."""
    grid, parts, closed = pixels
    height, width = before.shape
    cos = np.float32(math.cos(motion[2]))
    across, down = np.float32(math.sin(motion[2]) * aspect), np.float32(math.sin(motion[2]) / aspect)
    from_x, from_y = np.float32(centre[0]), np.float32(centre[1])
    to_x, to_y = np.float32(centre[0] + motion[0]), np.float32(centre[1] + motion[1])
    last_x, last_y, one, most = np.float32(width - 2), np.float32(height - 2), np.float32(1.0), np.float32(clip)
    out = np.zeros((N_SIDE * N_SIDE, 2), np.float64)
    for k in range(grid.shape[1]):
        dx, dy = grid[0, k] - from_x, grid[1, k] - from_y
        x, y = cos * dx + across * dy + to_x, cos * dy - down * dx + to_y
        if x < one or y < one or x >= last_x or y >= last_y:
            continue
        u, v, i, j = int(grid[0, k]), int(grid[1, k]), int(x), int(y)
        if closed[v, u] or closed[j, i]:
            continue
        a, b = x - np.float32(i), y - np.float32(j)
        above = np.float32(now[j, i]) + a * (np.float32(now[j, i + 1]) - np.float32(now[j, i]))
        below = np.float32(now[j + 1, i]) + a * (np.float32(now[j + 1, i + 1]) - np.float32(now[j + 1, i]))
        out[parts[k], 0] += min(abs(above + b * (below - above) - np.float32(before[v, u])), most)
        out[parts[k], 1] += 1.0
    return out
