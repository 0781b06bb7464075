"""How old estimates are when they arrive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import DataError

__all__ = ["Percentiles", "percentiles"]


@dataclass(frozen=True, slots=True)
class Percentiles:
    """Mean, percentiles and maximum of durations [s].

    Attributes
    ----------
    n : int
        How many durations.
    mean_s, p50_s, p95_s, p99_s, max_s : float
        Mean, 50th, 95th and 99th percentile, and maximum [s].
    """

    n: int
    mean_s: float
    p50_s: float
    p95_s: float
    p99_s: float
    max_s: float

    def document(self) -> dict[str, float]:
        """Return them in milliseconds, as ``timing.json`` has them."""
        names = ("mean", "p50", "p95", "p99", "max")
        return {"n": self.n, **{f"{name}_ms": 1e3 * getattr(self, f"{name}_s") for name in names}}


def percentiles(durations_s: Floats) -> Percentiles:
    """Return the percentiles of (N,) durations [s].

    Parameters
    ----------
    durations_s : (N,) float64
        Durations [s].

    Returns
    -------
    Percentiles
        Count, mean, 50th, 95th and 99th percentile and maximum [s].

    Raises
    ------
    DataError
        If there is none.
    """
    if len(durations_s) == 0:
        raise DataError("percentiles need at least one duration")
    p50, p95, p99 = np.percentile(durations_s, [50.0, 95.0, 99.0]).tolist()
    return Percentiles(len(durations_s), float(durations_s.mean()), p50, p95, p99, float(durations_s.max()))
