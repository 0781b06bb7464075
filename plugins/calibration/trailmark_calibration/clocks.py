"""Whether the delay stays the same from the beginning of a drive to its end."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Bools
from trailmark_calibration.fitting import Fit, weights_of
from trailmark_calibration.model import DELAY, MotionPairs

__all__ = ["ClockDrift", "find_drift"]

_N_PARTS, _N_STEPS, _LEAST_ROWS = 8, 15, 10
#: So many standard errors from nothing, a drift is no chance.
_SURE = 4.0


@dataclass(frozen=True, slots=True)
class ClockDrift:
    """That the delay changes, and how much at least: on real drives it changed more than the parts of the drive told.

    Attributes
    ----------
    rate : float
        Seconds per second.
    least_s : float
        Over the drive [s].
    """

    rate: float
    least_s: float


def find_drift(pairs: MotionPairs, found: Fit) -> ClockDrift | None:
    """Return how the clocks run apart, by the delays of the parts of a drive; None: not more than chance makes.

    Parameters
    ----------
    pairs : MotionPairs
        The motions, in the order of time.
    found : Fit
        Of the whole drive.
    """
    numbers = np.arange(len(pairs))
    parts = [np.isin(numbers, part) for part in np.array_split(numbers, _N_PARTS) if len(part) >= _LEAST_ROWS]
    told = [(float(pairs.from_s[rows].mean()), *_delay_of(pairs, found, rows)) for rows in parts]
    at_s, delays_s, sigmas_s = np.array([one for one in told if np.isfinite(one[2])]).reshape(-1, 3).T
    if len(at_s) < 4:
        return None
    weights = 1.0 / sigmas_s**2
    off_s = at_s - np.average(at_s, weights=weights)
    spread = float(weights @ off_s**2)
    rate = float(weights * off_s @ delays_s) / spread
    left_s = delays_s - np.average(delays_s, weights=weights) - rate * off_s
    scatter = max(1.0, float(weights @ left_s**2) / (len(at_s) - 2))
    if abs(rate) < _SURE * math.sqrt(scatter / spread):
        return None
    return ClockDrift(rate, abs(rate) * float(pairs.to_s[-1] - pairs.from_s[0]))


def _delay_of(pairs: MotionPairs, found: Fit, rows: Bools) -> tuple[float, float]:
    """Return the delay of some intervals, the other numbers being as found, and its standard error [s]."""
    part, p = pairs.where(rows), found.values.copy()
    information = 0.0
    for _ in range(_N_STEPS):
        off, weights, base = weights_of(part, p, found.spread)
        off, weights = np.nan_to_num(off), np.nan_to_num(weights)
        trust = 1.0 / (1.0 + np.einsum("ni,nij,nj->n", off, weights, off) / 9.0)
        slope = np.nan_to_num(part.sensitivities(p, base)[:, :, DELAY])
        pulled = np.einsum("ni,nij,n->nj", slope, weights, trust)
        information = float(np.einsum("nj,nj->", pulled, slope))
        if information <= 0.0:
            return 0.0, math.inf
        step_s = float(np.einsum("nj,nj->", pulled, off)) / information
        p[DELAY] += float(np.clip(step_s, -0.05, 0.05))
        if abs(step_s) < 1e-5:
            break
    return float(p[DELAY]), 1.0 / math.sqrt(information)
