"""The pose that most of an instant's sightings agree on, or none."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.geometry import wrap_angles
from trailmark_landmarks.sightings import Sightings

__all__ = ["Consensus", "find_consensus"]

_UNKNOWNS = 3
_MOST_STEPS = 12
_SETTLED = 1e-9  # [m, rad]
_ELSEWHERE_M, _ELSEWHERE_RAD = 0.5, math.radians(10.0)
_WORST_CONDITION = 1e10
_MOST_SUSPECTS = 5
#: So much of the noise is known from before, in numbers seen, when an instant's own misfit says that it is larger.
_PRIOR_NUMBERS = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Consensus:
    """A pose from the sightings of one instant alone.

    Attributes
    ----------
    pose : (3,) float64
        Of the sensor in the map [m, m, rad].
    information : (3, 3) float64
        Of the pose, with the noise as large as the misfit says, where that is larger than what was known before.
    agrees : (M,) bool
        Which numbers agree with it.
    errors : (M,) float64
        Measured minus expected at the pose [m, rad].
    leverages : (M,) float64
        How far each number pulled the pose to itself, 0 to 1; its error has ``1 - leverage`` of the variance.
    """

    pose: Floats
    information: Floats
    agrees: Bools
    errors: Floats
    leverages: Floats


def find_consensus(sightings: Sightings, candidates: Floats, max_position_sigma_m: float) -> Consensus | str:
    """Return the pose that more numbers than a pose takes agree on, or in a few words why there is none.

    Three numbers agree with some pose whatever is wrong with them, so four must; they must be more than half of all
    ranges and more than half of all bearings, and more than agree with any pose elsewhere. All ranges alone agree with
    a mirrored map, and where bearings are in a wrong unit: a bearing or two beside them agree by chance.

    Parameters
    ----------
    sightings : Sightings
        What is seen.
    candidates : (C, 3) float64
        Poses to begin with.
    max_position_sigma_m : float
        A position less certain than this along its worst direction is none [m].
    """
    if len(sightings) <= _UNKNOWNS:
        return f"{len(sightings)} numbers are seen, and four are needed to tell a pose and see that it is right"
    if not len(candidates):
        return "ranges alone tell no heading" if not sightings.is_bearing.any() else "the landmarks determine no pose"
    best = _refine(sightings, candidates[int(_scores(sightings, candidates).argmin())])
    if best is None:
        return "the landmarks determine no pose"
    n_agree = int(best.agrees.sum())
    if n_agree <= max(_UNKNOWNS, len(sightings) / 2.0):
        return f"only {n_agree} of {len(sightings)} numbers agree on a pose"
    for kind, is_kind in (("ranges", ~sightings.is_bearing), ("bearings", sightings.is_bearing)):
        n_of_kind, n_agree = int(is_kind.sum()), int(best.agrees[is_kind].sum())
        if n_of_kind and n_agree <= n_of_kind / 2.0:
            return f"only {n_agree} of {n_of_kind} {kind} agree with the pose that most numbers agree on"
    if _rival_agrees(sightings, candidates, best):
        return "two places fit what is seen"
    if _worst_sigma_m(best.information) > max_position_sigma_m:
        return f"the position is less certain than {max_position_sigma_m:g} m"
    return best


def _refine(sightings: Sightings, pose: Floats) -> Consensus | None:
    """Return the least-squares pose over the numbers within their gates (Gauss-Newton); None: not determined."""
    agrees = np.abs(sightings.errors(pose)) <= sightings.gates
    for _ in range(_MOST_STEPS):
        if agrees.sum() < _UNKNOWNS:
            return None
        weighted = sightings.derivatives(pose)[agrees] / sightings.sigmas[agrees, np.newaxis]
        normal = weighted.T @ weighted
        if not np.isfinite(normal).all() or np.linalg.cond(normal) > _WORST_CONDITION:
            return None
        step = np.linalg.solve(normal, weighted.T @ (sightings.errors(pose)[agrees] / sightings.sigmas[agrees]))
        pose = pose + step
        before, agrees = agrees, np.abs(sightings.errors(pose)) <= sightings.gates
        if np.abs(step).max() < _SETTLED and np.array_equal(before, agrees):
            break
    else:
        return None
    return _describe(sightings, pose, agrees)


def _describe(sightings: Sightings, pose: Floats, agrees: Bools) -> Consensus:
    errors = sightings.errors(pose)
    weighted = sightings.derivatives(pose) / sightings.sigmas[:, np.newaxis]
    information = weighted[agrees].T @ weighted[agrees]
    leverages = np.einsum("mi,ij,mj->m", weighted, np.linalg.inv(information), weighted)
    misfit = float(((errors / sightings.sigmas)[agrees] ** 2).sum())
    spare = int(agrees.sum()) - _UNKNOWNS
    inflation = max(1.0, (_PRIOR_NUMBERS + misfit) / (_PRIOR_NUMBERS + spare))
    return Consensus(pose, information / inflation, agrees, errors, np.clip(leverages, 0.0, 1.0))


def _rival_agrees(sightings: Sightings, candidates: Floats, best: Consensus) -> bool:
    """Return whether a pose elsewhere, itself the best about there, is agreed on by as many numbers."""
    elsewhere = candidates[_is_elsewhere(candidates, best.pose)]
    counts = (np.abs(sightings.errors(elsewhere)) <= sightings.gates).sum(axis=1)
    suspects = elsewhere[counts >= best.agrees.sum()]
    scores = _scores(sightings, suspects)
    for suspect in suspects[np.argsort(scores, kind="stable")[:_MOST_SUSPECTS]]:
        rival = _refine(sightings, suspect)
        if rival is not None and rival.agrees.sum() >= best.agrees.sum() and _is_elsewhere(rival.pose, best.pose):
            return True
    return False


def _scores(sightings: Sightings, poses: Floats) -> Floats:
    """Return how badly the numbers agree with each pose; one beyond its gate counts as one on it."""
    return np.asarray(np.minimum((sightings.errors(poses) / sightings.gates) ** 2, 1.0).sum(axis=1))


def _is_elsewhere(poses: Floats, pose: Floats) -> Bools:
    """Return which poses, (..., 3), are another place or heading than `pose`."""
    is_far = np.hypot(poses[..., 0] - pose[0], poses[..., 1] - pose[1]) > _ELSEWHERE_M
    return np.asarray(is_far | (np.abs(wrap_angles(poses[..., 2] - pose[2])) > _ELSEWHERE_RAD))


def _worst_sigma_m(information: Floats) -> float:
    """Return the standard deviation of the position along its worst direction [m]."""
    covariance = np.linalg.inv(information)
    return math.sqrt(float(np.linalg.eigvalsh(covariance[:2, :2])[-1]))
