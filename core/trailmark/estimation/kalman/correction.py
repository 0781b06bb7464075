"""Absolute estimates: tested against the belief, weighed, and taken; or the belief doubted, when it contradicts all."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Protocol

import numpy as np
import numpy.typing as npt

from trailmark.estimation.kalman.ekf import Moves
from trailmark.estimation.kalman.gate import threshold, weight
from trailmark.estimation.kalman.innovation import Innovation, Measures, nis_of
from trailmark.estimation.kalman.layout import Layout
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.kalman.recovery import agreed_pose, directions_of
from trailmark.estimation.kalman.state import FilterState, Suspect, Verdict
from trailmark.estimation.kalman_config import KalmanConfig

__all__ = ["Correction", "Filter"]

Array = npt.NDArray[np.float64]

# What may be doubted, and how far: position to 1 km, heading to all round [m, rad].
_DOUBTS = ((np.diag([1.0, 1.0, 0.0]), 1e3), (np.diag([0.0, 0.0, 1.0]), math.pi))
_LEAST_DOUBT = 1e-3

# Rejected estimates that are kept of each localizer, and for how long [s].
_MOST_SUSPECTS, _SUSPECT_S = 30, 15.0
# So many times `recover_after` rejections are waited for an agreement, before one alone is believed.
_PATIENCE = 4


class Filter(Protocol):
    """What predicts and updates; filterpy's EKF or UKF."""

    def moved(self, x: Array, covariance: Array, moves: Moves) -> tuple[Array, Array]:
        """Return state and covariance after a motion."""

    def corrected(self, x: Array, covariance: Array, seen: Innovation, measures: Measures) -> tuple[Array, Array]:
        """Return state and covariance after a measurement."""


class Correction:
    """Corrects a filter state with a measurement.

    A measurement that fails its chi-square test is gated: the belief stays. Once a localizer has had `recover_after`
    more rejected than accepted, with no other localizer accepted of late that measures the same directions, it is the
    belief that is doubted. If what was rejected of late agrees on one pose, that pose is the belief from then on. If it
    never measured all directions, or after four times as many rejections without agreement, position and heading are
    each doubted until either alone would make the measurement nothing unusual, and it is taken.
    """

    def __init__(self, config: KalmanConfig, kalman: Filter, layout: Layout) -> None:
        self._recover_after = config.recover_after
        self._support_s = config.support_s
        self._loss_scale = config.loss_scale
        self._filter = kalman
        self._layout = layout

    def corrected(self, state: FilterState, measurement: Measurement) -> FilterState:
        """Return the state after a measurement, with the verdict on it as its last."""
        dof = len(measurement.root)
        before, covariance = state.x, state.covariance
        if before is None or covariance is None:
            return self._begun(state, measurement)
        if measurement.replaces:
            return self._set(state, before, covariance, measurement)
        seen = Innovation(*measurement.innovation(before), covariance)
        trust = measurement.trust
        if trust.gate is not None and seen.nis > threshold(trust.gate, dof):
            return self._rejected(state, before, covariance, measurement, seen)
        weighted = weight(trust.loss, seen.nis, dof, self._loss_scale)
        used = seen if weighted == 1.0 else seen.weighted(weighted, covariance)
        x, covariance = self._filter.corrected(before, covariance, used, measurement)
        return _accepted(state, measurement, x, covariance, seen.jacobian[:, :3], Verdict("accepted", seen.nis, dof))

    def _begun(self, state: FilterState, measurement: Measurement) -> FilterState:
        start = measurement.as_start()
        dof = len(measurement.root)
        if start is None:
            reason = f"the pose is unknown, and this says {dof} of its 3 numbers"
            return replace(state, verdicts=(*state.verdicts, Verdict("unused", None, dof, reason)))
        begun = self._layout.begun(*start)
        return _accepted(state, measurement, *begun, measurement.root, Verdict("accepted", None, dof))

    def _set(self, state: FilterState, x: Array, covariance: Array, measurement: Measurement) -> FilterState:
        start = measurement.as_start()
        assert start is not None
        placed = self._layout.placed(x, covariance, *start)
        state = replace(state, rejected={}, suspects={}, supports={})
        return _accepted(state, measurement, *placed, measurement.root, Verdict("accepted", None, 3))

    def _rejected(
        self, state: FilterState, x: Array, covariance: Array, measurement: Measurement, seen: Innovation
    ) -> FilterState:
        """Return the state after a measurement that fails its test: it stays out, or the belief is wrong."""
        source, dof = measurement.source, len(measurement.root)
        n = min(state.rejected.get(source, 0) + 1, _PATIENCE * self._recover_after)  # who comes to his senses is heard
        suspects = _suspects(state, measurement)
        limit = threshold(measurement.trust.gate or 0.0, dof)
        story = f"NIS {seen.nis:.1f} of {dof} dof, the gate is {limit:.1f}"
        if n < self._recover_after:
            return _gated(state, source, n, suspects, Verdict("gated", seen.nis, dof, _more(story, n)))
        if self._is_supported(state, source, seen.jacobian[:, :3]):
            story = f"{_more(story, n)}, but others support the belief"
            return _gated(state, source, n, suspects, Verdict("gated", seen.nis, dof, story))
        if directions_of(suspects) == 3:
            agreed = agreed_pose(suspects, state.odom, x)
            if agreed is not None:
                story = f"the belief contradicted {n} of late; they agree on another pose, which was taken"
                return self._moved_to(
                    state, x, covariance, agreed, measurement, Verdict("accepted", seen.nis, dof, story)
                )
            if n < _PATIENCE * self._recover_after:
                story = f"{_more(story, n)}, and they do not agree on another pose"
                return _gated(state, source, n, suspects, Verdict("gated", seen.nis, dof, story))
        return self._doubted(state, x, covariance, measurement, seen, n)

    def _moved_to(
        self,
        state: FilterState,
        x: Array,
        covariance: Array,
        agreed: tuple[Array, Array],
        measurement: Measurement,
        verdict: Verdict,
    ) -> FilterState:
        placed = self._layout.placed(x, covariance, *agreed)
        state = replace(state, n_recoveries=state.n_recoveries + 1, rejected={}, suspects={})
        return _accepted(state, measurement, *placed, measurement.root, verdict)

    def _doubted(
        self, state: FilterState, x: Array, covariance: Array, measurement: Measurement, seen: Innovation, n: int
    ) -> FilterState:
        inflated = _inflated(covariance, seen.innovation, seen.jacobian)
        again = Innovation(seen.innovation, seen.jacobian, inflated)
        x, covariance = self._filter.corrected(x, inflated, again, measurement)
        source = measurement.source
        state = replace(
            state,
            n_recoveries=state.n_recoveries + 1,
            rejected={**state.rejected, source: 0},
            suspects={**state.suspects, source: ()},
        )
        story = f"the belief contradicted {n} of late and was doubted"
        verdict = Verdict("accepted", seen.nis, len(measurement.root), story)
        return _accepted(state, measurement, x, covariance, seen.jacobian[:, :3], verdict)

    def _is_supported(self, state: FilterState, source: str, jacobian: Array) -> bool:
        """Return whether other localizers, accepted of late, measure these directions: then the belief is right."""
        directions = [
            rows
            for other, (stamp_s, rows) in state.supports.items()
            if other != source and state.stamp_s - stamp_s <= self._support_s
        ]
        return bool(directions) and _spans(np.vstack(directions), jacobian)


