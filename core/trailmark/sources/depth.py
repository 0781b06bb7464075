"""Depth pictures, as they are recorded and sent, in metres."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.errors import SourceError

__all__ = ["depth_in_metres"]


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
