"""The joint fit: all numbers at once, outliers left out, each with what the drive says of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.errors import DataError
from trailmark_calibration.model import BIAS, DELAY, MotionPairs
from trailmark_calibration.solver import OUTLIER, GaussNewton
from trailmark_calibration.starting import correlated_delay, delay_peaks, starting_point

__all__ = ["LIMITS", "PRIOR", "Fit", "KnownPlacement", "cost_of", "fit", "fit_from", "values_of_all", "weights_of"]

#: What a config may be wrong by, one sigma, before the drive is looked at: in the order of `NAMES`.
PRIOR = np.array([0.5, 0.5, 0.2, 1.0, 1.0, 3.0, 0.5, 0.05])
#: KnownPlacement worse than this, one sigma, a number is not told.
LIMITS = np.array([0.02, 0.02, math.radians(1.0), 0.03, 0.03, math.radians(2.0), 0.03, math.radians(0.1)])
#: More of them than this, and the two do not move as one body.
_MOST_OUTLIERS = 0.3
#: Nor if so much of the motion is left over that one of them does not explain.
_MOST_LEFT = 0.3
#: Chi squares of three numbers beyond this are left out at first (one in 5,000).
_DOUBTFUL = 20.0
#: So many peaks of the correlation are tried where none stands out.
_N_STARTS = 6


@dataclass(frozen=True, slots=True, eq=False)
class KnownPlacement:
    """What is known before.

    Attributes
    ----------
    mounting : (3,) float64
        Place of the sensor by the config [m, m, rad].
    longest_delay_s : float
        No longer delay is looked for [s].
    """

    mounting: Floats
    longest_delay_s: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """What a drive says; numbers in the order of `model.NAMES`.

    Attributes
    ----------
    values : (8,) float64
        The numbers.
    covariance : (8, 8) float64
        Of them.
    n_pairs, n_outliers : int
        Intervals, and those of them that were left out.
    spread : (3,) float64
        Factors of the stated noise, along, across and in turn.
    """

    values: Floats
    covariance: Floats
    n_pairs: int
    n_outliers: int
    spread: Floats

    @property
    def sigmas(self) -> Floats:
        """Standard deviations, (8,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def is_told(self) -> Bools:
        """Whether the drive determines each number well enough to write it down, (8,)."""
        return np.asarray(self.sigmas < LIMITS)


def fit(pairs: MotionPairs, known: KnownPlacement) -> Fit:
    """Return the numbers that make two localizers move as one body.

    Raises
    ------
    DataError
        If they do not: no numbers make more than two thirds of the drive agree.
    """
    delay_s = correlated_delay(pairs.a, pairs.b, known.longest_delay_s)
    if delay_s is not None:
        return fit_from(pairs, known, delay_s)
    peaks_s, _ = delay_peaks(pairs.a, pairs.b, known.longest_delay_s)
    fits, refusal = [], None
    for start_s in [None, *peaks_s[:_N_STARTS]]:
        try:
            fits.append(fit_from(pairs, known, start_s))
        except DataError as error:
            refusal = refusal or error
    if not fits:
        assert refusal is not None
        raise refusal
    return min(fits, key=lambda one: _mean_cost(pairs, one, fits[0].spread))


def fit_from(pairs: MotionPairs, known: KnownPlacement, delay_s: float | None) -> Fit:
    """Return the numbers that are nearest to a delay, or, None, to no delay, which may then be far off.

    Raises
    ------
    DataError
        If the two do not move as one body by them.
    """
    start = starting_point(pairs, known.mounting, delay_s or 0.0)
    solver = GaussNewton(pairs, start, _prior(pairs, delay_s is not None))
    p = solver.solve(start, None)
    rows = solver.inliers(p, _DOUBTFUL)  # those that agree come back: no line decides by a hair
    for _ in range(4):
        p = solver.solve(p, rows)
        again = solver.inliers(p)
        if np.array_equal(again, rows):
            break
        rows = again
    n_outliers = len(pairs) - int(rows.sum())
    _refuse_two_bodies(pairs, p, n_outliers)
    return Fit(p, solver.covariance(p, rows), len(pairs), n_outliers, solver.spread)


def values_of_all(pairs: MotionPairs, found: Fit) -> Floats:
    """Return the numbers (8,) if no interval were left out, from those that were found."""
    solver = GaussNewton(pairs, found.values, _prior(pairs, has_delay=True))
    return solver.solve(found.values, np.ones(len(pairs), dtype=bool))


def weights_of(pairs: MotionPairs, p: Floats, spread: Floats) -> tuple[Floats, Floats, Floats]:
    """Return what is left (M, 3), its inverse covariance (M, 3, 3), and what a should have said (M, 3)."""
    solver = GaussNewton(pairs, p, PRIOR)
    solver.spread = spread
    return solver.linearize(p)


def cost_of(pairs: MotionPairs, p: Floats, spread: Floats) -> Floats:
    """Return the chi square of every interval, (M,), an outlier's as that of the smallest one; NaN where not known."""
    off, weights, _ = weights_of(pairs, p, spread)
    return np.asarray(np.minimum(np.einsum("ni,nij,nj->n", off, weights, off), OUTLIER))


def _mean_cost(pairs: MotionPairs, found: Fit, spread: Floats) -> float:
    return float(np.nanmean(cost_of(pairs, found.values, spread)))


def _refuse_two_bodies(pairs: MotionPairs, p: Floats, n_outliers: int) -> None:
    """Raise where too much is left over: of all intervals, or of the motion in most of them."""
    off = pairs.residuals(p)
    _, moved = pairs.motions(p)
    columns = [0, 1] if pairs.a.measures_way and pairs.b.measures_way else [2]
    left, whole = (np.nanquantile(np.linalg.norm(one[:, columns], axis=1), 0.75) for one in (off, moved))
    if left > _MOST_LEFT * whole:
        share = min(left / max(whole, 1e-9), 1.0)
        raise DataError(
            f"the two do not move as one body: whatever the calibration, {100.0 * share:.0f} % of the"
            f" motion contradict each other, and {n_outliers} of {len(pairs)} intervals stand out; is one of them lost,"
            " or slipping?"
        )
    if n_outliers > _MOST_OUTLIERS * len(pairs):
        turned = off[:, 2] / (pairs.to_s - pairs.from_s)
        raise DataError(
            f"the two do not move as one body: whatever the calibration, {n_outliers} of {len(pairs)} intervals stand"
            f" out, and the rates of turn differ by {math.degrees(float(np.nanmedian(turned))):.2f} deg/s in the middle"
            f" and up to {math.degrees(float(np.nanquantile(np.abs(turned), 0.9))):.2f} deg/s; does a gyro turn at"
            " rest, do the clocks run apart, or is one of them slipping?"
        )


def _prior(pairs: MotionPairs, has_delay: bool) -> Floats:
    """Return how far each number may be from where it starts."""
    prior = PRIOR.copy()
    if has_delay:
        prior[DELAY] = 0.1  # the peak is not a second off
    if pairs.a.measures_way and pairs.b.measures_way:
        prior[BIAS] = 1e-9  # of a gyro alone
    return prior
