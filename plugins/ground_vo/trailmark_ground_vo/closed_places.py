"""Places of the picture where no pixel has a say: something is fixed to the lens there."""

from __future__ import annotations

import math

import cv2
import numpy as np

from trailmark.arrays import Bools, Float32s, Grey8
from trailmark.kernels import kernel

__all__ = ["closed_by", "is_at"]

#: Pixels so near to a faded one have it in their smoothed value or slopes [px].
_NEAR_PX = 3

#: Where more than this would have no say, what is left does not hold the motion, and all pixels have theirs [share of
#: the picture]. Spots of 2 to 7 px on 5 % of the picture close up to 0.47 of it, a lattice of small ones nearly all.
_MOST_CLOSED = 0.55


def closed_by(weights: Grey8) -> Bools | None:
    """Return where a smoothed pixel or its slopes look at something faded, (H, W) bool; None where that is too much.

    Parameters
    ----------
    weights : (H, W) uint8
        As of `brightness.fade_pixels`.
    """
    side = 2 * _NEAR_PX + 1
    faded = cv2.dilate((weights < 255).astype(np.uint8), np.ones((side, side), np.uint8))
    return np.asarray(faded, np.bool_) if cv2.countNonZero(faded) <= _MOST_CLOSED * faded.size else None


@kernel
def is_at(
    mask: Bools, places: Float32s, centre: tuple[float, float], motion: tuple[float, float, float], aspect: float
) -> Bools:
    """Return whether a mask is true where places come to by a motion, (N,) bool.

    Parameters
    ----------
    mask : (H, W) bool
        Beyond its edges it is as at the nearest one.
    places : (2 or more, N) float32
        Coordinates u and v in the first rows [px].
    centre, motion, aspect
        As in `texture.residuals`.
    """
    height, width = mask.shape
    cos, sin = math.cos(motion[2]), math.sin(motion[2])
    across, down = sin * aspect, sin / aspect
    out = np.empty(places.shape[1], np.bool_)
    for n in range(places.shape[1]):
        dx, dy = places[0, n] - centre[0], places[1, n] - centre[1]
        u = int(cos * dx + across * dy + centre[0] + motion[0] + 0.5)
        v = int(cos * dy - down * dx + centre[1] + motion[1] + 0.5)
        out[n] = mask[min(max(v, 0), height - 1), min(max(u, 0), width - 1)]
    return out
