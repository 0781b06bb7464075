"""The joint fit: all numbers at once, outliers left out, each with what the drive says of it.

Both motions are noisy, so that plain least squares would find scales that are too small. What a should have said is
estimated beside the numbers (orthogonal distance regression, Gauss-Newton), with covariances as the localizers state
them, scaled along, across and in turn to what is left.

Noise looks like motion: a straight drive with a noisy gyro seems to turn. The information is therefore taken between a
and b, whose noises are independent: noise cancels, motion does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.errors import DataError
from trailmark_calibration.model import BIAS, DELAY, NAMES, MotionPairs
from trailmark_calibration.rigid import compose, exp_of
from trailmark_calibration.starting import correlated_delay, delay_peaks, starting_point
from trailmark_calibration.tracks import UNKNOWN_VARIANCE

__all__ = ["LIMITS", "Fit", "KnownPlacement", "cost_of", "fit", "fit_from", "values_of_all", "weights_of"]

#: What a config may be wrong by, one sigma, before the drive is looked at: in the order of `NAMES`.
_PRIOR = np.array([0.5, 0.5, 0.2, 1.0, 1.0, 3.0, 0.5, 0.05])
#: KnownPlacement worse than this, one sigma, a number is not told.
LIMITS = np.array([0.02, 0.02, math.radians(1.0), 0.03, 0.03, math.radians(2.0), 0.03, math.radians(0.1)])
#: A direction of the numbers is told by motion if its information is so many times what chance makes of noise.
_CERTAIN = 4.0
#: Chi squares of three numbers beyond this are no noise (one in 100,000).
_OUTLIER = 26.0
#: More of them than this, and the two do not move as one body.
_MOST_OUTLIERS = 0.3
#: Nor if so much of the motion is left over that one of them does not explain.
_MOST_LEFT = 0.3
_N_STEPS, _N_BLOCKS = 40, (24, 48, 10_000)
#: So many peaks of the correlation are tried where none stands out.
_N_STARTS = 6
#: No interval is known better than this [m, rad].
_FLOOR = np.diag([1e-5, 1e-5, 1e-6]) ** 2


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
    solver = _Solver(pairs, start, _prior(pairs, delay_s is not None))
    p = solver.solve(start, None)
    rows = solver.inliers(p)
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
    solver = _Solver(pairs, found.values, _prior(pairs, has_delay=True))
    return solver.solve(found.values, np.ones(len(pairs), dtype=bool))


def weights_of(pairs: MotionPairs, p: Floats, spread: Floats) -> tuple[Floats, Floats, Floats]:
    """Return what is left (M, 3), its inverse covariance (M, 3, 3), and what a should have said (M, 3)."""
    solver = _Solver(pairs, p, _PRIOR)
    solver.spread = spread
    return solver.linearized(p)


def cost_of(pairs: MotionPairs, p: Floats, spread: Floats) -> Floats:
    """Return the chi square of every interval, (M,), an outlier's as that of the smallest one; NaN where not known."""
    off, weights, _ = weights_of(pairs, p, spread)
    return np.asarray(np.minimum(np.einsum("ni,nij,nj->n", off, weights, off), _OUTLIER))


def _mean_cost(pairs: MotionPairs, found: Fit, spread: Floats) -> float:
    return float(np.nanmean(cost_of(pairs, found.values, spread)))


