"""Least squares where both motions are noisy: the numbers, and what a should have said.

Plain least squares would find scales that are too small. What a should have said is
estimated beside the numbers (orthogonal distance regression, Gauss-Newton), with covariances as the localizers state
them, scaled along, across and in turn to what is left.

Noise looks like motion: a straight drive with a noisy gyro seems to turn. The information is therefore taken between a
and b, whose noises are independent: noise cancels, motion does not.
"""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark_calibration.model import LEAST_SCALE, NAMES, TURN, WAY, MotionPairs
from trailmark_calibration.rigid import compose, exp_of

__all__ = ["OUTLIER", "GaussNewton", "scale_covariances"]

#: Chi squares of three numbers beyond this are no noise (one in 100,000).
OUTLIER = 26.0
#: A direction of the numbers is told by motion if its information is so many times what chance makes of noise.
_CERTAIN = 4.0
_N_STEPS, _N_BLOCKS = 40, (24, 48, 10_000)
#: No interval is known better than this [m, rad].
_FLOOR = np.diag([1e-5, 1e-5, 1e-6]) ** 2
#: A direction with more variance was not measured, as along a corridor [m^2, rad^2].
_FREE = 0.5**2


class GaussNewton:
    """Gauss-Newton for one set of pairs.

    Parameters
    ----------
    pairs : MotionPairs
        What the two localizers say of every interval.
    centre, prior : (8,) float64
        Where each number is expected, and how far off it may be, one sigma.

    Attributes
    ----------
    spread : (3,) float64
        Factors of the stated noise, along, across and in turn.
    """

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
            off, weights, true_base = self.linearize(p)
            is_known = np.isfinite(off).all(axis=1)
            used = np.asarray(is_known if rows is None else is_known & rows)
            self._rescale(p, off, used)
            if told is None:
                pairs = self._pairs.where(used)
                told, _ = self._told_directions(pairs, p, self._of(pairs).linearize(p)[1])
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
            change = self._scale * np.clip(told @ step, -0.5, 0.5)
            p = p + _share_of(p, change) * change
            if np.all(np.abs(step) < 0.02 * np.sqrt(np.diag(spread))):
                break
        return p

    def inliers(self, p: Floats, limit: float = OUTLIER) -> Bools:
        """Return which pairs agree with the numbers, up to a chi square, (M,)."""
        off, weights, _ = self.linearize(p)
        return np.asarray(np.nan_to_num(np.einsum("ni,nij,nj->n", off, weights, off), nan=np.inf) < limit)

    def covariance(self, p: Floats, rows: Bools) -> Floats:
        """Return the covariance of the numbers in the directions that motion determines against noise.

        The larger of two for each: of the information, and of how much stretches of the drive, of several lengths,
        contradict each other, which needs no model of the noise. What is not told stays as uncertain as before.
        """
        pairs = self._pairs.where(rows)
        solver = self._of(pairs)
        off, weights, true_base = solver.linearize(p)
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
        by_b = pairs.sensitivities(p, pairs.motions_of_a(p, sensor), rates_of_a=False) * self._scale
        both, of_a, of_b = (
            np.einsum("nik,nij,njl->kl", one, weights, other)
            for one, other in ((by_a, by_b), (by_a, by_a), (by_b, by_b))
        )
        values, vectors = np.linalg.eigh((both + both.T) / 2.0)
        noises = [np.maximum(np.einsum("ik,ij,jk->k", vectors, of, vectors) - values, 0.0) for of in (of_a, of_b)]
        chance = np.sqrt(noises[0] * noises[1] / max(len(weights), 1))  # without pairs nothing is told
        rows = values > np.maximum(_CERTAIN * chance, 1.0)
        return vectors[:, rows], 1.0 / (1.0 + values[rows])

    def _of(self, pairs: MotionPairs) -> GaussNewton:
        """Return a solver of other pairs with the same noise."""
        other = GaussNewton(pairs, self._centre, self._scale)
        other.spread = self.spread
        return other

    def linearize(self, p: Floats) -> tuple[Floats, Floats, Floats]:
        """Return what is left (M, 3), its inverse covariance (M, 3, 3), and what a should have said (M, 3)."""
        pairs = self._pairs
        off = pairs.residuals(p)
        gain = pairs.gain(p)
        share = scale_covariances(gain @ pairs.covariances_a @ gain.T, self.spread)
        # What reading adds is also in what is left, by which the noise is scaled: together they are never too little.
        noise = share + scale_covariances(pairs.covariances_b, self.spread)
        weights = np.linalg.inv(noise + pairs.reading_covariances(p) + _FLOOR)
        moved = np.einsum("nij,njk,nk->ni", share, weights, off) @ np.linalg.inv(gain).T
        base, _ = pairs.motions(p, is_corrected=False)
        return off, weights, compose(base, exp_of(moved))

    def _rescale(self, p: Floats, off: Floats, used: Bools) -> None:
        """Set the factors of the stated noise by the median of what is left."""
        gain = self._pairs.gain(p)
        stated = (gain @ self._pairs.covariances_a @ gain.T + self._pairs.covariances_b)[used]
        for axis in range(3):
            variance = stated[:, axis, axis]
            rows = variance < _FREE
            if rows.sum() >= 10:
                ratio = np.abs(off[used][rows, axis]) / np.sqrt(variance[rows])
                self.spread[axis] = max(1.4826 * float(np.median(ratio)), 1e-6)


def _share_of(p: Floats, change: Floats) -> float:
    """Return the share of a change by which each scale goes at most half of its way to the least one.

    Steps of full length from 1 would meet 0 exactly, where the motions of a say nothing; and the start knows the sign.
    """
    scales, falls = np.abs(p[[WAY, TURN]]), -change[[WAY, TURN]] * np.sign(p[[WAY, TURN]])
    room = np.maximum(scales - LEAST_SCALE, 0.0) / 2.0
    return float(np.min(np.where(falls > room, room / np.maximum(falls, 1e-300), 1.0)))


def scale_covariances(covariances: Floats, spread: Floats) -> Floats:
    """Return covariances with factors of the noise along, across and in turn.

    A direction that was not measured stays the one it is: it slants to the axes, and factors would turn it.

    Parameters
    ----------
    covariances : (M, 3, 3) float64
        Of motions, [m^2, m^2, rad^2] on the diagonal.
    spread : (3,) float64
        The factors of standard deviations.
    """
    D = np.diag(spread)
    scaled = D @ covariances @ D
    rows = np.trace(covariances, axis1=1, axis2=2) > _FREE
    if rows.any():
        values, vectors = np.linalg.eigh(covariances[rows])
        told, free = (np.where(kind, values, 0.0) for kind in (values <= _FREE, values > _FREE))
        told, free = (np.einsum("nik,nk,njk->nij", vectors, one, vectors) for one in (told, free))
        scaled[rows] = D @ told @ D + free
    return np.asarray(scaled)
