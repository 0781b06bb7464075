"""A question of who is wrong: one filter for each answer, begun before the question came up.

A hypothesis of n liars has the probability 0.01^n to begin with: so agreeing motions vote. By itself this decides for
two against one; absolute estimates can overturn it while they are part of the question. Where a noisy motion agrees
with each of two that contradict each other, it counts with which it agrees better (`with_votes`). Absolute estimates
that are said to lie are off by a constant, as those are that match the wrong place: one whose offset grows explains
less than a motion that is wrong, unless two motions or more agree against it (`moving_offset`), or two localizers
of absolute estimates. A sensor that lies with its motion and its map is one liar then.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from trailmark.estimation.kalman.agreement import Tolerance, is_still, motion_since
from trailmark.estimation.kalman.bank import posterior
from trailmark.estimation.kalman.correction import Correction
from trailmark.estimation.kalman.diagnosis import DetectedFault, FaultDiagnosis, RivalFilter
from trailmark.estimation.kalman.fault_reasons import reason_against_fixes, reason_against_motion
from trailmark.estimation.kalman.forgiveness import window_that_shows
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.kalman.prediction import Prediction
from trailmark.estimation.kalman.rival_filters import RivalFilters, with_pose_doubted
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
    contradicted_by : frozenset of str
        Localizers whose absolute estimates outvote the lying ones, if there are more of them.
    drawn_variances : tuple of 3 float
        Of how far the belief has followed the lying ones already.
    """

    motions: frozenset[str]
    lying_fixes: frozenset[str] = frozenset()
    is_rough: bool = False
    contradicted_by: frozenset[str] = frozenset()
    drawn_variances: tuple[float, float, float] = (0.0, 0.0, 0.0)


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
        self._filters = RivalFilters(prediction, correction)
        self._tolerance = tolerance

    def ask(self, state: FilterState, anchor: FilterState, hypotheses: Iterable[Hypothesis]) -> FilterState:
        """Return a state with one filter for each hypothesis, from an anchor, or the oldest of the last seconds, on."""
        anchor = min(anchor, state.diagnosis.anchors[0], key=lambda one: one.stamp_s)
        rivals = [self._begin_rival(state, anchor, hypothesis) for hypothesis in hypotheses]
        if len(rivals) < 2:
            return state
        rivals = with_votes(self._filters.replay(rivals, anchor, state), self._tolerance)
        return settle(state, _with_suspicion(state, anchor, rivals))

    def predict(self, state: FilterState, stamp_s: float) -> FilterState:
        """Return a state with rivals at a later stamp."""
        before = state.diagnosis.rivals
        after = self._filters.predict(before, stamp_s)
        leads = _most_probable_that_moved(after)
        odometry = continued(state.odometry, before[leads].state.odometry, after[leads].state.odometry)
        after = with_votes(after, self._tolerance, before)
        return settle(replace(state, stamp_s=stamp_s, odometry=odometry, verdicts=()), after)

    def correct(self, state: FilterState, measurement: Measurement) -> FilterState:
        """Return a state with rivals after a measurement, with the verdict of the most probable one as its last."""
        rivals = self._filters.measure(state.diagnosis.rivals, measurement)
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

    def doubted(self, rivals: Sequence[RivalFilter], measurement: Measurement) -> tuple[RivalFilter, ...]:
        """Return rivals after a measurement of one whom all of them doubt already: it is no evidence for any."""
        return self._filters.doubted(rivals, measurement)

    def _begin_rival(self, state: FilterState, anchor: FilterState, hypothesis: Hypothesis) -> RivalFilter:
        trusted = frozenset(trusted_motions(state))
        faults, absolute_faults = dict(state.diagnosis.faults), dict(state.diagnosis.absolute_faults)
        for source in sorted(trusted - hypothesis.motions):
            reason = reason_against_motion(state, anchor, source, hypothesis.motions)
            shows_in_s = window_that_shows(state, source, hypothesis.motions, self._tolerance)
            faults[source] = DetectedFault(state.stamp_s, reason, shows_in_s=shows_in_s, is_rough=hypothesis.is_rough)
        liars = hypothesis.lying_fixes
        is_outvoted = max(len(hypothesis.motions), len(hypothesis.contradicted_by)) > len(liars)
        for liar in sorted(liars):
            reason = reason_against_fixes(hypothesis.motions, hypothesis.contradicted_by, is_outvoted=is_outvoted)
            absolute_faults[liar] = DetectedFault(
                state.stamp_s, reason, is_outvoted=is_outvoted, contradicted_by=hypothesis.contradicted_by
            )
        # A lone motion has nobody to part from: that it may be wrong is another hypothesis.
        doubts = state.diagnosis.doubts if len(hypothesis.motions) > 1 else {}
        doubts = {source: one for source, one in doubts.items() if source not in faults}
        diagnosis = FaultDiagnosis(
            sums=anchor.diagnosis.sums, faults=faults, absolute_faults=absolute_faults, doubts=doubts
        )
        n_wrong = len(trusted - hypothesis.motions)
        # its motion and its map
        is_one_sensor = bool(hypothesis.contradicted_by) and n_wrong == len(liars) == 1
        n_liars = 1 if is_one_sensor else n_wrong + len(liars)
        begun = with_pose_doubted(anchor.with_diagnosis(diagnosis), np.diag(hypothesis.drawn_variances))
        return RivalFilter(begun, -_LIAR * n_liars, begun=anchor)


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
