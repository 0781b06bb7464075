"""How far to trust a motion.

A tracker that rolls along does not err anew in every picture: it compares with remembered pixels, so that the error
against them stays as it is until they are replaced. What grows is the error that enters with new pixels. The
covariance of one motion is therefore that of the alignment times the share of pixels replaced in that picture, and
the sum over a way is the drift that is seen on it, not the sum of the noise of single pictures.
"""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Floats, Int32s
from trailmark.kernels import kernel

__all__ = ["drift_information", "response_covariance", "turn_information", "whole_pixel_information", "with_scatter"]


#: Variance of rounding to whole pixels.
ROUNDING_PX2 = 1.0 / 12.0

#: Share of the alignment's covariance that a motion has even when no pixel was replaced.
_FLOOR = 1e-3


@kernel
def response_covariance(errors: Int32s, best: int, n_pixels: int) -> Floats:
    """Return the covariance of the shift (u, v) that a search found, (2, 2) [px^2].

    Every candidate counts with exp(-(E - E_min) / T) (after Singh & Allen). The sum of N differences scatters by about
    the square root of N times one of them, so T = E_min / sqrt(N). Along a grain, where E hardly grows, many
    candidates count; where E is sharp, rounding to whole pixels is what is left.

    Parameters
    ----------
    errors : (K, J, I) int32
        Sums of absolute differences.
    best : int
        Their minimum.
    n_pixels : int
        N.
    """
    temperature = max(1.0, best / math.sqrt(n_pixels))
    total = mean_u = mean_v = uu = uv = vv = 0.0
    _, size_j, size_i = errors.shape
    for plane in errors:
        for j in range(size_j):
            for i in range(size_i):
                excess = (plane[j, i] - best) / temperature
                if excess < 12.0:
                    weight = math.exp(-excess)
                    total += weight
                    mean_u += weight * i
                    mean_v += weight * j
                    uu += weight * i * i
                    uv += weight * i * j
                    vv += weight * j * j
    mean_u, mean_v = mean_u / total, mean_v / total
    out = np.empty((2, 2), np.float64)
    out[0, 0] = uu / total - mean_u * mean_u + ROUNDING_PX2
    out[1, 1] = vv / total - mean_v * mean_v + ROUNDING_PX2
    out[0, 1] = out[1, 0] = uv / total - mean_u * mean_v
    return out


def whole_pixel_information(first: Floats, second: Floats, distance_px: float, aspect: float) -> Floats:
    """Return the information of (u, v, turn) of Eq. (3) from the covariances of two shifts, (3, 3).

    Parameters
    ----------
    first, second : (2, 2) float64
        Covariances of the shifts of the two groups [px^2].
    distance_px : float
        Distance of the groups' centres [px].
    aspect : float
        Metres per pixel along v over those along u.

    Returns
    -------
    (3, 3) float64
        Information of (u, v, turn) [1/px^2, 1/rad^2].
    """
    lever = 1.0 / (distance_px * aspect)  # turn = lever (u_1 - u_2), shift = (shift_1 + shift_2) / 2
    both, apart = (first + second) / 4.0, (first - second) * (lever / 2.0)
    turn = lever * lever * (first[0, 0] + second[0, 0])
    covariance = [
        [both[0, 0], both[0, 1], apart[0, 0]],
        [both[0, 1], both[1, 1], apart[0, 1]],
        [apart[0, 0], apart[0, 1], turn],
    ]
    inverse = np.linalg.inv(np.array(covariance))
    return np.asarray((inverse + inverse.T) / 2.0)


def drift_information(alignment: Floats, replaced: float, growth: float) -> Floats:
    """Return the information of what one motion adds to the way, from that of its alignment.

    Parameters
    ----------
    alignment : (3, 3) float64
        Information of the alignment with the remembered pixels.
    replaced : float
        Share of the remembered pixels that were replaced in this picture.
    growth : float
        Measured: variance of the drift per full replacement, over the alignment's.
    """
    return alignment / max(_FLOOR, growth * replaced)


def with_scatter(information: Floats, scatter: Floats) -> Floats:
    """Return the information of a motion that both drifts and scatters.

    Parameters
    ----------
    information : (3, 3) float64
        Of what the motion adds to the way.
    scatter : (3, 3) float64
        Covariance of finding the picture's place, which the motions before and after share with opposite sign.
    """
    # (information^-1 + scatter)^-1, without the inverse of what may have none
    out = information @ np.linalg.inv(np.eye(3) + scatter @ information)
    return np.asarray((out + out.T) / 2.0, np.float64)


def turn_information(information: Floats) -> float:
    """Return the information of the turn alone, with the shift unknown, of that of (u, v, turn) [1/rad^2]."""
    shared = information[:2, 2]
    return float(information[2, 2] - shared @ np.linalg.pinv(information[:2, :2]) @ shared)
