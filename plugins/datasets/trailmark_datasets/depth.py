"""The pairing of recorded colour with depth."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trailmark.sources.depth import depth_in_metres

__all__ = ["depth_in_metres", "pair_nearest"]


def pair_nearest(
    first_s: npt.NDArray[np.float64], second_s: npt.NDArray[np.float64], max_difference_s: float
) -> list[tuple[int, int]]:
    """Pair stamps one to one, the nearest first, as the TUM benchmark's own tool does.

    Parameters
    ----------
    first_s, second_s : (N,), (M,) float
        Stamps, increasing [s].
    max_difference_s : float
        Stamps that differ more are no pair [s].

    Returns
    -------
    list of (int, int)
        Indices of the pairs, in order of the first.
    """
    lower = np.searchsorted(second_s, first_s - max_difference_s, side="left")
    upper = np.searchsorted(second_s, first_s + max_difference_s, side="right")
    candidates = sorted(
        (abs(float(first_s[i] - second_s[j])), i, j)
        for i in range(len(first_s))
        for j in range(int(lower[i]), int(upper[i]))
    )
    pairs: dict[int, int] = {}
    taken: set[int] = set()
    for _, i, j in candidates:
        if i not in pairs and j not in taken:
            pairs[i] = j
            taken.add(j)
    return sorted(pairs.items())
