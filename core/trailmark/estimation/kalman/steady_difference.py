"""By how much one motion differs from another, always alike: what is left where the noise of windows averages out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

__all__ = ["NO_SCATTER", "DifferenceEstimate", "SteadyDifference", "best_estimate"]

# Over how many windows is looked back, beside all: a lie that is new shows over some seconds, a small one over minutes.
_FAST, _SLOW = 24.0, 240.0
# So few windows do not tell their scatter, and few tell it badly.
_TOO_FEW, _FEW = 3.5, 4.0
# A difference of so many of its own standard deviations counts by half: of late and of long ago, where chance is looked
# at anew all the time, and of all.
_HALVES = (3.0, 3.0, 2.0)
# What is sure: by so many standard deviations, in so many windows.
_SURE, _MANY = 5.0, 8.0
#: A scatter that is none.
NO_SCATTER = 1e-9


class SteadyDifference(NamedTuple):
    """How a motion differs from another per unit of way, turn or time, in windows.

    Attributes
    ----------
    whole, whole_extent, slow, slow_extent, fast, fast_extent : float
        Sums of the differences, and of the way, turn or time that they are of: of all, of long ago and of late.
    scatter, n : float
        Sum of the squares of what windows differ by from those before, per unit, and how many they are.
    """

    whole: float = 0.0
    whole_extent: float = 0.0
    slow: float = 0.0
    slow_extent: float = 0.0
    fast: float = 0.0
    fast_extent: float = 0.0
    scatter: float = 0.0
    n: float = 0.0

    def after(self, apart: float, of: float) -> SteadyDifference:
        """Return it after one more window."""
        whole, whole_extent, slow, slow_extent, fast, fast_extent, scatter, n = self
        if fast_extent > 0.0:
            surprise = apart - fast / fast_extent * of
            scatter = (1.0 - 1.0 / _SLOW) * scatter + surprise * surprise / (of * (1.0 + of / fast_extent))
            n = (1.0 - 1.0 / _SLOW) * n + 1.0
        return SteadyDifference(
            whole + apart,
            whole_extent + of,
            (1.0 - 1.0 / _SLOW) * slow + apart,
            (1.0 - 1.0 / _SLOW) * slow_extent + of,
            (1.0 - 1.0 / _FAST) * fast + apart,
            (1.0 - 1.0 / _FAST) * fast_extent + of,
            scatter,
            n,
        )

    @property
    def variance(self) -> float:
        """Variance of a window of one unit; too few windows do not know it."""
        return self.scatter / self.n * (1.0 + _FEW / self.n) if self.n > _TOO_FEW else math.inf

    @property
    def unseen(self) -> float:
        """Variance of the difference per unit, by all that was compared."""
        return self.variance / self.whole_extent

    def estimates(self) -> Iterator[tuple[float, float]]:
        """Yield the difference per unit and its standard deviation: of late, of long ago and of all."""
        variance = self.variance
        if variance < math.inf:
            yield self.fast / self.fast_extent, math.sqrt(variance / self.fast_extent)
            yield self.slow / self.slow_extent, math.sqrt(variance / self.slow_extent)
            yield self.whole / self.whole_extent, math.sqrt(variance / self.whole_extent)


class DifferenceEstimate(NamedTuple):
    """A difference per unit as it counts, as it is, its standard deviation, and whether it is sure."""

    counts: float
    value: float
    sigma: float
    is_sure: bool


def best_estimate(difference: SteadyDifference) -> DifferenceEstimate | None:
    """Return the estimate that counts most, of late, of long ago or of all; None of too few windows."""
    best = None
    for half, (value, sigma) in zip(_HALVES, difference.estimates()):
        fourth = (value / (half * sigma + NO_SCATTER)) ** 4
        counts = abs(value) * math.sqrt(fourth / (1.0 + fourth))
        if best is None or counts > best.counts:
            is_sure = abs(value) > _SURE * sigma and difference.n >= _MANY
            best = DifferenceEstimate(counts, value, sigma, is_sure)
    return best
