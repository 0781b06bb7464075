"""How long the errors of absolute poses last: learned from the innovations of each localizer.

Innovations of a consistent filter are white if the looks err anew each time. Lasting errors correlate them, and so does
a gain that is too small: of a localizer that is better than it says, or of motion that is worse. The three are told
apart by two moments, variance and covariance with the next, of which the model in `correlated_fixes` says what each
should be: the size of the errors and their correlation r are solved for together. Where innovations are larger than
stated, motion or size are wrong, and nothing is learned here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.correlated_fixes import innovation_moments
from trailmark.estimation.kalman.innovation import Innovation

__all__ = ["CorrelationTimes", "correlation_of"]

#: Looks that are remembered, and that there must be; how often the correlation is looked for, and how far it follows.
_REMEMBERED, _ENOUGH, _EVERY, _FOLLOWS = 250, 40, 5, 0.2
#: Correlations below this are nothing; once one is believed, below this.
_LEAST, _LEAST_AGAIN = 0.3, 0.2
#: Innovations are clipped at so many sigmas. Beyond this share of the stated variance they say nothing of correlation;
#: nor do looks that are better than stated by so much.
_CLIPPED, _TOO_LARGE, _MUCH_BETTER = 3.0, 1.25, 0.1
#: Looks that are further apart than so many times their usual interval are not compared.
_GAP = 3.0
_CORRELATIONS = [*(0.025 * i for i in range(38)), 0.95, 0.96, 0.97, 0.98, 0.985, 0.99]


def correlation_of(variance: float, covariance: float, gain: float, lost: float) -> float:
    """Return the correlation from one look to the next that explains the moments of innovations, from 0 to 0.99.

    Parameters
    ----------
    variance, covariance : float
        Mean square of the innovations and mean product with the next, in stated variances of a look.
    gain, lost : float
        Gain of the filter, and variance that motion adds between looks.
    """
    found = _first(variance, covariance, gain, lost, None)
    size = _size_of(variance, gain, lost, found)
    if size < _MUCH_BETTER:
        return 0.0
    return found if size <= 1.0 else min(found, _first(variance, covariance, gain, lost, 1.0))


def _first(variance: float, covariance: float, gain: float, lost: float, size: float | None) -> float:
    """Return the smallest correlation that explains a covariance, of errors of a size or of one that fits."""
    for r in _CORRELATIONS:
        _, of_looks, _, of_motion = innovation_moments(r, gain, lost)
        share = _size_of(variance, gain, lost, r) if size is None else size
        if share * of_looks + of_motion >= covariance:
            return r
    return _CORRELATIONS[-1]


def _size_of(variance: float, gain: float, lost: float, r: float) -> float:
    of_looks, _, of_motion, _ = innovation_moments(r, gain, lost)
    return max((variance - of_motion) / of_looks, 0.0)


class _Looks:
    """Running moments of the innovations of one localizer's positions."""

    __slots__ = ("_last", "_last_s", "_means", "_n", "correlation", "found", "interval_s")

    def __init__(self, correlation: float = 0.0, interval_s: float = 0.0) -> None:
        self.correlation, self.interval_s = correlation, interval_s
        self.found: float | None = None
        self._last: tuple[float, float] | None = None
        self._last_s = -math.inf
        self._means = [0.0] * 5
        self._n = 0

    def add(self, stamp_s: float, innovation: Floats, spread: Floats, share: float) -> None:
        """Add an innovation in units of a look; what is not later than the last says nothing of what follows."""
        dt_s = stamp_s - self._last_s
        if dt_s <= 0.0:
            return
        numbers, variances = innovation.tolist(), spread.tolist()
        limit_x, limit_y = _CLIPPED * math.sqrt(1.0 + variances[0]), _CLIPPED * math.sqrt(1.0 + variances[1])
        clipped = min(max(numbers[0], -limit_x), limit_x), min(max(numbers[1], -limit_y), limit_y)
        last, self._last, self._last_s = self._last, clipped, stamp_s
        if last is None or (self._n > _EVERY and dt_s > _GAP * self.interval_s):
            return
        prior = 0.5 * (variances[0] + variances[1])
        gain = prior * share / (1.0 + prior * share)
        self._n += 1
        rate = max(1.0 / _REMEMBERED, 1.0 / self._n)
        self.interval_s += rate * (dt_s - self.interval_s)
        now = (
            0.5 * (clipped[0] ** 2 + clipped[1] ** 2),
            0.5 * (clipped[0] * last[0] + clipped[1] * last[1]),
            gain,
            gain * prior,
            prior,
        )
        self._means = [mean + rate * (value - mean) for mean, value in zip(self._means, now)]
        if self._n >= _ENOUGH and self._n % _EVERY == 0:
            self._follow()

    def _follow(self) -> None:
        variance, covariance, gain, lost, prior = self._means
        if gain <= 0.0:
            return
        found = 0.0 if variance > _TOO_LARGE * (1.0 + prior) else correlation_of(variance, covariance, gain, lost)
        self.found = found = found if found >= _LEAST else 0.0
        self.correlation += _FOLLOWS * (found - self.correlation)
        if found == 0.0 and self.correlation < _LEAST_AGAIN:
            self.correlation = 0.0


class CorrelationTimes:
    """Learns how long the errors of each localizer's absolute poses last: slowly, and never below what is white."""

    def __init__(self) -> None:
        self._looks: dict[str, _Looks] = {}
        self._has_parts = False

    def begin_anew(self) -> CorrelationTimes:
        """Return times that are learned from now on, at any time, and begin with what is known."""
        anew = CorrelationTimes()
        anew._has_parts = self._has_parts
        anew._looks = {source: _Looks(looks.correlation, looks.interval_s) for source, looks in self._looks.items()}
        return anew

    def observe(self, source: str, stamp_s: float, seen: Innovation, used: Innovation) -> None:
        """Take note of an innovation, as it was and as it was used; of a part of a pose it says nothing."""
        if len(seen.innovation) < 3:
            self._has_parts = True
            return
        looks = self._looks.get(source)
        if looks is None:
            looks = self._looks[source] = _Looks()
        scale = used.scale
        share = scale * scale if isinstance(scale, float) else float(np.mean(scale[:2] ** 2))
        looks.add(stamp_s, seen.innovation, seen.spread, share)

    @property
    def explains_corrections(self) -> bool:
        """Whether a belief that is corrected to one side for seconds may be no fault of the motion.

        So it is where errors last, while too little was seen to know, and where parts of poses correct, of which it
        is never known: a compass that is 1 deg off all day says nothing of the wheels.
        """
        return self._has_parts or any(
            looks.found is None or looks.found > 0.0 or looks.correlation > 0.0 for looks in self._looks.values()
        )

    def correlation_s(self, source: str) -> float:
        """Return how long the errors of a localizer last; 0 where each look errs anew, or nothing is known [s]."""
        looks = self._looks.get(source)
        if looks is None or looks.correlation == 0.0:
            return 0.0
        return -looks.interval_s / math.log(looks.correlation)

    def times(self) -> Mapping[str, float]:
        """Return the times that are not zero, by localizer [s]."""
        found = {source: self.correlation_s(source) for source in sorted(self._looks)}
        return {source: time_s for source, time_s in found.items() if time_s > 0.0}
