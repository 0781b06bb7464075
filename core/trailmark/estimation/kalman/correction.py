"""Absolute estimates: tested against the belief, weighted, and used; or the belief given up for them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Protocol

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.correlated_fixes import share_of_news
from trailmark.estimation.kalman.ekf import PredictedMotion
from trailmark.estimation.kalman.gate import threshold, weight
from trailmark.estimation.kalman.innovation import Innovation, MeasurementModel, nis_of
from trailmark.estimation.kalman.lasting_errors import (
    NO_ERRORS,
    UNAFFECTED,
    LastingPrior,
    LastingVariances,
    correct_columns,
    lasting_covariance,
)
from trailmark.estimation.kalman.layout import Layout
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.kalman.moved_belief import moved_to, still_moved
from trailmark.estimation.kalman.recovery_policy import Keep, RecoveryPolicy, Relocate
from trailmark.estimation.kalman.state import (
    CorroboratingFix,
    FilterState,
    Gaussian,
    RejectedMeasurement,
    Rejections,
    Verdict,
)
from trailmark.estimation.kalman.way_errors import added_errors, errors_said_by, less_when_unneeded
from trailmark.estimation.kalman.ways_of_fixes import with_heard
from trailmark.estimation.kalman.windows import LONGEST_S
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.unmeasured import NOWHERE, Sym2, directions_above, projected, turned
from trailmark.geometry import wrap_angle

__all__ = ["Correction", "Filter", "innovation_of"]

# What may be doubted, and how far: position to 1 km, heading to all round [m, rad].
_DOUBTS = ((np.diag([1.0, 1.0, 0.0]), 1e3), (np.diag([0.0, 0.0, 1.0]), math.pi))
_LEAST_DOUBT = 1e-3

# With which one that is not believed agrees again, if it has no gate.
_GATE = 0.999
# Rejected measurements that are kept of each localizer, and for how long [s].
_MOST_REJECTED, _REJECTED_S = 30, 15.0
# Error of a line or a circle's tangent that was laid at another place, as a share of the distance.
_LAID_ELSEWHERE = 0.25
# Of the share of measurements that is rejected: what one changes, and what is as good as none.
_SHARE_GAIN, _LEAST_SHARE = 0.1, 0.01
# Standard deviation of an absolute estimate that says too little of a direction for its speed to show [m].
_VAGUE_M = 5.0


class Filter(Protocol):
    """The arithmetic of prediction and update: `Ekf` or `Ukf`."""

    def predict(self, x: Floats, covariance: Floats, motion: PredictedMotion) -> tuple[Floats, Floats]:
        """Return state and covariance after a motion."""

    def update(self, x: Floats, covariance: Floats, seen: Innovation, model: MeasurementModel) -> tuple[Floats, Floats]:
        """Return state and covariance after a measurement."""


class Correction:
    """Corrects a filter state with a measurement.

    A measurement that fails its chi-square test is gated: the belief stays. `RecoveryPolicy` says when many of them
    outweigh the belief.
    """

    def __init__(self, config: KalmanConfig, kalman: Filter, layout: Layout) -> None:
        self._policy = RecoveryPolicy(config.recover_after, config.support_s)
        self._loss_scale = config.loss_scale
        self._filter = kalman
        self._layout = layout
        self._lasting = LastingPrior.of(config)

    def correct(self, state: FilterState, measurement: Measurement, seen: Innovation | None = None) -> FilterState:
        """Return the state after a measurement, with the verdict on it as its last.

        Its innovation, if it is known already, need not be computed anew.
        """
        before, dof = state.gaussian, len(measurement.root)
        if before is None:
            return self._start(state, measurement)
        if measurement.replaces:
            return self._replace_pose(state, before, measurement)
        if seen is None:
            seen = Innovation(*measurement.innovation(before.x), before.covariance)
        gate = measurement.trust.gate
        if gate is not None and seen.nis > threshold(gate, dof):
            return self._reject(state, before, measurement, seen)
        used = self._weighted(state, measurement, seen)
        updated = self._filter.update(before.x, before.covariance, used, measurement)
        after = Gaussian(*updated, correct_columns(before.lasting, used.pose_gain()))
        verdict = Verdict("accepted", seen.nis, dof, seen=seen, used=used)
        return _accept(state, measurement, after, seen.jacobian[:, :3], verdict)

    def considered(self, state: FilterState, measurement: Measurement) -> tuple[FilterState, LastingVariances]:
        """Return a state with the lasting errors of motion in its covariance, where a measurement fits only then.

        That is after a way without absolute estimates: where some were accepted of late these errors are small, and who
        is wrong is a question. Their variances come with it: none where they are not in the covariance.
        """
        before, gate = state.gaussian, measurement.trust.gate
        if before is None or gate is None:
            return state, NO_ERRORS
        way_errors, rejected = state.diagnosis.way_errors, state.rejections.measurements.get(measurement.source)
        agreed_s = max((one.stamp_s for one in state.rejections.corroborations.values()), default=-math.inf)
        is_late = state.stamp_s - agreed_s > LONGEST_S
        if not is_late and not any(way_errors):
            return state, NO_ERRORS
        innovation, jacobian = measurement.innovation(before.x)
        covariance, limit = before.covariance.copy(), threshold(gate, len(innovation))
        prior = self._lasting.with_parting(state.diagnosis.parting.variances, state.diagnosis.sums)
        if any(way_errors):
            way_errors = less_when_unneeded(state, measurement, prior, limit)
            state = state.with_diagnosis(state.diagnosis._replace(way_errors=way_errors))
        if nis_of(innovation, jacobian, before.covariance) <= limit:
            return state, NO_ERRORS
        variances = prior.plus(way_errors)
        covariance[:3, :3] += lasting_covariance(before.lasting, variances)
        if nis_of(innovation, jacobian, covariance) > limit:
            if not rejected or rejected[-1].stamp_s < agreed_s or len(rejected[-1].measurement.root) < 3:
                return state, NO_ERRORS
            said = errors_said_by(state, measurement, rejected[-1], limit)
            covariance[:3, :3] += lasting_covariance(before.lasting, said)
            if not any(said) or nis_of(innovation, jacobian, covariance) > limit:
                return state, NO_ERRORS
            variances = variances.plus(said)
            state = state.with_diagnosis(state.diagnosis._replace(way_errors=added_errors(way_errors, said)))
        return replace(state, gaussian=Gaussian(before.x, covariance, before.lasting)), variances

    def without_considered(self, before: FilterState, after: FilterState, variances: LastingVariances) -> FilterState:
        """Return a state after a measurement that lasting errors in the covariance have weighed, without them.

        What the measurement leaves of them is in how the pose changes with them: it counts once, and goes on with the
        way as the same errors. Were it left in the covariance, later ones would count as others.
        """
        used = after.verdicts[-1].used
        if used is None or before.gaussian is None or after.gaussian is None or not any(variances):
            return after
        covariance = after.gaussian.covariance
        left = (np.eye(len(covariance)) - used.gain() @ used.jacobian)[:, :3]
        covariance = covariance - left @ lasting_covariance(before.gaussian.lasting, variances) @ left.T
        return replace(after, gaussian=Gaussian(after.gaussian.x, covariance, after.gaussian.lasting))

    def doubt(self, state: FilterState, measurement: Measurement) -> FilterState:
        """Return the state after a measurement of a localizer whose absolute estimates are not believed.

        It is kept out, and counted is whether it agrees with the belief.
        """
        source, dof, nis = measurement.source, len(measurement.root), math.inf
        fault = state.diagnosis.absolute_faults[source]
        if state.gaussian is not None:
            nis = Innovation(*measurement.innovation(state.gaussian.x), state.gaussian.covariance).nis
        agrees = nis <= threshold(measurement.trust.gate or _GATE, dof)
        n = min(state.rejections.counts.get(source, 0) + 1, self._policy.most_rejections)
        rejected = _with_rejected(state, measurement)
        fault = replace(
            fault,
            n_agreed=fault.n_agreed + 1 if agrees else 0,
            agreed_since_s=fault.agreed_since_s if fault.n_agreed else state.stamp_s,
            heard=with_heard(fault.heard, rejected[-1]) if fault.is_drawn else (),
        )
        faults = {**state.diagnosis.absolute_faults, source: fault}
        state = replace(state, diagnosis=state.diagnosis._replace(absolute_faults=faults))
        return _keep_out(state, source, n, rejected, Verdict("gated", nis, dof, fault.reason))

    def _weighted(self, state: FilterState, measurement: Measurement, seen: Innovation) -> Innovation:
        """Return an innovation with the weight that a robust loss leaves it, and what of it is new."""
        share: float | Floats = weight(measurement.trust.loss, seen.nis, len(measurement.root), self._loss_scale)
        last = state.rejections.corroborations.get(measurement.source) if measurement.correlation_s > 0.0 else None
        if last is not None:
            share = share * share_of_news(state.stamp_s - last.stamp_s, measurement.correlation_s, seen.spread)
        assert state.gaussian is not None
        return seen if isinstance(share, float) and share == 1.0 else seen.weighted(share, state.gaussian.covariance)

    def _start(self, state: FilterState, measurement: Measurement) -> FilterState:
        pose = measurement.as_start()
        dof = len(measurement.root)
        if pose is None:
            reason = f"the pose is unknown, and this says {dof} of its 3 numbers"
            return replace(state, verdicts=(*state.verdicts, Verdict("unused", None, dof, reason)))
        begun = Gaussian(*self._layout.initial_state(*pose), UNAFFECTED)
        return _accept(state, measurement, begun, measurement.root, Verdict("accepted", None, dof))

    def _replace_pose(self, state: FilterState, before: Gaussian, measurement: Measurement) -> FilterState:
        pose = measurement.as_start()
        assert pose is not None
        placed = Gaussian(*self._layout.with_pose(before.x, before.covariance, *pose), UNAFFECTED)
        state = replace(state, rejections=Rejections(n_recoveries=state.rejections.n_recoveries))
        return _accept(state, measurement, placed, measurement.root, Verdict("accepted", None, 3))

    def _reject(self, state: FilterState, before: Gaussian, measurement: Measurement, seen: Innovation) -> FilterState:
        """Return the state after a measurement that fails its test."""
        source, dof = measurement.source, len(measurement.root)
        n = min(state.rejections.counts.get(source, 0) + 1, self._policy.most_rejections)
        rejected = _with_rejected(state, measurement)
        decision = self._policy.decide(state, source, rejected, seen.jacobian[:, :3], n)
        if isinstance(decision, Keep):
            limit = threshold(measurement.trust.gate or 0.0, dof)
            message = f"NIS {seen.nis:.1f} of {dof} dof, the gate is {limit:.1f}"
            message += f"; {n} of late" if n > 1 else ""
            message += f", {decision.reason}" if decision.reason else ""
            return _keep_out(state, source, n, rejected, Verdict("gated", seen.nis, dof, message))
        if isinstance(decision, Relocate):
            covariance = decision.covariance
            if dof < 3:
                covariance = covariance + _doubt_of_parts(decision.pose - before.x[:3])
            placed = self._layout.with_pose(before.x, before.covariance, decision.pose, covariance)
            after = Gaussian(*placed, UNAFFECTED)  # the whole pose is another: motion led nowhere to it
            message = f"the belief contradicted {n} of late; they agree on another pose, which was taken"
            # Parts of poses were made with a belief that was wrong, so they stay in doubt until more of them agree.
            counts, kept, directions = {}, {} if dof == 3 else {source: rejected}, measurement.root
        else:
            inflated = _inflated(before.covariance, seen.innovation, seen.jacobian)
            again = Innovation(seen.innovation, seen.jacobian, inflated)
            doubted = self._filter.update(before.x, inflated, again, measurement)
            after = Gaussian(*doubted, correct_columns(before.lasting, again.pose_gain()))
            message = f"the belief contradicted {n} of late and was doubted"
            # What fits no pose is in doubt until it fits again; a part of one is taken at its word.
            is_in_doubt = dof == 3
            counts = {**state.rejections.counts, source: self._policy.recover_after if is_in_doubt else 0}
            kept = {**state.rejections.measurements, source: rejected if is_in_doubt else ()}
            directions = seen.jacobian[:, :3]
        recovered = Rejections(
            counts=counts,
            measurements=kept,
            corroborations=state.rejections.corroborations,
            n_recoveries=state.rejections.n_recoveries + 1,
            shares=_with_share(state.rejections.shares, source, is_rejected=True),
            moved=moved_to(state, source, rejected[0].stamp_s, after),
        )
        state = replace(state, rejections=recovered)
        return _accept(state, measurement, after, directions, Verdict("accepted", seen.nis, dof, message))


def innovation_of(state: FilterState, measurement: Measurement) -> Innovation | None:
    """Return what a measurement says against a state; None while the pose is unknown."""
    if state.gaussian is None:
        return None
    return Innovation(*measurement.innovation(state.gaussian.x), state.gaussian.covariance)


def _with_rejected(state: FilterState, measurement: Measurement) -> tuple[RejectedMeasurement, ...]:
    """Return what was rejected of a localizer of late, this measurement included."""
    since_s = state.stamp_s - _REJECTED_S
    before = state.rejections.measurements.get(measurement.source, ())
    kept = [one for one in before if one.stamp_s >= since_s]
    lasting = UNAFFECTED if state.gaussian is None else state.gaussian.lasting
    last = RejectedMeasurement(state.stamp_s, state.odometry.pose_odom_base, measurement, lasting)
    return (*kept[1 - _MOST_REJECTED :], last)


def _keep_out(
    state: FilterState, source: str, n: int, rejected: tuple[RejectedMeasurement, ...], verdict: Verdict
) -> FilterState:
    before = state.rejections
    rejections = Rejections(
        counts={**before.counts, source: n},
        measurements={**before.measurements, source: rejected},
        corroborations=before.corroborations,
        n_recoveries=before.n_recoveries,
        shares=_with_share(before.shares, source, is_rejected=True),
        moved=before.moved,
        was_confirmed=before.was_confirmed,
    )
    return replace(state, rejections=rejections, verdicts=(*state.verdicts, verdict))


def _doubt_of_parts(moved: Floats) -> Floats:
    """Return how uncertain a pose is, (3, 3), that parts of poses agree on: they are lines laid where it was not."""
    away_m, turn_rad = math.hypot(moved[0], moved[1]), wrap_angle(float(moved[2]))
    return _LAID_ELSEWHERE**2 * np.diag([away_m**2, away_m**2, turn_rad**2])


def _with_share(shares: Mapping[str, float], source: str, *, is_rejected: bool) -> Mapping[str, float]:
    share = shares.get(source, 0.0)
    share += _SHARE_GAIN * (is_rejected - share)
    if share > _LEAST_SHARE:
        return {**shares, source: share}
    return {other: share for other, share in shares.items() if other != source}


def _accept(
    state: FilterState, measurement: Measurement, after: Gaussian, directions: Floats, verdict: Verdict
) -> FilterState:
    source, before = measurement.source, state.rejections
    n = before.counts.get(source)
    odometry = state.odometry
    if odometry.unmeasured_s is not NOWHERE:
        turn = odometry.pose_odom_base.theta - float(after.x[2])
        odometry = odometry.with_unmeasured(_still_unmeasured(odometry.unmeasured_s, directions, turn))
    rejections = Rejections(  # by place: names take a third of the time more
        {**before.counts, source: n - 1} if n else before.counts,
        before.measurements,
        {**before.corroborations, source: CorroboratingFix(state.stamp_s, directions)},
        before.n_recoveries,
        _with_share(before.shares, source, is_rejected=False) if before.shares else before.shares,
        before.moved and still_moved(state, measurement),
        True,
    )
    return FilterState(
        state.stamp_s,
        after,
        odometry,
        odometry.travelled_m,
        rejections,
        state.diagnosis,
        state.left_out,
        state.checks,
        (*state.verdicts, verdict),
    )


def _still_unmeasured(unmeasured_s: Sym2, directions: Floats, turn_rad: float) -> Sym2:
    """Return for how long nobody has measured the way, after an absolute estimate has measured some directions.

    Parameters
    ----------
    unmeasured_s : Sym2
        Before it, by direction in odom [s].
    directions : (k, 3) float64
        Rows of its Jacobian, for unit noise.
    turn_rad : float
        Of the map as seen in odom [rad].
    """
    if len(directions) == 1:  # a compass, a line: the same to the last bit
        x, y = directions[0, :2].tolist()
        xx, xy, yy = x * x, x * y, y * y
    else:
        (xx, xy), (_, yy) = (directions[:, :2].T @ directions[:, :2]).tolist()
    measured = turned(directions_above((xx, xy, yy), _VAGUE_M**-2), turn_rad)
    return projected(unmeasured_s, (1.0 - measured[0], -measured[1], 1.0 - measured[2]))


def _inflated(covariance: Floats, innovation: Floats, jacobian: Floats) -> Floats:
    """Return a covariance with position and heading each inflated, so far as it explains the innovation.

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