def _more(story: str, n: int) -> str:
    return f"{story}; {n} of late" if n > 1 else story


def _suspects(state: FilterState, measurement: Measurement) -> tuple[Suspect, ...]:
    """Return what was rejected of a localizer of late, this measurement included."""
    since_s = state.stamp_s - _SUSPECT_S
    kept = [one for one in state.suspects.get(measurement.source, ()) if one.stamp_s >= since_s]
    return (*kept[1 - _MOST_SUSPECTS :], Suspect(state.stamp_s, state.odom, measurement))


def _gated(state: FilterState, source: str, n: int, suspects: tuple[Suspect, ...], verdict: Verdict) -> FilterState:
    return replace(
        state,
        rejected={**state.rejected, source: n},
        suspects={**state.suspects, source: suspects},
        verdicts=(*state.verdicts, verdict),
    )


def _accepted(
    state: FilterState, measurement: Measurement, x: Array, covariance: Array, jacobian: Array, verdict: Verdict
) -> FilterState:
    source = measurement.source
    n = state.rejected.get(source)
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
        {**state.rejected, source: n - 1} if n else state.rejected,
        {**state.supports, source: (state.stamp_s, jacobian)},
        state.suspects,
        state.n_recoveries,
        state.left_out,
        state.checks,
        (*state.verdicts, verdict),
    )


def _inflated(covariance: Array, innovation: Array, jacobian: Array) -> Array:
    """Return the covariance of a doubted belief: position and heading each, so far as it explains the innovation.

    Scaled as it is, a covariance would put all doubt where it is large already: a heading that is wrong by 90 deg would
    be mended, and the position that is wrong with it kept.
    """
    doubted = covariance
    for axes, largest in _DOUBTS:
        unit = np.zeros_like(covariance)
        unit[:3, :3] = axes
        unexplained = nis_of(innovation, jacobian, covariance + largest * largest * unit)
        sigma = _LEAST_DOUBT
        while sigma < largest and (
            nis_of(innovation, jacobian, covariance + sigma * sigma * unit) > unexplained + len(innovation)
        ):
            sigma *= 2.0
        doubted = doubted + min(sigma, largest) ** 2 * unit
    return doubted


def _spans(rows: Array, wanted: Array) -> bool:
    """Return whether some directions, in metres and radians, contain others."""
    rank = np.linalg.matrix_rank(_unit(rows), tol=1e-3)
    return bool(np.linalg.matrix_rank(_unit(np.vstack([rows, wanted])), tol=1e-3) == rank)


def _unit(rows: Array) -> Array:
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))
