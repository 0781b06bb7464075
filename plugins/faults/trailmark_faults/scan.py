"""Faults of laser scanners."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from trailmark.frames import Scan

__all__ = ["worsen_ranges"]


def worsen_ranges(scan: Scan, noise_m: float, stray: float, rng: np.random.Generator) -> Scan:
    """Return a scan with noise on its ranges and with beams that return from anywhere.

    Parameters
    ----------
    scan : Scan
        The scan.
    noise_m : float
        Standard deviation [m].
    stray : float
        Share of beams that return from anywhere within what the scanner can measure.
    rng : numpy.random.Generator
        Of this frame.
    """
    if not (noise_m or stray):
        return scan
    ranges = np.array(scan.ranges_m)
    ranges += (noise_m * rng.standard_normal(len(ranges))).astype(ranges.dtype)
    if stray:
        known = ranges[np.isfinite(ranges)]
        far_m = scan.range_max_m if math.isfinite(scan.range_max_m) else float(known.max(initial=1.0))
        is_stray = rng.random(len(ranges)) < stray
        ranges[is_stray] = rng.uniform(scan.range_min_m, far_m, int(is_stray.sum()))
    return replace(scan, ranges_m=np.where(ranges < scan.range_min_m, np.nan, ranges).astype(ranges.dtype))
