"""Figures of many values, some of which may be NaN: what could not be measured."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from trailmark.arrays import Floats

__all__ = ["largest_of", "mean_of", "rms", "sd_of", "spread_of"]


def mean_of(values: Floats) -> float | None:
    """Return the mean of what is a number; None where nothing is."""
    numbers = values[np.isfinite(values)]
    return float(numbers.mean()) if len(numbers) else None


def sd_of(values: Floats) -> float | None:
    """Return the standard deviation of what is a number; None where nothing is."""
    numbers = values[np.isfinite(values)]
    return float(numbers.std()) if len(numbers) else None


def largest_of(values: Floats) -> float | None:
    """Return the largest number; None where there is none."""
    numbers = values[np.isfinite(values)]
    return float(numbers.max()) if len(numbers) else None


def rms(values: Floats) -> float:
    """Return the root mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else math.nan


def spread_of(values: Sequence[float]) -> float | None:
    """Return the standard deviation over seeds; None where there is one seed."""
    return float(np.std(values)) if len(values) > 1 else None