def _refuse_two_bodies(pairs: MotionPairs, p: Floats, n_outliers: int) -> None:
    """Raise where too much is left over: of all intervals, or of the motion in most of them."""
    off = pairs.residuals(p)
    _, moved = pairs.motions(p)
    columns = [0, 1] if pairs.a.measures_way and pairs.b.measures_way else [2]
    left, whole = (np.nanquantile(np.linalg.norm(one[:, columns], axis=1), 0.75) for one in (off, moved))
    if left > _MOST_LEFT * whole:
        raise DataError(
            f"the two do not move as one body: whatever the calibration, {100.0 * left / max(whole, 1e-9):.0f} % of the"
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
    prior = _PRIOR.copy()
    if has_delay:
        prior[DELAY] = 0.1  # the peak is not a second off
    if pairs.a.measures_way and pairs.b.measures_way:
        prior[BIAS] = 1e-9  # of a gyro alone
    return prior


class _Solver:
    """Gauss-Newton for one set of pairs; `spread` is the factor of the stated noise, per axis."""

    def __init__(self, pairs: MotionPairs, centre: Floats, prior: Floats) -> None:
        self._pairs = pairs
        self._centre = centre
        self._scale = prior
        self.spread = np.ones(3)

    def solve(self, p: Floats, rows: Bools | None) -> Floats:
        """Return the numbers of least error over some rows; None: over all, each the less the farther it is off.

        Only directions that motion tells are changed: noise would draw the others anywhere.
        """
        told: Floats | None = None
        for _ in range(_N_STEPS):
            off, weights, true_base = self.linearized(p)
            is_known = np.isfinite(off).all(axis=1)
            used = np.asarray(is_known if rows is None else is_known & rows)
            self._rescale(p, off, used)
            if told is None:
                pairs = self._pairs.where(used)
                told, _ = self._told_directions(pairs, p, self._of(pairs).linearized(p)[1])
                if not told.shape[1]:
                    return p
            distance = np.einsum("ni,nij,nj->n", off, weights, off)
            trust = np.where(used, 1.0 / (1.0 + distance / 9.0) if rows is None else 1.0, 0.0)
            off, weights = np.nan_to_num(off), np.nan_to_num(weights) * np.nan_to_num(trust)[:, None, None]
            J = np.nan_to_num(self._pairs.sensitivities(p, true_base)) * self._scale @ told
            JW = np.einsum("nik,nij->nkj", J, weights)
            spread = np.linalg.inv(np.einsum("nki,nij->kj", JW, J) + np.eye(told.shape[1]))
            pull = told.T @ ((p - self._centre) / self._scale)
            step = spread @ (np.einsum("nki,ni->k", JW, off) - pull)
            p = p + self._scale * np.clip(told @ step, -0.5, 0.5)
            if np.all(np.abs(step) < 0.02 * np.sqrt(np.diag(spread))):
                break
        return p

    def inliers(self, p: Floats) -> Bools:
        """Return which pairs agree with the numbers, (M,)."""
        off, weights, _ = self.linearized(p)
        return np.asarray(np.nan_to_num(np.einsum("ni,nij,nj->n", off, weights, off), nan=np.inf) < _OUTLIER)

    def covariance(self, p: Floats, rows: Bools) -> Floats:
        """Return the covariance of the numbers in the directions that motion determines against noise.

        The larger of two for each: of the information, and of how much stretches of the drive, of several lengths,
        contradict each other, which needs no model of the noise. What is not told stays as uncertain as before.
        """
        pairs = self._pairs.where(rows)
        solver = self._of(pairs)
        off, weights, true_base = solver.linearized(p)
        told, variances = self._told_directions(pairs, p, weights)
        J = pairs.sensitivities(p, true_base) * self._scale
        scores = np.einsum("nik,nij,nj->nk", J, weights, off) @ told * variances
        factors = np.ones(told.shape[1])
        for n_blocks in {min(n, len(off) // 3) for n in _N_BLOCKS}:
            sums = np.array([block.sum(axis=0) for block in np.array_split(scores, n_blocks)])
            scatter = (sums**2).sum(axis=0) * n_blocks / max(n_blocks - len(NAMES), 1)
            factors = np.maximum(factors, scatter / variances)
        untold = np.eye(len(NAMES)) - told @ told.T
        covariance = told * (variances * factors) @ told.T + untold
        return np.asarray(covariance * np.outer(self._scale, self._scale))

    def _told_directions(self, pairs: MotionPairs, p: Floats, weights: Floats) -> tuple[Floats, Floats]:
        """Return the directions of the numbers that motion determines, (8, K), and the variances along them, (K,).

        In units of what the config may be wrong by. Along each, the information between a and b must be so much that
        their noises, each the rest of its own information, cannot have made it by chance.
        """
        base, sensor = pairs.motions(p, is_corrected=False)
        by_a = pairs.sensitivities(p, base, rates_of_a=True) * self._scale
        by_b = pairs.sensitivities(p, pairs.uncorrected(p, sensor), rates_of_a=False) * self._scale
        both, of_a, of_b = (
            np.einsum("nik,nij,njl->kl", one, weights, other)
            for one, other in ((by_a, by_b), (by_a, by_a), (by_b, by_b))
        )
        values, vectors = np.linalg.eigh((both + both.T) / 2.0)
        noises = [np.maximum(np.einsum("ik,ij,jk->k", vectors, of, vectors) - values, 0.0) for of in (of_a, of_b)]
        chance = np.sqrt(noises[0] * noises[1] / len(weights))
        rows = values > np.maximum(_CERTAIN * chance, 1.0)
        return vectors[:, rows], 1.0 / (1.0 + values[rows])

    def _of(self, pairs: MotionPairs) -> _Solver:
        """Return a solver of other pairs with the same noise."""
        other = _Solver(pairs, self._centre, self._scale)
        other.spread = self.spread
        return other

    def linearized(self, p: Floats) -> tuple[Floats, Floats, Floats]:
        """Return what is left (M, 3), its inverse covariance (M, 3, 3), and what a should have said (M, 3)."""
        pairs = self._pairs
        off = pairs.residuals(p)
        D = np.diag(self.spread)
        gain = pairs.gain(p)
        of_a = gain @ pairs.covariances_a @ gain.T
        total = D @ (of_a + pairs.covariances_b) @ D + _FLOOR
        weights = np.linalg.inv(total)
        share = D @ of_a @ D
        moved = np.einsum("nij,njk,nk->ni", share, weights, off) @ np.linalg.inv(gain).T
        base, _ = pairs.motions(p, is_corrected=False)
        return off, weights, compose(base, exp_of(moved))

    def _rescale(self, p: Floats, off: Floats, used: Bools) -> None:
        """Set the factors of the stated noise by the median of what is left."""
        gain = self._pairs.gain(p)
        stated = (gain @ self._pairs.covariances_a @ gain.T + self._pairs.covariances_b)[used]
        for axis in range(3):
            variance = stated[:, axis, axis]
            rows = variance < 0.01 * UNKNOWN_VARIANCE
            if rows.sum() >= 10:
                ratio = np.abs(off[used][rows, axis]) / np.sqrt(variance[rows])
                self.spread[axis] = max(1.4826 * float(np.median(ratio)), 1e-6)
