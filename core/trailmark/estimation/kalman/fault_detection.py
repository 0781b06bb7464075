"""Who is wrong: localizers that disagree become hypotheses, and what the others say decides.

============================================  ======================================================================
while                                         what is done
============================================  ======================================================================
the localizers agree                          one filter; the tests of `agreement` look at the last one to two seconds
two motions disagree, or absolute estimates   from the anchor on, a filter for each hypothesis: each group of motions
correct the belief of two motions or more     that agree, all but one, and none; the belief is their mixture
always the same way
one hypothesis is 50 times as probable        it is the belief; the motion of the others has no weight, and their names
                                              stand in the health with the reason
nothing decides                               the mixture: it covers all, and the health says so
a liar has agreed for a window in which the   it is believed again
robot moved
============================================  ======================================================================

A hypothesis of n liars has the probability 0.01^n to begin with: so agreeing motions vote. By itself this decides for
two against one; absolute estimates can overturn it while they are part of the question.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.agreement import (
    Tolerance,
    agreeing_groups,
    corrections_are_consistent,
    is_still,
    motion_since,
)
from trailmark.estimation.kalman.bank import is_jump, log_likelihood, mixture_of, posterior, with_likelihoods
from trailmark.estimation.kalman.correction import Correction
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.kalman.prediction import Prediction
from trailmark.estimation.kalman.state import (
    Consistency,
    Fault,
    FilterState,
    Gaussian,
    MotionSum,
    OdometryState,
    Rival,
)
from trailmark.geometry import wrap_angle

__all__ = ["WINDOW_S", "FaultDetector"]

#: The tests look back by one to two of these: long beside the period of any localizer, short beside what a robot can
#: do about a lie [s].
WINDOW_S = 1.0
# Between two tests, which cost as much as a motion [s].
_EVERY_S = 0.1 - 1e-6
_LIAR = math.log(100.0)
_DECIDED = math.log(50.0)
# Absolute estimates that must have had a say, and more where they alone contradict all motion: a jump of theirs is
# found out by their own recovery after five.
_FEWEST, _FEWEST_WITHOUT_MOTION = 2, 5
_FORGOTTEN = 1e-6


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

    def predict(self, state: FilterState, stamp_s: float) -> FilterState:
        """Return the state at a stamp that is not earlier."""
        if stamp_s <= state.stamp_s or state.stamp_s == -math.inf:
            return self._prediction.predict(state, stamp_s)
        before = state.consistency
        if before.rivals:
            return self._predict_rivals(state, stamp_s)
        previous, state = state, self._prediction.predict(state, stamp_s)
        if previous.left_out and state.left_out and before.anchors:
            state = self._test_motions(state, [previous])  # no outlier: it goes on
        is_due = stamp_s - before.tested_s >= _EVERY_S and not state.consistency.rivals
        if is_due and (len(state.consistency.sums) > 1 or before.faults):
            state = replace(state, consistency=state.consistency._replace(tested_s=stamp_s))
            state = self._test_motions(state, state.consistency.anchors)
        anchors = state.consistency.anchors
        if not anchors or stamp_s - anchors[-1].stamp_s >= WINDOW_S:
            state = _with_new_anchor(state)
        return state

    def correct(self, state: FilterState, measurement: Measurement) -> FilterState:
        """Return the state after a measurement, with the verdict on it as its last."""
        before = state.consistency
        if before.rivals:
            return self._correct_rivals(state, measurement)
        after = self._correction.correct(state, measurement)
        if measurement.replaces or state.gaussian is None or after.gaussian is None:
            return replace(after, consistency=_without_windows(before))
        if after.rejections.n_recoveries > state.rejections.n_recoveries:
            return replace(after, consistency=_without_windows(before))
        moved = after.gaussian.x[:3] - state.gaussian.x[:3]
        spread = state.gaussian.covariance[:3, :3] - after.gaussian.covariance[:3, :3]
        consistency = before._replace(
            corrections=before.corrections + moved,
            correction_covariance=before.correction_covariance + spread,
            measurements=(*before.measurements, (state.stamp_s, measurement)),
        )
        after = replace(after, consistency=consistency)
        # With one motion a fix may be wrong as well, and nothing decides: gate and recovery see to that.
        has_rivals = len(self._trusted(after)) > 1
        if has_rivals and consistency.anchors and self._is_doubtful(after, measurement.source):
            return self._spawn(after, self._all_but_one(after))
        return after

    def _is_doubtful(self, state: FilterState, source: str) -> bool:
        if state.verdicts[-1].status == "gated":
            # One that never agreed contradicts the belief, not the motion since it last agreed.
            agreed = state.rejections.corroborations.get(source)
            is_recent = agreed is not None and agreed.stamp_s >= state.consistency.anchors[0].stamp_s
            return is_recent and state.rejections.counts.get(source, 0) >= _FEWEST
        return not corrections_are_consistent(state, state.consistency.anchors[0])

    def _trusted(self, state: FilterState) -> list[str]:
        return [source for source in state.consistency.sums if source not in state.consistency.faults]

    def _test_motions(self, state: FilterState, anchors: Sequence[FilterState]) -> FilterState:
        """Return a state with hypotheses, if motions have disagreed since one of some instants."""
        for anchor in anchors:
            trusted = self._trusted(state)
            if len(trusted) > 1:
                groups = agreeing_groups(state, anchor, trusted, self._tolerance)
                if len(groups) > 1:
                    hypotheses = [*groups, frozenset()] if state.consistency.measurements else groups
                    return self._spawn(state, hypotheses)
        return self._with_repentant(state) if state.consistency.faults else state

    def _all_but_one(self, state: FilterState) -> list[frozenset[str]]:
        trusted = frozenset(self._trusted(state))
        return list(dict.fromkeys([trusted, *(trusted - {source} for source in sorted(trusted)), frozenset()]))

    def _spawn(self, state: FilterState, hypotheses: Iterable[frozenset[str]]) -> FilterState:
        """Return a state with one filter for each hypothesis, each beginning at the oldest anchor."""
        consistency = state.consistency
        anchor = consistency.anchors[0]
        trusted = frozenset(self._trusted(state))
        rivals = []
        for believed in hypotheses:
            faults = {**consistency.faults}
            for source in sorted(trusted - believed):
                faults[source] = Fault(state.stamp_s, self._reason(state, anchor, source, believed))
            start = replace(anchor, consistency=Consistency(sums=anchor.consistency.sums, faults=faults))
            rivals.append(Rival(start, -_LIAR * len(trusted - believed)))
        if len(rivals) < 2:
            return state
        rivals = self._replay(rivals, anchor, state)
        rivals = self._with_suspicion(state, anchor, rivals)
        return self._settle(state, rivals)

    def _replay(self, rivals: Sequence[Rival], anchor: FilterState, state: FilterState) -> list[Rival]:
        """Return hypotheses at the instant of a state, from an anchor on.

        Nobody knows when a lie begins. As in Page's cumulative sum, it begins anew where until then all localizers
        together explain the measurements better than a hypothesis does.
        """
        consistency = state.consistency
        together = replace(anchor, consistency=Consistency(sums=anchor.consistency.sums, faults=consistency.faults))
        replayed = [Rival(together, 0.0), *rivals]
        for stamp_s, measurement in consistency.measurements:
            replayed = [self._predict_rival(rival, stamp_s) for rival in replayed]
            replayed = self._measure(replayed, measurement)
            reference = replayed[0]
            replayed = [reference, *(_begun_later(*pair, reference) for pair in zip(replayed[1:], rivals))]
        return [self._predict_rival(rival, state.stamp_s) for rival in replayed[1:]]

    def _with_suspicion(self, state: FilterState, anchor: FilterState, rivals: Sequence[Rival]) -> list[Rival]:
        """Return hypotheses, suspect where those that they believe stand still while others move."""
        motions = {s: motion_since(state, anchor, s) for s in self._trusted(state)}
        moving = {s for s, motion in motions.items() if motion is not None and not is_still(motion)}
        return [
            replace(
                rival,
                is_implausible=rival.is_implausible
                or (bool(moving) and moving <= set(rival.state.consistency.faults) < set(motions)),
            )
            for rival in rivals
        ]

    def _predict_rivals(self, state: FilterState, stamp_s: float) -> FilterState:
        before = state.consistency.rivals
        after = [self._predict_rival(rival, stamp_s) for rival in before]
        leader = int(np.argmax(posterior(after)))
        odometry = _continued(state.odometry, before[leader].state.odometry, after[leader].state.odometry)
        state = self._settle(replace(state, stamp_s=stamp_s, odometry=odometry, verdicts=()), after)
        consistency = state.consistency
        if not consistency.rivals:
            return state
        sources, anchors = self._trusted(state), consistency.anchors
        is_question_old = bool(anchors) and anchors[0].stamp_s >= consistency.undecided_since_s
        if is_question_old and len(sources) > 1 and self._agree_again(state, anchors[0], sources):
            return replace(state, consistency=_without_windows(consistency))
        if not consistency.anchors or stamp_s - consistency.anchors[-1].stamp_s >= WINDOW_S:
            state = _with_new_anchor(state)
        return state

    def _predict_rival(self, rival: Rival, stamp_s: float) -> Rival:
        state, is_implausible = rival.state, rival.is_implausible
        if stamp_s <= state.stamp_s:
            return rival
        for cut_s in [*self._prediction.cuts(state.stamp_s, stamp_s), stamp_s]:
            before, state = state, self._prediction.predict_piece(state, cut_s)
            is_implausible = is_implausible or bool(_jumps(before, state))
        return replace(rival, state=state, is_implausible=is_implausible)

    def _correct_rivals(self, state: FilterState, measurement: Measurement) -> FilterState:
        rivals = self._measure(state.consistency.rivals, measurement)
        leader = rivals[int(np.argmax(posterior(rivals)))].state
        verdict = leader.verdicts[-1]
        consistency = state.consistency._replace(
            measurements=(*state.consistency.measurements, (state.stamp_s, measurement))
        )
        fixed_at_m = state.odometry.travelled_m if verdict.status == "accepted" else state.fixed_at_m
        state = replace(state, consistency=consistency, verdicts=(*state.verdicts, verdict), fixed_at_m=fixed_at_m)
        if measurement.replaces:
            return replace(
                state,
                gaussian=leader.gaussian,
                rejections=leader.rejections,
                consistency=_without_windows(state.consistency),
            )
        return self._settle(state, rivals)

    def _measure(self, rivals: Sequence[Rival], measurement: Measurement) -> list[Rival]:
        logs = [log_likelihood(rival.state, measurement) for rival in rivals]
        weighed = with_likelihoods(rivals, logs)
        return [replace(rival, state=self._correction.correct(rival.state, measurement)) for rival in weighed]

    def _settle(self, state: FilterState, rivals: Sequence[Rival]) -> FilterState:
        """Return the state of a bank: its mixture, or the one hypothesis that is left."""
        weights = posterior(rivals)
        order = np.argsort(-weights, kind="stable")
        best = rivals[order[0]]
        odds = math.log(weights[order[0]] / max(weights[order[1]], 1e-300))
        believes_none = not set(best.state.consistency.sums) - set(best.state.consistency.faults)
        fewest = _FEWEST_WITHOUT_MOTION if believes_none else _FEWEST
        is_decided = odds > _DECIDED and (best.n_measurements >= fewest or not best.n_measurements)
        return _decided(state, best) if is_decided else _undecided(state, [rivals[k] for k in order], weights[order])

    def _with_repentant(self, state: FilterState) -> FilterState:
        """Return a state that believes again who has agreed with the others over a window in which the robot moved."""
        faults = dict(state.consistency.faults)
        for source, fault in state.consistency.faults.items():
            anchors = [anchor for anchor in state.consistency.anchors if anchor.stamp_s >= fault.since_s]
            if not anchors or state.stamp_s - anchors[0].stamp_s < WINDOW_S:
                continue
            trusted = self._trusted(state)
            agrees = (
                self._agree_again(state, anchors[0], [source, *trusted])
                if trusted
                else self._agrees_with_corrections(state, anchors[0], source)
            )
            if agrees:
                del faults[source]
        if len(faults) == len(state.consistency.faults):
            return state
        return replace(state, consistency=state.consistency._replace(faults=faults, anchors=(), measurements=()))

    def _agree_again(self, state: FilterState, anchor: FilterState, sources: Sequence[str]) -> bool:
        motions = [motion for source in sources if (motion := motion_since(state, anchor, source)) is not None]
        dt_s = state.stamp_s - anchor.stamp_s - 1e-6
        if len(motions) < len(sources) or any(is_still(motion) or motion.covered_s < dt_s for motion in motions):
            return False
        return len(agreeing_groups(state, anchor, sources, self._tolerance)) == 1

    def _agrees_with_corrections(self, state: FilterState, anchor: FilterState, source: str) -> bool:
        """Return whether a motion is as long, and turns as far, as the belief has moved by absolute estimates alone."""
        motion = motion_since(state, anchor, source)
        covered_s = 0.0 if motion is None else motion.covered_s
        if covered_s < state.stamp_s - anchor.stamp_s - 1e-6:
            return False
        if motion is None or state.gaussian is None or anchor.gaussian is None or is_still(motion):
            return False
        moved = state.gaussian.x[:3] - anchor.gaussian.x[:3]
        spread = (state.gaussian.covariance + anchor.gaussian.covariance)[:3, :3].diagonal()
        sigma_m = math.sqrt(max(spread[0], spread[1]) + motion.position_m2)
        way_m, says_m = math.hypot(moved[0], moved[1]), math.hypot(motion.x, motion.y)
        turn = abs(wrap_angle(float(moved[2]) - motion.turn))
        is_informative = way_m > 5.0 * sigma_m
        return (
            is_informative
            and abs(way_m - says_m) < 2.5 * sigma_m
            and turn < 2.5 * math.sqrt(spread[2] + motion.turn_rad2)
        )

    def _reason(self, state: FilterState, anchor: FilterState, source: str, believed: frozenset[str]) -> str:
        dt_s = state.stamp_s - anchor.stamp_s
        motion = motion_since(state, anchor, source)
        said = "nothing" if motion is None else _in_words(motion)
        others = [f"{other} {_in_words(m)}" for other in sorted(believed) if (m := motion_since(state, anchor, other))]
        if motion is not None and is_still(motion):
            said = f"no motion ({said})"
        against = " and ".join(others) if others else "absolute estimates contradict it"
        return f"its motion is not believed: {said} in {dt_s:.1f} s, {against}"


def _begun_later(rival: Rival, at_first: Rival, reference: Rival) -> Rival:
    """Return a hypothesis, begun anew from the filter of all if that explains better what was measured until here."""
    log_weight = reference.log_weight + at_first.log_weight
    if rival.log_weight > log_weight:
        return rival
    faults = rival.state.consistency.faults
    begun = replace(reference.state, consistency=reference.state.consistency._replace(faults=faults))
    return Rival(begun, log_weight)


def _in_words(motion: MotionSum) -> str:
    words = []
    if motion.position_m2 < 1e9:
        words.append(f"{math.hypot(motion.x, motion.y):.3f} m")
    if motion.turn_rad2 < 1e9:
        words.append(f"{math.degrees(motion.turn):.1f} deg")
    return ", ".join(words)


def _decided(state: FilterState, best: Rival) -> FilterState:
    leader = best.state
    consistency = _without_windows(state.consistency)._replace(
        sums=leader.consistency.sums,
        faults=leader.consistency.faults,
    )
    return _as_leader(state, leader, leader.gaussian, consistency)


def _undecided(state: FilterState, rivals: Sequence[Rival], weights: Floats) -> FilterState:
    n_kept = max(2, int((weights > _FORGOTTEN).sum()))
    rivals, weights = rivals[:n_kept], weights[:n_kept] / weights[:n_kept].sum()
    leader, since_s = rivals[0].state, state.consistency.undecided_since_s
    consistency = state.consistency._replace(
        sums=leader.consistency.sums,
        rivals=tuple(rivals),
        undecided_since_s=leader.stamp_s if since_s == math.inf else since_s,
    )
    return _as_leader(state, leader, mixture_of(rivals, weights), consistency)


def _as_leader(
    state: FilterState, leader: FilterState, gaussian: Gaussian | None, consistency: Consistency
) -> FilterState:
    """Return a state that goes on as a hypothesis says; odometry, which is published, does not jump."""
    odometry = replace(
        leader.odometry,
        pose_odom_base=state.odometry.pose_odom_base,
        travelled_m=state.odometry.travelled_m,
        has_moved=state.odometry.has_moved,
    )
    return FilterState(
        stamp_s=leader.stamp_s,
        gaussian=gaussian,
        odometry=odometry,
        fixed_at_m=state.fixed_at_m,
        rejections=replace(leader.rejections, measurements={}),
        consistency=consistency,
        left_out=leader.left_out,
        checks=leader.checks,
        verdicts=state.verdicts,
    )


def _continued(odometry: OdometryState, before: OdometryState, after: OdometryState) -> OdometryState:
    """Return odometry that goes on by what another one has moved."""
    return replace(
        after,
        pose_odom_base=odometry.pose_odom_base @ before.pose_odom_base.between(after.pose_odom_base),
        travelled_m=odometry.travelled_m + after.travelled_m - before.travelled_m,
        has_moved=odometry.has_moved or after.has_moved,
    )


def _jumps(before: FilterState, after: FilterState) -> bool:
    """Return whether a hypothesis says that the robot changed its velocity faster than robots do."""
    if before.odometry.gap_s > 0.0 or after.odometry.gap_s > 0.0 or not before.odometry.has_moved:
        return False
    steps = [
        step
        for source in after.consistency.sums
        if source not in after.consistency.faults and (step := motion_since(after, before, source)) is not None
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


def _with_new_anchor(state: FilterState) -> FilterState:
    """Return a state whose test windows begin later: the older anchor goes, and this instant is the newer one."""
    consistency = state.consistency
    bare = replace(
        state,
        consistency=consistency._replace(anchors=(), measurements=(), rivals=(), undecided_since_s=math.inf),
        verdicts=(),
    )
    anchors = (*consistency.anchors[-1:], bare)
    since_s = anchors[0].stamp_s
    measurements = tuple(one for one in consistency.measurements if one[0] > since_s)
    return replace(state, consistency=consistency._replace(anchors=anchors, measurements=measurements))


def _without_windows(consistency: Consistency) -> Consistency:
    """Return a state of the tests that begins anew."""
    return consistency._replace(anchors=(), measurements=(), rivals=(), undecided_since_s=math.inf)
