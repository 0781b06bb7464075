"""Alignment of an estimate with the truth in the plane, in closed form.

Aligners in space need a path that spans a plane: they fail on straight paths and roll about nearly
straight ones. In the plane the rotation is the angle of one summed vector, so a line is enough.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from trailmark.errors import ConfigError
from trailmark.evaluation.association import Pairs
from trailmark.geometry import Pose2, Trajectory
from trailmark.geometry.rigid import fit_pose2

__all__ = ["ALIGNMENTS", "STATIC_M", "AlignKind", "Alignment", "align"]

AlignKind = Literal["none", "origin", "se2"]
ALIGNMENTS: tuple[AlignKind, ...] = get_args(AlignKind)

#: A trajectory whose positions stay this near to their mean (rms) stands still: no direction can be told [m].
STATIC_M = 1e-3


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
    stands still no direction can be told: ``se2`` falls back to ``origin`` and says so.

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
    return Alignment(kind, "se2", fit_pose2(pairs.truth.positions, pairs.estimate.positions))


def _origin(pairs: Pairs) -> Pose2:
    return pairs.truth[0][1] @ pairs.estimate[0][1].inverse()


def _is_static(trajectory: Trajectory) -> bool:
    offsets = trajectory.positions - trajectory.positions.mean(axis=0)
    return bool(np.sqrt((offsets * offsets).sum(axis=1).mean()) < STATIC_M)
