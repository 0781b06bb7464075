"""Alignment of an estimate with the truth in the plane, in closed form.

Aligners in space need a path that spans a plane: they fail on straight paths and roll about nearly
straight ones. In the plane the rotation is the angle of one summed vector, so a line is enough.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import ConfigError
from trailmark.evaluation.association import Pairs
from trailmark.geometry import Pose2, Trajectory
from trailmark.geometry.rigid import fit_pose2

__all__ = ["ALIGNMENTS", "STATIC_M", "UNDETERMINED_RAD", "AlignKind", "Alignment", "align", "rotation_sigma_rad"]

AlignKind = Literal["none", "origin", "se2"]
ALIGNMENTS: tuple[AlignKind, ...] = get_args(AlignKind)

#: A trajectory whose positions stay this near to their mean (rms) stands still: no direction can be told [m].
STATIC_M = 1e-3
#: A turn that the way tells with a larger standard deviation than this is not applied [rad].
UNDETERMINED_RAD = math.radians(10.0)


@dataclass(frozen=True, slots=True)
class Alignment:
    """How an estimate was brought into the frame of the truth.

    Attributes
    ----------
    asked, used : {"none", "origin", "se2"}
        They differ where the one asked for does not exist.
    pose_truth_estimate : Pose2
        ``pose_truth = pose_truth_estimate @ pose_estimate``.
    reason : str
        Why another alignment was used; empty otherwise.
    """

    asked: AlignKind
    used: AlignKind
    pose_truth_estimate: Pose2
    reason: str = ""

    def apply(self, estimate: Trajectory) -> Trajectory:
        """Return the estimate in the frame of the truth."""
        return estimate.transformed(self.pose_truth_estimate)

    def document(self) -> dict[str, object]:
        """Return what was used, for a report."""
        x, y, theta = self.pose_truth_estimate.array().tolist()
        return {"asked": self.asked, "used": self.used, "reason": self.reason, "x": x, "y": y, "theta": theta}


def align(pairs: Pairs, kind: AlignKind = "se2") -> Alignment:
    """Return the alignment of the estimate with the truth.

    ``none`` compares in the frame of the map; ``origin`` lays the first pose of the estimate on the first
    true pose; ``se2`` minimises the squared distances of all positions:

        R, t = argmin sum_i |R e_i + t - g_i|^2,  angle = atan2(sum e'_i x g'_i, sum e'_i . g'_i)

    with e' and g' relative to their means (Umeyama 1991 in two dimensions without scale). Where one of the two
    stands still, or the way is so short against the errors that its direction is a guess, ``se2`` falls back to
    ``origin`` and says so.

    Parameters
    ----------
    pairs : Pairs
        Estimated and true poses at equal stamps.
    kind : AlignKind
        Which alignment.

    Returns
    -------
    Alignment
        The transform ``pose_truth_estimate`` and the kind that was used.

    Raises
    ------
    ConfigError
        If the kind is unknown.
    """
    if kind not in ALIGNMENTS:
        raise ConfigError(f"no alignment named '{kind}'; available: {', '.join(ALIGNMENTS)}")
    if kind == "none":
        return Alignment(kind, "none", Pose2())
    if kind == "origin":
        return Alignment(kind, "origin", _origin(pairs))
    static = [name for name, item in (("estimate", pairs.estimate), ("truth", pairs.truth)) if _is_static(item)]
    if static:
        reason = f"the {' and the '.join(static)} stands still, so no direction can be told"
        return Alignment(kind, "origin", _origin(pairs), reason)
    fit = fit_pose2(pairs.truth.positions, pairs.estimate.positions)
    residuals = fit @ pairs.estimate.positions - pairs.truth.positions
    sigma_rad = rotation_sigma_rad(pairs.truth.positions, residuals, is_one_error=True)
    if sigma_rad > UNDETERMINED_RAD:
        extent_m, degrees = _rms(_subtract_mean(pairs.truth.positions)), math.degrees(sigma_rad)
        known = f"known to {degrees:.0f}° only" if degrees < 90.0 else "not known"
        reason = (
            f"the way spreads by {extent_m:.2g} m and the errors by {_rms(residuals):.2g} m, so that its direction is"
            f" {known}"
        )
        return Alignment(kind, "origin", _origin(pairs), reason)
    return Alignment(kind, "se2", fit)


def rotation_sigma_rad(positions: Floats, residuals: Floats, *, is_one_error: bool = False) -> float:
    """Return the standard deviation of the turn of a fit.

    ``sigma = s / (L sqrt(n))``: s the residuals of one coordinate, L the root mean square distance from the middle, n
    the number of independent residuals, ``N (1 - rho) / (1 + rho)`` with their correlation rho from one to the next.

    Parameters
    ----------
    positions, residuals : (N, 2) float64
        Where the pairs are, and what the fit leaves of them [m].
    is_one_error : bool
        n = 1: what drifts has many poses and one error, and its correlation from one pose to the next hides that.

    Returns
    -------
    float
        ``inf`` where all positions coincide [rad].
    """
    extent, spread = _rms(_subtract_mean(positions)), _rms(residuals) / math.sqrt(2.0)
    if extent == 0.0:
        return math.inf
    if is_one_error or spread == 0.0:
        return spread / extent
    rho = max(0.0, float((residuals[1:] * residuals[:-1]).sum() / (residuals * residuals).sum()))
    return spread / (extent * math.sqrt(max(len(residuals) * (1.0 - rho) / (1.0 + rho), 1.0)))


def _origin(pairs: Pairs) -> Pose2:
    return pairs.truth[0][1] @ pairs.estimate[0][1].inverse()


def _is_static(trajectory: Trajectory) -> bool:
    return _rms(_subtract_mean(trajectory.positions)) < STATIC_M


def _subtract_mean(positions: Floats) -> Floats:
    return np.asarray(positions - positions.mean(axis=0))


def _rms(offsets: Floats) -> float:
    return math.sqrt(float((offsets * offsets).sum(axis=1).mean()))
