"""Depth pictures, and the pairing of colour with depth."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.errors import SourceError

__all__ = ["depth_in_metres", "pair_nearest"]


def depth_in_metres(raw: npt.NDArray[Any], values_per_metre: float, where: str) -> npt.NDArray[np.float32]:
    """Return depth in metres, NaN where it is unknown.

    Parameters
    ----------
    raw : (H, W) uint16 or float32
        Depth as recorded; 0, infinite and NaN mean unknown.
    values_per_metre : float
        5000 for the TUM benchmark, 1000 for millimetres, 1 for metres.
    where : str
        What messages call it.

    Raises
    ------
    SourceError
        If it is no depth picture.
    """
    if raw.ndim != 2 or raw.dtype not in (np.uint16, np.float32):
        raise SourceError(f"{where}: a depth picture is (H, W) of uint16 or float32, not {raw.shape} of {raw.dtype}")
    depth_m = raw.astype(np.float32) / np.float32(values_per_metre)
    depth_m[~(np.isfinite(depth_m) & (depth_m > 0))] = np.nan
    return depth_m


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
