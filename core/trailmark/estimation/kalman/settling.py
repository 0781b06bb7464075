"""From a bank of hypotheses to one state: its mixture, or the one hypothesis that is left."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.bank import mixture_of, posterior
from trailmark.estimation.kalman.diagnosis import DetectedFault, FaultDiagnosis, RivalFilter
from trailmark.estimation.kalman.forgiveness import AGREED, GIVES_IN_S, without_fault
from trailmark.estimation.kalman.overruled_motion import overruled_by
from trailmark.estimation.kalman.state import FilterState, Gaussian, OdometryState
from trailmark.estimation.kalman.windows import without_windows
from trailmark.estimation.kalman.witnesses import speaks_against

__all__ = ["continued", "settle"]

_DECIDED = math.log(50.0)
# Absolute estimates that must have had a say; and more where they contradict all motion, or it contradicts them: a
# jump of theirs is found out by their own recovery after five.
_FEWEST, _FEWEST_OF_ONE_AGAINST_ALL = 2, 5
_FORGOTTEN = 1e-6


def settle(state: FilterState, rivals: Sequence[RivalFilter]) -> FilterState:
    """Return the state of a bank: its mixture, or the one hypothesis that is left.

    Between one motion and absolute estimates that have jumped nothing decides, however probable one is, nor between two
    and two. That these lie is never decided then: they agree again, or are heard again after 30 s. While another
    localizer's absolute estimates contradict that they lie, the question stays open, for longer than that, too.
    """
    rivals = _without_recovered(state, rivals)
    weights = posterior(rivals)
    order = np.argsort(-weights, kind="stable")
    best = rivals[order[0]]
    share = sum(w for rival, w in zip(rivals, weights.tolist()) if _accused_by(rival) == _accused_by(best))
    odds = math.log(share / max(1.0 - share, 1e-300))
    if odds > _DECIDED and _has_been_heard(state, best):
        not_outvoted = _not_outvoted(state, best)
        if not not_outvoted:
            return _decided(state, best, rivals)
        is_old = state.stamp_s - state.diagnosis.undecided_since_s > GIVES_IN_S
        faults = best.state.diagnosis.absolute_faults
        forgiven = [source for source in not_outvoted if is_old or faults[source].n_agreed >= AGREED]
        if forgiven:
            return _decided(state, replace(best, state=reduce(without_fault, forgiven, best.state)), rivals)
    return _undecided(state, [rivals[k] for k in order], weights[order])


def _accused_by(rival: RivalFilter) -> tuple[set[str], set[str]]:
    """Return who is not believed: hypotheses that differ only in how wrong a motion is decide together."""
    return set(rival.state.diagnosis.faults), set(rival.state.diagnosis.absolute_faults)


def _without_recovered(state: FilterState, rivals: Sequence[RivalFilter]) -> Sequence[RivalFilter]:
    """Return hypotheses without one that has given up its belief for the absolute estimates that another doubts.

    The two differ by a constant, and nothing tells them apart.
    """
    if not any(_doubted_fixes(state, rival) for rival in rivals):
        return rivals
    n_recoveries = min(rival.state.rejections.n_recoveries for rival in rivals)
    return [
        rival for rival in rivals if rival.state.rejections.n_recoveries == n_recoveries or not _believes_motion(rival)
    ]


def _believes_motion(rival: RivalFilter) -> bool:
    diagnosis = rival.state.diagnosis
    return bool(set(diagnosis.sums) - set(diagnosis.faults))


def _has_been_heard(state: FilterState, best: RivalFilter) -> bool:
    """Return whether as many absolute estimates have had a say as it takes, or none is part of the question."""
    if _is_contradicted(state, best):
        return False
    is_against_all = not _believes_motion(best) or bool(_doubted_fixes(state, best))
    fewest = _FEWEST_OF_ONE_AGAINST_ALL if is_against_all else _FEWEST
    return best.n_measurements >= fewest or not best.n_measurements


def _is_contradicted(state: FilterState, best: RivalFilter) -> bool:
    """Return whether absolute estimates of another localizer contradict that some lie, whom no others outvote."""
    faults, doubted = best.state.diagnosis.absolute_faults, _doubted_fixes(state, best)
    if not doubted or any(faults[source].contradicted_by for source in doubted):
        return False
    return any(speaks_against(said) for source, said in best.heard.items() if source not in faults)


def _doubted_fixes(state: FilterState, rival: RivalFilter) -> list[str]:
    """Return the localizers whose absolute estimates are believed no more by this hypothesis."""
    return sorted(set(rival.state.diagnosis.absolute_faults) - set(state.diagnosis.absolute_faults))


def _not_outvoted(state: FilterState, rival: RivalFilter) -> list[str]:
    """Return the localizers whose absolute estimates a hypothesis does not believe for the sake of no more motions.

    Motions that say that the robot has stopped as no robot stops outvote nobody: they may have stopped telling.
    """
    faults = rival.state.diagnosis.absolute_faults
    doubted = _doubted_fixes(state, rival)
    return [source for source in doubted if rival.is_implausible or not faults[source].is_outvoted]


def _decided(state: FilterState, best: RivalFilter, rivals: Sequence[RivalFilter]) -> FilterState:
    leader = best.state
    diagnosis = without_windows(state.diagnosis)._replace(
        sums=leader.diagnosis.sums,
        faults=leader.diagnosis.faults,
        absolute_faults=_with_offsets(best),
        doubts=leader.diagnosis.doubts,
        accused=state.diagnosis.accused if state.diagnosis.alternatives else frozenset(),
        overruled=overruled_by(state, best, rivals),
    )
    decided = _as_leader(state, leader, leader.gaussian, diagnosis)
    rejected = leader.rejections.measurements.items()  # by this very belief: what it does not believe, it covers
    still = {source: some for source, some in rejected if source in leader.diagnosis.absolute_faults}
    return replace(decided, rejections=replace(decided.rejections, measurements=still))


def _with_offsets(best: RivalFilter) -> Mapping[str, DetectedFault]:
    """Return whose absolute estimates a hypothesis does not believe, and whether they are drawn away, or late."""
    faults = dict(best.state.diagnosis.absolute_faults)
    for source, offset in best.offsets.items():
        if source in faults:
            faults[source] = replace(faults[source], is_drawn=offset.is_drawn, late=offset.late)
    return faults


def _undecided(state: FilterState, rivals: Sequence[RivalFilter], weights: Floats) -> FilterState:
    n_kept = max(2, int((weights > _FORGOTTEN).sum()))
    rivals, weights = rivals[:n_kept], weights[:n_kept] / weights[:n_kept].sum()
    leader, since_s = rivals[0].state, state.diagnosis.undecided_since_s
    diagnosis = state.diagnosis._replace(
        sums=leader.diagnosis.sums,
        rivals=tuple(rivals),
        undecided_since_s=leader.stamp_s if since_s == math.inf else since_s,
    )
    mixed = _as_leader(state, leader, mixture_of(rivals, weights), diagnosis)
    # odometry goes on by who measures it, which need not be the most probable
    odometry = replace(mixed.odometry, gap_s=state.odometry.gap_s, is_measured=state.odometry.is_measured)
    return replace(mixed, odometry=odometry)


def _as_leader(
    state: FilterState, leader: FilterState, gaussian: Gaussian | None, diagnosis: FaultDiagnosis
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
        diagnosis=diagnosis,
        left_out=leader.left_out,
        checks=leader.checks,
        verdicts=state.verdicts,
    )


def continued(odometry: OdometryState, before: OdometryState, after: OdometryState) -> OdometryState:
    """Return odometry that goes on by what another one has moved."""
    return replace(
        after,
        pose_odom_base=odometry.pose_odom_base @ before.pose_odom_base.between(after.pose_odom_base),
        travelled_m=odometry.travelled_m + after.travelled_m - before.travelled_m,
        has_moved=odometry.has_moved or after.has_moved,
    )
