"""Where else base may be, after a question that nothing has decided.

Motions that have disagreed and agree again move every hypothesis alike: each stays where it is from the belief, seen
in the map, by a constant transform. So a question is remembered until an absolute estimate comes, at no cost; the
estimate then finds hypotheses that differ by where base is, and decides between them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimation.kalman.bank import mixture_of, posterior
from trailmark.estimation.kalman.diagnosis import Alternative, FaultDiagnosis, RivalFilter
from trailmark.estimation.kalman.lasting_errors import turn_columns
from trailmark.estimation.kalman.state import FilterState, Gaussian
from trailmark.estimation.kalman.windows import without_windows
from trailmark.geometry import Pose2, wrap_angle

__all__ = ["believed_gaussian", "closed_question", "reopened_question"]

_MOST = 8
# A less probable hypothesis is forgotten.
_FORGOTTEN = 1e-6
# One that is nearer, in standard deviations of the belief, is covered by it.
_NEAR = 1.0


def closed_question(state: FilterState) -> FilterState:
    """Return a state whose question is about motion no more, as all agree again, but about where base is.

    The most probable hypothesis is the belief, with the mean of the covariances of all.
    """
    diagnosis = state.diagnosis
    weights = posterior(diagnosis.rivals)
    order = np.argsort(-weights, kind="stable")
    rivals, weights = [diagnosis.rivals[k] for k in order], weights[order]
    best = rivals[0].state.gaussian
    if best is None:
        return replace(state, diagnosis=without_windows(diagnosis))
    found, covariance = [], np.zeros_like(best.covariance)
    accused = diagnosis.accused | {source for rival in rivals for source in rival.state.diagnosis.faults}
    for rival, weight in zip(rivals, weights.tolist()):
        gaussian = rival.state.gaussian
        if gaussian is None or weight < _FORGOTTEN:
            continue
        shift = _pose_of(gaussian.x) @ _pose_of(best.x).inverse()
        turning = _turning(shift, len(best.x))
        covariance += weight * turning.T @ gaussian.covariance @ turning
        found.append(Alternative(shift, math.log(weight / weights[0]), rival.n_measurements))
    before = diagnosis.alternatives or (Alternative(Pose2(), 0.0, 0),)
    both = [
        Alternative(old.shift @ new.shift, old.log_weight + new.log_weight, max(old.n_measurements, new.n_measurements))
        for old in before
        for new in found
    ]
    gaussian, alternatives = _without_near(Gaussian(best.x, covariance, best.lasting), both)
    return replace(
        state,
        gaussian=gaussian,
        diagnosis=without_windows(diagnosis)._replace(
            alternatives=alternatives, accused=frozenset(accused) if alternatives else frozenset()
        ),
    )


def reopened_question(state: FilterState) -> FilterState:
    """Return a state with a filter for each place where base may be, for an absolute estimate to decide."""
    diagnosis = state.diagnosis
    bare = FaultDiagnosis(
        diagnosis.sums, faults=diagnosis.faults, absolute_faults=diagnosis.absolute_faults, doubts=diagnosis.doubts
    )
    rivals = diagnosis.rivals or (RivalFilter(replace(state, diagnosis=bare, verdicts=()), 0.0),)
    expanded = tuple(
        replace(
            rival,
            state=replace(rival.state, gaussian=_shifted(rival.state.gaussian, one.shift)),
            log_weight=rival.log_weight + one.log_weight,
            n_measurements=max(rival.n_measurements, one.n_measurements),
        )
        for rival in rivals
        for one in diagnosis.alternatives
    )
    return replace(state, diagnosis=diagnosis._replace(rivals=expanded, alternatives=()))


def believed_gaussian(state: FilterState) -> Gaussian | None:
    """Return mean and covariance of all places where base may be."""
    if not state.diagnosis.alternatives or state.gaussian is None:
        return state.gaussian
    alternatives = state.diagnosis.alternatives
    rivals = [
        RivalFilter(replace(state, gaussian=_shifted(state.gaussian, one.shift)), one.log_weight)
        for one in alternatives
    ]
    return mixture_of(rivals, posterior(rivals))


def _without_near(gaussian: Gaussian, alternatives: Sequence[Alternative]) -> tuple[Gaussian, tuple[Alternative, ...]]:
    """Return a belief that covers the alternatives next to it, and the others; none if it covers all."""
    kept = sorted(alternatives, key=lambda one: -one.log_weight)[:_MOST]
    total = sum(math.exp(one.log_weight) for one in kept)
    covariance = gaussian.covariance.copy()
    sigmas = np.sqrt(covariance.diagonal()[:3])
    far = []
    for one in kept:
        away = _shifted_pose(gaussian.x, one.shift).array() - gaussian.x[:3]
        away[2] = wrap_angle(float(away[2]))
        if (np.abs(away) > _NEAR * sigmas).any():
            far.append(one)
        else:
            covariance[:3, :3] += math.exp(one.log_weight) / total * np.outer(away, away)
    if not far:
        return Gaussian(gaussian.x, covariance, gaussian.lasting), ()
    return gaussian, tuple(kept)


def _shifted(gaussian: Gaussian | None, shift: Pose2) -> Gaussian | None:
    if gaussian is None:
        return None
    turning = _turning(shift, len(gaussian.x))
    x = np.concatenate([_shifted_pose(gaussian.x, shift).array(), gaussian.x[3:]])
    lasting = turn_columns(gaussian.lasting, math.cos(shift.theta), math.sin(shift.theta))
    return Gaussian(x, turning @ gaussian.covariance @ turning.T, lasting)


def _shifted_pose(x: Floats, shift: Pose2) -> Pose2:
    return shift @ _pose_of(x)


def _pose_of(x: Floats) -> Pose2:
    return Pose2(*x[:3].tolist())


def _turning(shift: Pose2, n: int) -> Floats:
    turning = np.eye(n)
    cos, sin = math.cos(shift.theta), math.sin(shift.theta)
    turning[:2, :2] = [[cos, -sin], [sin, cos]]
    return turning
