"""The filters of a question: predicted and corrected side by side, and carried from where it begins until now.

The same question is asked several times: each motion that comes late redoes the instant at which it came up. So the
last steps of the last one are kept, and only what a motion may have changed since is done again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.agreement import motion_since
from trailmark.estimation.kalman.bank import is_jump, log_likelihood, log_likelihood_of_offset, with_likelihoods
from trailmark.estimation.kalman.correction import Correction, innovation_of
from trailmark.estimation.kalman.diagnosis import FaultDiagnosis, FixOffset, RivalFilter
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.kalman.prediction import Prediction
from trailmark.estimation.kalman.state import FilterState

__all__ = ["RivalFilters", "with_pose_doubted"]

# Steps of the last question that are kept: a motion of a slow localizer redoes no more of them.
_N_KEPT = 32


class _Question:
    """A question from its beginning on: who is believed in it, and its last steps.

    Attributes
    ----------
    measurements : list of (float, Measurement)
        All that were applied.
    steps : deque of list of RivalFilter
        The filters after the last of them: the reference, then the rivals.
    """

    def __init__(self, anchor: FilterState, reference: RivalFilter, rivals: Sequence[RivalFilter]) -> None:
        self.anchor, self.reference, self.rivals = anchor, reference, rivals
        self.measurements: list[tuple[float, Measurement]] = []
        self.steps: deque[list[RivalFilter]] = deque(maxlen=_N_KEPT)

    def is_same(self, anchor: FilterState, reference: RivalFilter, rivals: Sequence[RivalFilter]) -> bool:
        """Return whether another question begins at the same state, and believes and doubts the same."""
        return (
            self.anchor is anchor
            and len(self.rivals) == len(rivals)
            and all(map(_assume_the_same, (self.reference, *self.rivals), (reference, *rivals)))
        )


class RivalFilters:
    """Predicts and corrects filters that disagree on who is right.

    Parameters
    ----------
    prediction : Prediction
        Of one filter.
    correction : Correction
        Of one filter.
    """

    def __init__(self, prediction: Prediction, correction: Correction) -> None:
        self._prediction = prediction
        self._correction = correction
        self._last: _Question | None = None

    def replay(self, rivals: Sequence[RivalFilter], anchor: FilterState, state: FilterState) -> list[RivalFilter]:
        """Return hypotheses at the instant of a state, from an anchor on.

        Nobody knows when a lie begins. As in Page's cumulative sum, it begins anew where until then all localizers
        together explain the measurements better than a hypothesis does.
        """
        before = state.diagnosis
        diagnosis = FaultDiagnosis(
            sums=anchor.diagnosis.sums,
            faults=before.faults,
            absolute_faults=before.absolute_faults,
            doubts=before.doubts,
        )
        reference = RivalFilter(anchor.with_diagnosis(diagnosis), 0.0)
        measurements = [one for one in before.measurements if one[0] > anchor.stamp_s]
        question, replayed = self._go_on(anchor, reference, rivals, measurements)
        twins = [_assume_the_same(rival, reference) for rival in rivals]
        for stamp_s, measurement in measurements[len(question.measurements) :]:
            kept = [True, *(not is_twin for is_twin in twins)]
            apart = self.predict([one for one, is_kept in zip(replayed, kept) if is_kept], stamp_s)
            apart = self.measure(apart, measurement)
            reference, others = apart[0], iter(apart[1:])
            replayed = [reference]
            for rival, is_twin in zip(rivals, twins):
                replayed.append(_begun_later(reference if is_twin else next(others), rival, reference))
            question.measurements.append((stamp_s, measurement))
            question.steps.append(replayed)
        return self.predict(replayed[1:], state.stamp_s)

    def predict(self, rivals: Sequence[RivalFilter], stamp_s: float) -> list[RivalFilter]:
        """Return hypotheses of one instant at a later stamp."""
        if not rivals or stamp_s <= rivals[0].state.stamp_s:
            return list(rivals)
        cuts = [*self._prediction.cuts(rivals[0].state.stamp_s, stamp_s), stamp_s]
        return [self._predict_one(rival, cuts) for rival in rivals]

    def measure(self, rivals: Sequence[RivalFilter], measurement: Measurement) -> list[RivalFilter]:
        """Return hypotheses after a measurement."""
        corrected, logs = [], []
        for rival in rivals:
            state = rival.state
            if measurement.source not in state.diagnosis.absolute_faults:
                seen = innovation_of(state, measurement)
                logs.append(log_likelihood(seen))
                corrected.append(_with_state(rival, self._correction.correct(state, measurement, seen)))
                continue
            known = rival.offsets.get(measurement.source)
            log, offset = log_likelihood_of_offset(state, measurement, known)
            logs.append(log)
            offsets = rival.offsets if offset is None else {**rival.offsets, measurement.source: offset}
            corrected.append(_with_state(rival, self._correction.doubt(state, measurement), offsets=offsets))
        return with_likelihoods(corrected, measurement.source, logs)

    def doubted(self, rivals: Sequence[RivalFilter], measurement: Measurement) -> tuple[RivalFilter, ...]:
        """Return hypotheses after a measurement of one whom none of them believes, which says nothing of them."""
        return tuple(_with_state(rival, self._correction.doubt(rival.state, measurement)) for rival in rivals)

    def _predict_one(self, rival: RivalFilter, cuts: Sequence[float]) -> RivalFilter:
        state, is_implausible = rival.state, rival.is_implausible
        for cut_s in cuts:
            before, state = state, self._prediction.predict_piece(state, cut_s)
            is_implausible = is_implausible or _jumps(before, state)
        return _with_state(rival, state, is_implausible=is_implausible)

    def _go_on(
        self,
        anchor: FilterState,
        reference: RivalFilter,
        rivals: Sequence[RivalFilter],
        measurements: Sequence[tuple[float, Measurement]],
    ) -> tuple[_Question, list[RivalFilter]]:
        """Return a question, so far as it was asked before and nothing has changed since, and its filters there."""
        changed_s, last = self._prediction.take_changed_since_s(), self._last
        question = self._last = _Question(anchor, reference, rivals)
        if last is None or not last.is_same(anchor, reference, rivals):
            return question, [reference, *rivals]
        n_same = 0
        for (at_s, one), (now_s, other) in zip(last.measurements, measurements):
            if at_s > changed_s or at_s != now_s or one is not other:
                break
            n_same += 1
        n_more = len(last.measurements) - n_same
        if not n_same > 0 or n_more >= len(last.steps):
            return question, [reference, *rivals]
        question.measurements = last.measurements[:n_same]
        question.steps.extend(list(last.steps)[: len(last.steps) - n_more])
        words = [reference, *rivals]  # what is said of those who are not believed may be said in other words now
        return question, [_with_faults_of(one, as_asked) for one, as_asked in zip(question.steps[-1], words)]


def _assume_the_same(rival: RivalFilter, other: RivalFilter) -> bool:
    """Return whether two filters begin alike, and use the same of what is said."""
    one, two = rival.state.diagnosis, other.state.diagnosis
    return (
        rival.log_weight == other.log_weight
        and one.doubts == two.doubts
        and one.absolute_faults == two.absolute_faults
        and {source: fault.is_rough for source, fault in one.faults.items()}
        == {source: fault.is_rough for source, fault in two.faults.items()}
    )


def _with_faults_of(rival: RivalFilter, as_asked: RivalFilter) -> RivalFilter:
    diagnosis = rival.state.diagnosis._replace(faults=as_asked.state.diagnosis.faults)
    return _with_state(rival, rival.state.with_diagnosis(diagnosis))


def _with_state(
    rival: RivalFilter,
    state: FilterState,
    *,
    is_implausible: bool | None = None,
    offsets: Mapping[str, FixOffset] | None = None,
) -> RivalFilter:
    """Return a hypothesis in another state, in a third of the time of `dataclasses.replace`."""
    return RivalFilter(
        state,
        rival.log_weight,
        rival.n_measurements,
        rival.is_implausible if is_implausible is None else is_implausible,
        rival.offsets if offsets is None else offsets,
        rival.begun,
        rival.log_votes,
        rival.heard,
        rival.log_alone,
    )


def _begun_later(rival: RivalFilter, at_first: RivalFilter, reference: RivalFilter) -> RivalFilter:
    """Return a hypothesis, begun anew from the filter of all if that explains better what was measured until here."""
    log_weight = reference.log_weight + at_first.log_weight
    if rival.log_weight > log_weight:
        return rival
    said = rival.state.diagnosis
    diagnosis = reference.state.diagnosis._replace(
        faults=said.faults, absolute_faults=said.absolute_faults, doubts=said.doubts
    )
    begun = at_first.begun
    state = reference.state.with_diagnosis(diagnosis)
    if begun is not None and begun.gaussian is not at_first.state.gaussian:
        state = with_pose_doubted(state, _pose_covariance(at_first.state) - _pose_covariance(begun))
    return RivalFilter(
        state,
        log_weight,
        begun=begun,
        heard=reference.heard,
        log_alone=reference.log_alone,
    )


def with_pose_doubted(state: FilterState, covariance: Floats) -> FilterState:
    """Return a state whose pose is less certain by a covariance, (3, 3)."""
    if state.gaussian is None or not covariance.any():
        return state
    doubted = state.gaussian.covariance.copy()
    doubted[:3, :3] += covariance
    return replace(state, gaussian=replace(state.gaussian, covariance=doubted))


def _pose_covariance(state: FilterState) -> Floats:
    return np.zeros((3, 3)) if state.gaussian is None else state.gaussian.covariance[:3, :3]


def _jumps(before: FilterState, after: FilterState) -> bool:
    """Return whether a hypothesis says that the robot changed its velocity faster than robots do."""
    if before.odometry.gap_s > 0.0 or after.odometry.gap_s > 0.0 or not before.odometry.has_moved:
        return False
    steps = [
        step
        for source in after.diagnosis.sums
        if source not in after.diagnosis.faults and (step := motion_since(after, before, source)) is not None
    ]
    if not steps:
        return False
    return is_jump(
        before.odometry.twist,
        after.odometry.twist,
        after.stamp_s - before.stamp_s,
        position_m2=min(step.position_m2 for step in steps),
        turn_rad2=min(step.turn_rad2 for step in steps),
    )
