"""Absolute estimates: tested against the belief, weighed, and taken; or the belief doubted, when it contradicts all."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from trailmark.estimation.kalman.ekf import PoseEkf
from trailmark.estimation.kalman.gate import threshold, weight
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.kalman.state import FilterState, Verdict
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.symmetric import Sym3, inverse, to_matrix

__all__ = ["Correction", "nis_of"]

Array = npt.NDArray[np.float64]

# What may be doubted, and how far: position to 1 km, heading to all round [m, rad].
_DOUBTS = ((np.diag([1.0, 1.0, 0.0]), 1e3), (np.diag([0.0, 0.0, 1.0]), math.pi))
_LEAST_DOUBT = 1e-3


class Correction:
    """Corrects a filter state with a measurement.

    A measurement that fails its chi-square test is gated: the belief stays. After `recover_after` failures of one
    localizer in a row, with no other localizer accepted of late that measures the same directions, it is the belief
    that is doubted: position and heading each, until either alone would make the measurement nothing unusual. Then the
    measurement is taken.
    """

    def __init__(self, config: KalmanConfig, ekf: PoseEkf) -> None:
        self._recover_after = config.recover_after
        self._support_s = config.support_s
        self._loss_scale = config.loss_scale
        self._ekf = ekf

    def corrected(self, state: FilterState, measurement: Measurement) -> FilterState:
        """Return the state after a measurement, with the verdict on it as its last."""
        dof = len(measurement.root)
        before, covariance, story = state.x, state.covariance, ""
        if before is None or covariance is None:
            return self._begun(state, measurement)
        innovation, jacobian = measurement.innovation(before)
        nis = nis_of(innovation, jacobian, covariance)
        trust = measurement.trust
        if trust.gate is not None and nis > threshold(trust.gate, dof):
            n = state.rejected.get(measurement.source, 0) + 1
            story = self._story(state, measurement, jacobian, n)
            if story:
                reason = f"NIS {nis:.1f} of {dof} dof, the gate is {threshold(trust.gate, dof):.1f}{story}"
                return _gated(state, measurement.source, n, Verdict("gated", nis, dof, reason))
            covariance = _inflated(covariance, innovation, jacobian)
            story = f"the belief contradicted {n} in a row and was doubted"
            state = replace(state, n_recoveries=state.n_recoveries + 1)
        weighted = weight(trust.loss, nis, dof, self._loss_scale)
        if weighted != 1.0:
            root = math.sqrt(weighted)
            innovation, jacobian = root * innovation, root * jacobian
        x, covariance = self._ekf.corrected(before, covariance, innovation, jacobian)
        return _accepted(state, measurement, x, covariance, jacobian, Verdict("accepted", nis, dof, story))

    def _begun(self, state: FilterState, measurement: Measurement) -> FilterState:
        start = measurement.as_start()
        dof = len(measurement.root)
        if start is None:
            reason = f"the pose is unknown, and this says {dof} of its 3 numbers"
            return replace(state, verdicts=(*state.verdicts, Verdict("unused", None, dof, reason)))
        return _accepted(state, measurement, *start, measurement.root, Verdict("accepted", None, dof))

    def _story(self, state: FilterState, measurement: Measurement, jacobian: Array, n: int) -> str:
        """Return why a failed measurement stays out; empty when the belief is to be doubted instead."""
        if n < self._recover_after:
            return f"; {n} in a row" if n > 1 else " "
        directions = [
            rows
            for source, (stamp_s, rows) in state.supports.items()
            if source != measurement.source and state.stamp_s - stamp_s <= self._support_s
        ]
        if directions and _spans(np.vstack(directions), jacobian):
            return f"; {n} in a row, but others support the belief"
        return ""


def nis_of(innovation: Array, jacobian: Array, covariance: Array) -> float:
    """Return ``y^T S^-1 y`` with ``S = H P H^T + 1``, before any update (filterpy knows it only after).

    In plain floats: with one or two rows the others are those of a measurement that agrees.
    """
    y0, y1, y2 = (*innovation.tolist(), 0.0, 0.0)[:3]
    spread = (jacobian @ covariance @ jacobian.T).ravel().tolist()
    if len(spread) == 1:
        return float(y0 * y0 / (spread[0] + 1.0))
    if len(spread) == 4:
        xx, xy, _, yy = spread
        s: Sym3 = (xx + 1.0, xy, 0.0, yy + 1.0, 0.0, 1.0)
    else:
        xx, xy, xt, _, yy, yt, _, _, tt = spread
        s = (xx + 1.0, xy, xt, yy + 1.0, yt, tt + 1.0)
    inverted = inverse(s)
    if inverted is None:  # one direction is 1e12 times less certain than another
        size = len(innovation)
        return float(innovation @ np.linalg.solve(to_matrix(s)[:size, :size], innovation))
    xx, xy, xt, yy, yt, tt = inverted
    return float(xx * y0 * y0 + yy * y1 * y1 + tt * y2 * y2 + 2.0 * (xy * y0 * y1 + xt * y0 * y2 + yt * y1 * y2))


def _gated(state: FilterState, source: str, n: int, verdict: Verdict) -> FilterState:
    return replace(state, rejected={**state.rejected, source: n}, verdicts=(*state.verdicts, verdict))


def _accepted(
    state: FilterState, measurement: Measurement, x: Array, covariance: Array, jacobian: Array, verdict: Verdict
) -> FilterState:
    source = measurement.source
    rejected = {**state.rejected, source: 0} if state.rejected.get(source) else state.rejected
    return FilterState(
        state.stamp_s,
        x,
        covariance,
        state.twist,
        state.gap_s,
        state.is_measured,
        state.has_moved,
        state.odom,
        state.travelled_m,
        state.travelled_m,
        rejected,
        {**state.supports, source: (state.stamp_s, jacobian)},
        state.n_recoveries,
        (*state.verdicts, verdict),
    )


def _inflated(covariance: Array, innovation: Array, jacobian: Array) -> Array:
    """Return the covariance of a doubted belief: position and heading each, so far as it explains the innovation.

    Scaled as it is, a covariance would put all doubt where it is large already: a heading that is wrong by 90 deg would
    be mended, and the position that is wrong with it kept.
    """
    doubted = covariance
    for axes, largest in _DOUBTS:
        unexplained = nis_of(innovation, jacobian, covariance + largest * largest * axes)
        sigma = _LEAST_DOUBT
        while sigma < largest and (
            nis_of(innovation, jacobian, covariance + sigma * sigma * axes) > unexplained + len(innovation)
        ):
            sigma *= 2.0
        doubted = doubted + min(sigma, largest) ** 2 * axes
    return doubted


def _spans(rows: Array, wanted: Array) -> bool:
    """Return whether some directions, in metres and radians, contain others."""
    rank = np.linalg.matrix_rank(_unit(rows), tol=1e-3)
    return bool(np.linalg.matrix_rank(_unit(np.vstack([rows, wanted])), tol=1e-3) == rank)


def _unit(rows: Array) -> Array:
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))
