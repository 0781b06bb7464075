"""Finds other delays that explain a drive as well: a drive that repeats itself does not show which is right."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import DataError
from trailmark_calibration.fitting import Fit, KnownPlacement, cost_of, fit_from
from trailmark_calibration.model import DELAY, YAW, MotionPairs
from trailmark_calibration.starting import delay_peaks

__all__ = ["Rival", "find_rival", "widened_by"]

#: A difference of costs so many standard errors above nothing is no chance (one in 1,000).
_SURE = 3.0
#: So many of the highest peaks are tried, and over so many times the longest delay.
_N_PEAKS, _REACH = 8, 2.0
#: As far as this on a long drive: a clock may be seconds off [s].
_FAR_S = 5.0


@dataclass(frozen=True, slots=True, eq=False)
class Rival:
    """Other numbers that explain the motion as well as those that were found.

    Attributes
    ----------
    apart : (8,) float64
        The largest difference of each number between what was found and what else explains the motion.
    nearest_s : float
        How far the nearest of the other delays is from the one that was found [s].
    """

    apart: Floats
    nearest_s: float


def find_rival(pairs: MotionPairs, known: KnownPlacement, found: Fit) -> Rival | None:
    """Return what else explains the drive, or None.

    The fit begins again at the other peaks of the correlation of turn rates, with turns of either sign. Its cost is
    compared interval by interval: a rival stays if what was found is not surely better (Vuong's test).

    Parameters
    ----------
    pairs : MotionPairs
        The motions.
    known : KnownPlacement
        What is known before; delays twice as long as its longest count too.
    found : Fit
        What was found.
    """
    if not found.is_told[DELAY]:
        return None
    peaks_s, width_s = delay_peaks(pairs.a, pairs.b, _reach_s(pairs, known))
    cost = cost_of(pairs, found.values, found.spread)
    apart, others_s = [], []
    for delay_s in peaks_s[:_N_PEAKS]:
        if abs(delay_s - found.values[DELAY]) < width_s:
            continue
        try:
            other = fit_from(pairs, known, delay_s)
        except DataError:
            continue
        differences = cost_of(pairs, other.values, found.spread) - cost
        differences = differences[np.isfinite(differences)]
        error = float(np.std(differences)) / math.sqrt(max(len(differences), 1))
        if abs(other.values[DELAY] - found.values[DELAY]) < width_s or np.mean(differences) > _SURE * error:
            continue
        others_s.append(abs(float(other.values[DELAY] - found.values[DELAY])))
        apart.append(_differences(found, other))
    return Rival(np.max(apart, axis=0), min(others_s)) if apart else None


def _reach_s(pairs: MotionPairs, known: KnownPlacement) -> float:
    """Return up to which delay others are tried: a slalom that is half a period off turns the other way."""
    driven_s = float(pairs.to_s[-1] - pairs.from_s[0])
    return max(_REACH * known.longest_delay_s, min(_FAR_S, driven_s / 6.0))


def widened_by(found: Fit, apart: Floats) -> Fit:
    """Return a fit whose standard deviations are at least `apart` (8,)."""
    factors = np.maximum(1.0, apart / found.sigmas)
    return replace(found, covariance=found.covariance * np.outer(factors, factors))


def _differences(found: Fit, other: Fit) -> Floats:
    """Return how far two fits are apart, 0 where their own uncertainty explains it, (8,)."""
    off = np.abs(found.values - other.values)
    off[YAW] = abs(math.remainder(float(off[YAW]), 2.0 * math.pi))
    return np.where(off > _SURE * np.hypot(found.sigmas, other.sigmas), off, 0.0)
