"""A question of who is wrong: one filter for each answer, begun before the question came up.

A hypothesis of n liars has the probability 0.01^n to begin with: so agreeing motions vote. By itself this decides for
two against one; absolute estimates can overturn it while they are part of the question. Where a noisy motion agrees
with each of two that contradict each other, it counts with which it agrees better (`with_votes`). Absolute estimates
that are said to lie are off by a constant, as those are that match the wrong place: one whose offset grows explains
less than a motion that is wrong.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from trailmark.estimation.kalman.agreement import Tolerance, is_still, motion_since
from trailmark.estimation.kalman.bank import (
    is_jump,
    log_likelihood,
    log_likelihood_of_offset,
    posterior,
    with_likelihoods,
)
from trailmark.estimation.kalman.correction import Correction
from trailmark.estimation.kalman.diagnosis import DetectedFault, FaultDiagnosis, RivalFilter
from trailmark.estimation.kalman.fault_reasons import reason_against_fixes, reason_against_motion
from trailmark.estimation.kalman.forgiveness import window_that_shows
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.kalman.prediction import Prediction
from trailmark.estimation.kalman.settling import continued, settle
from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.kalman.votes import with_votes
from trailmark.estimation.kalman.windows import without_windows

__all__ = ["Hypothesis", "HypothesisBank", "trusted_motions"]

_LIAR = math.log(100.0)


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """An answer to who is wrong.

    Attributes
    ----------
    motions : frozenset of str
        Localizers whose motion is believed, of those that were trusted.
    lying_fixes : frozenset of str
        Localizers whose absolute estimates are not.
    is_rough : bool
        Whether motion that is not believed is about right still, where there is no other.
    """

    motions: frozenset[str]
    lying_fixes: frozenset[str] = frozenset()
    is_rough: bool = False


def trusted_motions(state: FilterState) -> list[str]:
    """Return the localizers whose motion is believed."""
    return [source for source in state.diagnosis.sums if source not in state.diagnosis.faults]


class HypothesisBank:
    """Begins, predicts and corrects the filters of a question.

    Parameters
    ----------
    prediction : Prediction
        Of one filter.
    correction : Correction
        Of one filter.
    tolerance : Tolerance
        By how much honest localizers differ.
    """

    def __init__(self, prediction: Prediction, correction: Correction, tolerance: Tolerance) -> None:
        self._prediction = prediction
        self._correction = correction
        self._tolerance = tolerance

    def ask(self, state: FilterState, anchor: FilterState, hypotheses: Iterable[Hypothesis]) -> FilterState:
        """Return a state with one filter for each hypothesis, from an anchor, or the oldest of the last seconds, on."""
        anchor = min(anchor, state.diagnosis.anchors[0], key=lambda one: one.stamp_s)
        rivals = [self._begin_rival(state, anchor, hypothesis) for hypothesis in hypotheses]
        if len(rivals) < 2:
            return state
        rivals = with_votes(self._replay(rivals, anchor, state), self._tolerance)
        return settle(state, _with_suspicion(state, anchor, rivals))

    def predict(self, state: FilterState, stamp_s: float) -> FilterState:
        """Return a state with rivals at a later stamp."""
        before = state.diagnosis.rivals
        after = [self._predict_rival(rival, stamp_s) for rival in before]
        leads = _most_probable_that_moved(after)
        odometry = continued(state.odometry, before[leads].state.odometry, after[leads].state.odometry)
        after = with_votes(after, self._tolerance, before)
        return settle(replace(state, stamp_s=stamp_s, odometry=odometry, verdicts=()), after)

    def correct(self, state: FilterState, measurement: Measurement) -> FilterState:
        """Return a state with rivals after a measurement, with the verdict of the most probable one as its last."""
        rivals = self._measure(state.diagnosis.rivals, measurement)
        leader = rivals[int(np.argmax(posterior(rivals)))].state
        verdict = leader.verdicts[-1]
        diagnosis = state.diagnosis._replace(measurements=(*state.diagnosis.measurements, (state.stamp_s, measurement)))
        fixed_at_m = state.odometry.travelled_m if verdict.status == "accepted" else state.fixed_at_m
        state = replace(state, diagnosis=diagnosis, verdicts=(*state.verdicts, verdict), fixed_at_m=fixed_at_m)
        if measurement.replaces:
            return replace(
                state,
                gaussian=leader.gaussian,
                rejections=leader.rejections,
                diagnosis=without_windows(state.diagnosis),
            )
        return settle(state, rivals)

    def _begin_rival(self, state: FilterState, anchor: FilterState, hypothesis: Hypothesis) -> RivalFilter:
        trusted = frozenset(trusted_motions(state))
        faults, absolute_faults = dict(state.diagnosis.faults), dict(state.diagnosis.absolute_faults)
        for source in sorted(trusted - hypothesis.motions):
            reason = reason_against_motion(state, anchor, source, hypothesis.motions)
            shows_in_s = window_that_shows(state, source, hypothesis.motions, self._tolerance)
            faults[source] = DetectedFault(state.stamp_s, reason, shows_in_s=shows_in_s, is_rough=hypothesis.is_rough)
        liars = hypothesis.lying_fixes
        is_outvoted = len(hypothesis.motions) > len(liars)
        for liar in sorted(liars):
            reason = reason_against_fixes(hypothesis.motions, is_outvoted=is_outvoted)
            absolute_faults[liar] = DetectedFault(state.stamp_s, reason, is_outvoted=is_outvoted)
        # A lone motion has nobody to part from: that it may be wrong is another hypothesis.
        doubts = state.diagnosis.doubts if len(hypothesis.motions) > 1 else {}
        doubts = {source: one for source, one in doubts.items() if source not in faults}
        diagnosis = FaultDiagnosis(
            sums=anchor.diagnosis.sums, faults=faults, absolute_faults=absolute_faults, doubts=doubts
        )
        n_liars = len(trusted - hypothesis.motions) + len(liars)
        return RivalFilter(anchor.with_diagnosis(diagnosis), -_LIAR * n_liars, begun=anchor)

    def _replay(self, rivals: Sequence[RivalFilter], anchor: FilterState, state: FilterState) -> list[RivalFilter]:
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
        replayed = [RivalFilter(anchor.with_diagnosis(diagnosis), 0.0), *rivals]
        for stamp_s, measurement in before.measurements:
            if stamp_s <= anchor.stamp_s:
                continue
            replayed = [self._predict_rival(rival, stamp_s) for rival in replayed]
            replayed = self._measure(replayed, measurement)
            reference = replayed[0]
            replayed = [reference, *(_begun_later(*pair, reference) for pair in zip(replayed[1:], rivals))]
        return [self._predict_rival(rival, state.stamp_s) for rival in replayed[1:]]

    def _predict_rival(self, rival: RivalFilter, stamp_s: float) -> RivalFilter:
        state, is_implausible = rival.state, rival.is_implausible
        if stamp_s <= state.stamp_s:
            return rival
        for cut_s in [*self._prediction.cuts(state.stamp_s, stamp_s), stamp_s]:
            before, state = state, self._prediction.predict_piece(state, cut_s)
            is_implausible = is_implausible or bool(_jumps(before, state))
        return replace(rival, state=state, is_implausible=is_implausible)

    def _measure(self, rivals: Sequence[RivalFilter], measurement: Measurement) -> list[RivalFilter]:
        corrected, logs = [], []
        for rival in rivals:
            if measurement.source not in rival.state.diagnosis.absolute_faults:
                logs.append(log_likelihood(rival.state, measurement))
                corrected.append(replace(rival, state=self._correction.correct(rival.state, measurement)))
                continue
            known = rival.offsets.get(measurement.source)
            log, offset = log_likelihood_of_offset(rival.state, measurement, known)
            logs.append(log)
            offsets = rival.offsets if offset is None else {**rival.offsets, measurement.source: offset}
            corrected.append(replace(rival, state=self._correction.doubt(rival.state, measurement), offsets=offsets))
        return with_likelihoods(corrected, logs)


def _most_probable_that_moved(rivals: Sequence[RivalFilter]) -> int:
    """Return the index of the most probable hypothesis whose motion has told of the present instant already.

    Its motion may be that of a slower localizer, which tells of this instant next; until then, or where it is lost, a
    velocity that is held is no odometry while somebody measures one. With none that does: the most probable.
    """
    weights = posterior(rivals)
    measures = np.array([rival.state.odometry.gap_s == 0.0 for rival in rivals])
    return int(np.argmax(np.where(measures, weights, 0.0) if measures.any() else weights))


def _with_suspicion(state: FilterState, anchor: FilterState, rivals: Sequence[RivalFilter]) -> list[RivalFilter]:
    """Return hypotheses, suspect where those that they believe stand still while others move."""
    motions = {s: motion_since(state, anchor, s) for s in trusted_motions(state)}
    moving = {s for s, motion in motions.items() if motion is not None and not is_still(motion)}
    return [
        replace(
            rival,
            is_implausible=rival.is_implausible
            or (bool(moving) and moving <= set(rival.state.diagnosis.faults) < set(motions)),
        )
        for rival in rivals
    ]


def _begun_later(rival: RivalFilter, at_first: RivalFilter, reference: RivalFilter) -> RivalFilter:
    """Return a hypothesis, begun anew from the filter of all if that explains better what was measured until here."""
    log_weight = reference.log_weight + at_first.log_weight
    if rival.log_weight > log_weight:
        return rival
    said = rival.state.diagnosis
    diagnosis = reference.state.diagnosis._replace(
        faults=said.faults, absolute_faults=said.absolute_faults, doubts=said.doubts
    )
    return RivalFilter(reference.state.with_diagnosis(diagnosis), log_weight, begun=rival.begun)


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
