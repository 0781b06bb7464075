"""Who is wrong: localizers that disagree become hypotheses, and what the others say decides.

============================================  ======================================================================
while                                         what is done
============================================  ======================================================================
the localizers agree                          one filter; the tests of `agreement` look at the last one to two seconds
two motions differ by more than their noise,  whoever is outvoted, or both, have an error that lasts
and less than calibrations do                 (`lasting_doubts`)
two motions disagree                          from the anchor on, a filter for each hypothesis: each group of motions
                                              that agree, and none; the belief is their mixture
absolute estimates, which agreed a moment     the same with the hypotheses: nobody lies, each motion, all motion, and
ago, contradict the belief, or correct it     these absolute estimates; of three localizers or more also those of one
always the same way                           that the belief follows, with a motion or without
one hypothesis is 50 times as probable        it is the belief; what the others say has no weight, and their names
                                              stand in the health with the reason
absolute estimates of one localizer alone     the belief follows them, and covers where the motion leads
are against a motion (`overruled_motion`)
nothing decides                               the mixture: it covers all, and the health says so
motions agree again, and nothing has decided  the places where base may be are remembered (`alternatives`); the next
                                              absolute estimates decide between them
a liar has agreed for a window in which the   it is believed again
robot moved; or, where no other motion is
believed, absolute estimates say for 3 s that
it arrives where they are (`trials`); or
three absolute estimates in a row have agreed
with the belief; where they were drawn away,
the way between them with motion, too
absolute estimates contradict for 30 s        they are heard again as if they had never agreed (`RecoveryPolicy`)
============================================  ======================================================================
"""

from __future__ import annotations

from collections.abc import Sequence

from trailmark.estimation.kalman.agreement import Tolerance, agreeing_groups, corrections_are_consistent
from trailmark.estimation.kalman.alternatives import closed_question, reopened_question
from trailmark.estimation.kalman.clock_offsets import TOLD_S
from trailmark.estimation.kalman.clock_shift import beside_another_clock
from trailmark.estimation.kalman.correction import Correction
from trailmark.estimation.kalman.diagnosis import DetectedFault, FaultDiagnosis
from trailmark.estimation.kalman.dissent import growth_of_difference
from trailmark.estimation.kalman.forgiveness import AGREED, GIVES_IN_S, agree_again, with_repentant, without_fault
from trailmark.estimation.kalman.gate import threshold
from trailmark.estimation.kalman.hypotheses import Hypothesis, HypothesisBank, trusted_motions
from trailmark.estimation.kalman.lasting_doubts import doubts_of
from trailmark.estimation.kalman.lasting_errors import NO_ERRORS
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.kalman.one_sided import longest_one_sided_since
from trailmark.estimation.kalman.overruled_motion import still_overruled
from trailmark.estimation.kalman.parting import with_windows_compared, without_window
from trailmark.estimation.kalman.prediction import Prediction
from trailmark.estimation.kalman.repeated_fixes import remembered, with_frozen_kept_out, with_repetition
from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.kalman.trials import Trials
from trailmark.estimation.kalman.ways_of_fixes import ways_agree
from trailmark.estimation.kalman.windows import WINDOW_S, far_anchors_due, with_new_anchor, without_windows

__all__ = ["FaultDetector", "accused_sources", "outvoted_motions"]

# Between two tests, which cost as much as a motion [s].
_EVERY_S = 0.1 - 1e-6
# Rejections in a row after which absolute estimates are a question.
_FEWEST = 2
# Of two localizers of absolute estimates neither outvotes the other.
_FEWEST_WHO_VOTE = 3
# Share of the poses of an honest localizer that are nearer than this to a belief that is right.
_SHOWN = 0.999


