"""How late the absolute poses of each localizer seem, so that no scale of a covariance answers for it.

Poses that are late by a constant differ from the motion between them wherever base turns or changes its speed. No
noise does that, neither of the poses nor of the motion; taken for noise, it is learned as that of the motion over long
ways. So the delay is fitted beside the scales, by weighted least squares over the same differences.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from trailmark.arrays import Floats
from trailmark.deprecation import deprecated_name
from trailmark.estimation.kalman.clock_offsets import TimeOffset
from trailmark.estimation.kalman.gate import threshold
from trailmark.estimation.kalman.noise_residuals import BESIDE_S, Residual
from trailmark.estimation.kalman.overlapping_differences import WeightedDifferences, variance_of_sum
from trailmark.estimation.kalman.variance_components import CLIPPED, CLIPPED_MEANS, Key, Pairing

__all__ = ["DelaysInFixes", "StackedDifferences"]

#: A delay is so large before anything is seen, one standard deviation [s].
_EXPECTED_S = 0.2
#: And a scale of the way is off by so large a share.
_EXPECTED_SCALE = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class StackedDifferences:
    """Differences of one kind, stacked.

    Attributes
    ----------
    values : (N, d) float64
        The differences.
    covariances : (N, m, d, d) float64
        The share of each localizer in their covariances, as stated.
    by_delay, by_scale : (N, d) float64 or None
        How they change with a delay of the poses that were compared, and with a scale of the way between.
    since_s, stamp_s : (N,) float64
        The time that each is about [s].
    share_of_news : float
        Over how much time they go, as a share of the sum of their times: those that overlap see the same motion.
    """

    values: Floats
    covariances: Floats
    by_delay: Floats | None
    by_scale: Floats | None
    since_s: Floats
    stamp_s: Floats
    share_of_news: float

    @classmethod
    def of(cls, found: Collection[Residual]) -> StackedDifferences:
        """Return differences stacked."""
        slopes = [one.by_delay for one in found if one.by_delay is not None]
        ways = [one.by_scale for one in found if one.by_scale is not None]
        return cls(
            np.array([one.value for one in found]),
            np.array([one.covariances for one in found]),
            np.array(slopes) if len(slopes) == len(found) else None,
            np.array(ways) if len(ways) == len(found) else None,
            np.array([one.since_s for one in found]),
            np.array([one.stamp_s for one in found]),
            _share_of_news(found),
        )

    def scale_covariances(self, keys: tuple[Key, ...], logs: Mapping[Key, float]) -> Floats:
        """Return the covariances, scaled, (N, m, d, d)."""
        variances = np.array([math.exp(2.0 * logs.get(key, 0.0)) for key in keys])
        return np.asarray(self.covariances * variances[:, None, None])


class _DelayEvidence(NamedTuple):
    """What differences of one kind say of a delay.

    Attributes
    ----------
    motion : str
        The localizer whose motion the poses were compared with.
    sums : (3,) float64
        Moment, information as seen, and information without that of noise.
    differences : WeightedDifferences
        What was added up.
    """

    motion: str
    sums: Floats
    differences: WeightedDifferences


class DelaysInFixes:
    """The delay of the absolute poses of each localizer that fits what was seen best.

    Attributes
    ----------
    found : dict of str to TimeOffset
        By localizer, against the motion that told most of it; the standard deviation holds if the scales are right.
    """

    def __init__(self) -> None:
        self.found: dict[str, TimeOffset] = {}

    def fit(
        self,
        stacked: Mapping[Pairing, StackedDifferences],
        logs: Mapping[Key, float],
        correlations_s: Mapping[str, float],
    ) -> None:
        """Fit the delays; what chance would not do at the delays before counts for less.

        Parameters
        ----------
        stacked : dict of Pairing to StackedDifferences
            What was seen.
        logs : dict of Key to float
            Logarithms of the scales, as believed.
        correlations_s : dict of str to float
            How long the errors of the poses of a localizer last, where they do [s].
        """
        found: dict[str, list[_DelayEvidence]] = {}
        for (_, keys), stack in stacked.items():
            source = _source_of(keys, stack)
            if source is not None and stack.by_delay is not None:
                evidence = self._weigh(keys, stack, stack.by_delay, stack.scale_covariances(keys, logs))
                found.setdefault(source, []).append(evidence)
        for source, evidences in found.items():
            self.found[source] = _delay_of(evidences, correlations_s.get(source, 0.0))

    def _weigh(
        self, keys: tuple[Key, ...], stack: StackedDifferences, by_delay: Floats, believed: Floats
    ) -> _DelayEvidence:
        """Return what differences of one kind, with covariances as believed, (N, m, d, d), say of the delay."""
        weight = np.linalg.inv(believed.sum(axis=1))
        away = self.values_of(keys, stack)
        squares = np.einsum("ni,nij,nj->n", away, weight, away)
        limit = threshold(CLIPPED, away.shape[1])
        clipped = np.minimum(1.0, limit / np.maximum(squares, 1e-300))
        excess = float((clipped * squares).mean()) / (away.shape[1] * CLIPPED_MEANS[away.shape[1]])
        weight *= clipped[:, None, None]
        weights = np.einsum("ni,nij->nj", _beside_scale(by_delay, stack.by_scale, weight), weight)
        lengths_s = (stack.stamp_s - stack.since_s)[:, None, None]
        of_noise = np.einsum("nij,nij->", weight, believed[:, -1] / (BESIDE_S * lengths_s))
        seen = float((weights * by_delay).sum())
        told = max(seen - float(of_noise), 0.0)
        differences = WeightedDifferences(stack.since_s, stack.stamp_s, weights, believed * max(excess, 1.0))
        return _DelayEvidence(keys[-1][0], np.array([-(weights * stack.values).sum(), seen, told]), differences)

    def values_of(self, keys: tuple[Key, ...], stack: StackedDifferences) -> Floats:
        """Return differences as they are without the delay, (N, d)."""
        source = _source_of(keys, stack)
        if source is None or stack.by_delay is None:
            return stack.values
        known = self.found.get(source)
        return stack.values if known is None else np.asarray(stack.values + known.late_s * stack.by_delay)


def _beside_scale(by_delay: Floats, by_scale: Floats | None, weight: Floats) -> Floats:
    """Return how differences change with a delay, (N, d), less what a scale of the way would do as well.

    On an even drive the two look alike: a way that is told 5 % too long until the first pose is one of a pose that is
    late, and only further ones tell them apart.
    """
    if by_scale is None:
        return by_delay
    by_way = np.einsum("ni,nij->nj", by_scale, weight)
    common, known = float((by_way * by_delay).sum()), float((by_way * by_scale).sum()) + _EXPECTED_SCALE**-2
    return by_delay - common / known * by_scale


def _delay_of(evidences: Sequence[_DelayEvidence], correlation_s: float) -> TimeOffset:
    """Return the delay that fits all of the evidence on one localizer, whose errors last for a time [s]."""
    sums = np.zeros(3)
    weighed: dict[str, list[WeightedDifferences]] = {}
    against = (-1.0, "")
    for evidence in evidences:
        sums = sums + evidence.sums
        weighed.setdefault(evidence.motion, []).append(evidence.differences)
        against = max(against, (float(evidence.sums[2]), evidence.motion))
    moment_s, seen_s2, told_s2 = sums.tolist()
    # The slopes are noisy by the motion that they were taken from: `told` is what they are without.
    chance_s2 = variance_of_sum(list(weighed.values()), correlation_s)
    chance_s2 = max(chance_s2, seen_s2)  # that errors cancel out is not relied on: it takes a perfect model
    total = told_s2**2 + chance_s2 / _EXPECTED_S**2
    late_s = moment_s * told_s2 / total if total > 0.0 else 0.0
    sigma_s = math.sqrt(chance_s2 / total) if total > 0.0 else _EXPECTED_S
    return TimeOffset(against[1], late_s, sigma_s)


def _source_of(keys: tuple[Key, ...], stack: StackedDifferences) -> str | None:
    """Return whose poses are compared with each other; None for motions, and for poses of two localizers."""
    is_of_one = stack.by_delay is not None and keys[0] == keys[1]
    return keys[0][0] if is_of_one else None


def _share_of_news(found: Collection[Residual]) -> float:
    covered_s, total_s, until_s = 0.0, 0.0, -math.inf
    for one in found:
        covered_s += max(one.stamp_s - max(one.since_s, until_s), 0.0)
        total_s += one.stamp_s - one.since_s
        until_s = max(until_s, one.stamp_s)
    return covered_s / total_s if total_s > 0.0 else 1.0


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {"Stack": StackedDifferences})