class FaultDetector:
    """Predicts and corrects a filter state, or a bank of them while localizers disagree.

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
        self._bank = HypothesisBank(prediction, correction, tolerance)
        self._trials = Trials(prediction, correction)
        self._calibrated = prediction.calibrated  # the errors of these that last are estimated

    def predict(self, state: FilterState, stamp_s: float) -> FilterState:
        """Return the state at a stamp that is not earlier."""
        after, repeated = self._predict(state, stamp_s), state.diagnosis.repeated
        if after.diagnosis.repeated is repeated:
            return after
        return after.with_diagnosis(after.diagnosis.with_repeated(repeated))  # a question was decided

    def _predict(self, state: FilterState, stamp_s: float) -> FilterState:
        if stamp_s <= state.stamp_s or state.stamp_s == -float("inf"):
            return self._prediction.predict(state, stamp_s)
        before = state.diagnosis
        if before.rivals:
            return self._predict_question(without_window(state), stamp_s)
        previous, state = state, self._prediction.predict(state, stamp_s)
        if before.trials:
            state = self._trials.predict(state, stamp_s)
        if before.anchors and any(n > 1 for n in state.left_out.values()):
            state = self._test_motions(state, [previous])  # no outlier: it goes on
        is_due = stamp_s - before.tested_s >= _EVERY_S and not state.diagnosis.rivals
        if is_due and (len(state.diagnosis.sums) > 1 or before.faults):
            far = far_anchors_due(state.diagnosis, before.tested_s, stamp_s)
            state = state.with_diagnosis(state.diagnosis._replace(tested_s=stamp_s))
            state = self._test_motions(state, (*state.diagnosis.anchors, *far))
            if far and not state.diagnosis.rivals:
                doubts = doubts_of(state, [s for s in trusted_motions(state) if s not in self._calibrated])
                state = state.with_diagnosis(state.diagnosis._replace(doubts=doubts))
            if not state.diagnosis.rivals:
                state = with_windows_compared(state, self._calibrated)
        return _with_anchor_in_time(state)

    def correct(self, state: FilterState, measurement: Measurement) -> FilterState:
        """Return the state after a measurement, with the verdict on it as its last.

        A pose that its localizer repeats while base moves is kept out before anybody is asked.
        """
        if measurement.replaces:
            after = self._correct(state, measurement)
            return after.with_diagnosis(after.diagnosis._replace(repeated={}, overruled=None))
        state, repeats = with_repetition(state, measurement)
        if repeats is not None and repeats.is_frozen:
            return with_frozen_kept_out(state, measurement, repeats)
        after, repeated = self._correct(state, measurement), state.diagnosis.repeated
        if after.diagnosis.overruled is not None:
            after = still_overruled(after, measurement)
        if after.diagnosis.repeated is not repeated:
            after = after.with_diagnosis(after.diagnosis.with_repeated(repeated))
        return remembered(after, measurement, repeats)

    def _correct(self, state: FilterState, measurement: Measurement) -> FilterState:
        before = state.diagnosis
        if before.absolute_faults and not measurement.replaces and measurement.source in before.absolute_faults:
            return self._hear_liar(state, measurement)
        if abs(measurement.shifted_s) > TOLD_S:
            state = beside_another_clock(state, measurement.shifted_s)
            before = state.diagnosis
        if before.alternatives:
            state = _placed(state) if measurement.replaces else reopened_question(state)
            before = state.diagnosis
        if before.rivals:
            return self._bank.correct(state, measurement)
        variances = NO_ERRORS
        if not measurement.replaces:
            state, variances = self._correction.considered(state, measurement)
            before = state.diagnosis
        after = self._correction.correct(state, measurement)
        if measurement.replaces or state.gaussian is None or after.gaussian is None:
            return after.with_diagnosis(without_windows(before))
        if after.rejections.n_recoveries > state.rejections.n_recoveries:
            return after.with_diagnosis(without_windows(before))
        moved = after.gaussian.x[:3] - state.gaussian.x[:3]
        spread = state.gaussian.covariance[:3, :3] - after.gaussian.covariance[:3, :3]
        if any(variances):
            after = self._correction.without_considered(state, after, variances)
        measurements = (*before.measurements, (state.stamp_s, measurement))
        used = after.verdicts[-1].used
        innovations = before.innovations if used is None else (*before.innovations, (state.stamp_s, used))
        diagnosis = FaultDiagnosis(  # a fifth of the time of _replace
            before.sums,
            before.corrections + moved,
            before.correction_covariance + spread,
            before.anchors,
            measurements,
            *before[5:-3],
            innovations,
            before.repeated,
            before.overruled,
        )
        after = after.with_diagnosis(diagnosis)
        if before.faults:
            after = self._trials.measure(state, after, measurement)
        trusted = trusted_motions(after)
        # A part of a pose is off by the error of what was seen, and the next one by that of another: it does not
        # accuse the only motion. Gate and recovery see to that.
        has_rivals = len(trusted) > 1 or (len(trusted) == 1 and len(measurement.root) == 3)
        anchor = _doubtful_since(after, measurement.source) if has_rivals and diagnosis.anchors else None
        if anchor is None:
            return after
        is_jump = after.verdicts[-1].status == "gated"
        liars = _contradicting(after, measurement.source) if is_jump else []
        return self._bank.ask(after, anchor, [*_answers(trusted, liars), *_answers_of_most(after, trusted, liars)])

    def _predict_question(self, state: FilterState, stamp_s: float) -> FilterState:
        state = self._bank.predict(state, stamp_s)
        diagnosis = state.diagnosis
        if not diagnosis.rivals:
            return state
        sources, accusations = trusted_motions(state), _accusations(state)
        is_of_motion = diagnosis.rivals[0].state.diagnosis.absolute_faults == diagnosis.absolute_faults
        is_of_motion_alone = is_of_motion and len(sources) > 1 and bool(accusations)
        if is_of_motion_alone and agree_again(state, sources, self._tolerance, accusations):
            faults = [set(rival.state.diagnosis.faults) for rival in diagnosis.rivals]
            known = set(diagnosis.faults)
            if all(one > known for one in faults) or all(one == known for one in faults):  # these differ by place
                return closed_question(state)
            return state.with_diagnosis(without_windows(diagnosis))
        return _with_anchor_in_time(state)

    def _hear_liar(self, state: FilterState, measurement: Measurement) -> FilterState:
        """Return the state after an absolute estimate of one that is not believed: whether it agrees again."""
        doubted = self._correction.doubt(state, measurement)
        if state.diagnosis.rivals:  # of a question about others: what it says covers their belief, too
            rivals = self._bank.doubted(state.diagnosis.rivals, measurement)
            doubted = doubted.with_diagnosis(doubted.diagnosis._replace(rivals=rivals))
        fault = doubted.diagnosis.absolute_faults[measurement.source]
        if fault.n_agreed < AGREED and state.stamp_s - fault.since_s <= GIVES_IN_S:
            return doubted
        if fault.is_drawn and len(measurement.root) == 3 and not ways_agree(fault):
            return doubted  # parts of poses tell no way: these are heard as those that are off by a constant
        return self._correct(without_fault(state, measurement.source), measurement)

    def _test_motions(self, state: FilterState, anchors: Sequence[FilterState]) -> FilterState:
        """Return a state with hypotheses, if motions have disagreed since one of some instants."""
        for anchor in anchors:
            trusted = trusted_motions(state)
            if len(trusted) > 1:
                groups = [Hypothesis(group) for group in agreeing_groups(state, anchor, trusted, self._tolerance)]
                if len(groups) > 1:
                    none = [Hypothesis(frozenset())] if state.diagnosis.measurements else []
                    return self._bank.ask(state, anchor, [*groups, *none])
        return with_repentant(state, self._tolerance) if state.diagnosis.faults else state


def accused_sources(state: FilterState, most_rejected: int) -> set[str]:
    """Return the localizers that are not believed, that an open question is about, or that contradict the belief."""
    diagnosis = state.diagnosis
    accused = {*diagnosis.faults, *diagnosis.absolute_faults, *diagnosis.accused}
    for rival in diagnosis.rivals:
        accused |= {*rival.state.diagnosis.faults, *rival.state.diagnosis.absolute_faults}
    accused.update(source for source, n in state.rejections.counts.items() if n >= most_rejected)
    return accused


def outvoted_motions(state: FilterState) -> list[str]:
    """Return the localizers whose motion is not believed beside another that is."""
    faults = state.diagnosis.faults
    return sorted(faults) if len(faults) < len(state.diagnosis.sums) else []


def _doubtful_since(state: FilterState, source: str) -> FilterState | None:
    """Return the anchor since which the last absolute estimate, or all of them together, contradict the motion."""
    anchor = state.diagnosis.anchors[0]
    if state.verdicts[-1].status == "gated":
        # One that never agreed contradicts the belief, not the motion since it last agreed.
        agreed = state.rejections.corroborations.get(source)
        is_recent = agreed is not None and agreed.stamp_s >= anchor.stamp_s
        if not is_recent or state.rejections.counts.get(source, 0) < _FEWEST:
            return None
    elif corrections_are_consistent(state, anchor):
        return None
    return longest_one_sided_since(state) or anchor


def _accusations(state: FilterState) -> dict[str, DetectedFault]:
    """Return what the hypotheses of a question say of motions that were believed before it."""
    diagnosis = state.diagnosis
    faults = {source: fault for rival in diagnosis.rivals for source, fault in rival.state.diagnosis.faults.items()}
    return {source: fault for source, fault in faults.items() if source not in diagnosis.faults}


def _contradicting(state: FilterState, source: str) -> list[str]:
    """Return a localizer, and others whose absolute estimates have been rejected beside its own."""
    since_s = state.diagnosis.anchors[0].stamp_s
    others = [
        other
        for other, rejected in sorted(state.rejections.measurements.items())
        if other != source and rejected and rejected[-1].stamp_s >= since_s and state.rejections.counts.get(other, 0)
    ]
    return [source, *others]


def _answers(trusted: Sequence[str], sources: Sequence[str]) -> list[Hypothesis]:
    """Return who may be wrong where absolute estimates, of some that may be, contradict motions that agree.

    The first alone, or all of them.
    """
    everyone = frozenset(trusted)
    groups = dict.fromkeys([everyone, *(everyone - {one} for one in sorted(everyone)), frozenset[str]()])
    liars = dict.fromkeys([frozenset(sources[:1]), frozenset(sources)]) if sources else {}
    rough = [Hypothesis(frozenset(), is_rough=True)] if len(everyone) == 1 else []
    return [*map(Hypothesis, groups), *rough, *(Hypothesis(everyone, each) for each in liars)]


def _answers_of_most(state: FilterState, trusted: Sequence[str], sources: Sequence[str]) -> list[Hypothesis]:
    """Return that one lies whom the belief follows, and a motion with it, where two others or more may outvote it."""
    since_s, doubted = state.diagnosis.anchors[0].stamp_s, {*sources, *state.diagnosis.absolute_faults}
    corroborations = state.rejections.corroborations
    followed = [
        source
        for source, one in sorted(corroborations.items())
        if source not in doubted and one.stamp_s >= since_s and len(one.directions) == 3
    ]
    heard, everyone = {*sources, *followed}, frozenset(trusted)
    if not sources or len(heard) < _FEWEST_WHO_VOTE:
        return []
    groups = dict.fromkeys([everyone, *(everyone - {one} for one in sorted(everyone))])
    return [
        Hypothesis(
            group,
            frozenset({liar}),
            contradicted_by=frozenset(heard - {liar}),
            drawn_variances=_drawn_by(state, sources[0], [one for one in followed if one != liar]),
        )
        for liar in followed
        for group in groups
    ]


def _drawn_by(state: FilterState, source: str, others: Sequence[str]) -> tuple[float, float, float]:
    """Return variances of how far one who lies has drawn the belief away from poses of another that it rejected.

    That is what they differ by more than the first of them: who draws does so gradually, and a jump is no drawing.
    None where others that the belief follows would show it.
    """
    rejected = [one for one in state.rejections.measurements[source] if len(one.measurement.root) == 3]
    if state.gaussian is None or len(rejected) < _FEWEST:
        return 0.0, 0.0, 0.0
    away = growth_of_difference(state.gaussian.x, state.odometry.pose_odom_base, rejected)
    shown = (state.rejections.corroborations[other].directions @ away for other in others)
    if any(float(one @ one) > threshold(_SHOWN, len(one)) for one in shown):
        return 0.0, 0.0, 0.0
    position_m2 = float(away[0] * away[0] + away[1] * away[1])
    return position_m2, position_m2, float(away[2] * away[2])


def _placed(state: FilterState) -> FilterState:
    return state.with_diagnosis(state.diagnosis._replace(alternatives=(), accused=frozenset()))


def _with_anchor_in_time(state: FilterState) -> FilterState:
    anchors = state.diagnosis.anchors
    return with_new_anchor(state) if not anchors or state.stamp_s - anchors[-1].stamp_s >= WINDOW_S else state
