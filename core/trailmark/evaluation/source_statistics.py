"""What each localizer of a run said: outcomes, latency, and whether its covariances say the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import DataError
from trailmark.evaluation.association import poses_at, usual_interval_s
from trailmark.evaluation.consistency import Consistency, consistency_of, nees
from trailmark.evaluation.estimates_table import EstimateTable
from trailmark.evaluation.latency import Percentiles, percentiles
from trailmark.evaluation.relative import between
from trailmark.geometry import Pose2, Trajectory

__all__ = ["SourceStatistics", "source_statistics"]


_TRUTH_INTERVALS = 1.5


@dataclass(frozen=True, slots=True)
class SourceStatistics:
    """One localizer's estimates in numbers.

    Attributes
    ----------
    n : int
        Number of estimates, `Lost` included.
    outcomes : dict of str to int
        What became of them.
    latency : Percentiles or None
        From the stamp that an estimate is about to its arrival.
    nis : Consistency or None
        Against the belief; None where the estimator computes none.
    nees : Consistency or None
        Against the truth, of motions and fixes; None without ground truth. Noise of the truth counts
        as the localizer's.
    """

    n: int
    outcomes: dict[str, int]
    latency: Percentiles | None
    nis: Consistency | None
    nees: Consistency | None

    def document(self) -> dict[str, Any]:
        """Return everything, for ``metrics.json``."""
        return {
            "estimates": self.n,
            "outcomes": self.outcomes,
            "latency": self.latency.document() if self.latency else None,
            "nis": self.nis.document() if self.nis else None,
            "nees": self.nees.document() if self.nees else None,
            "metrics": {
                **(self.nis.metrics("nis") if self.nis else {}),
                **(self.nees.metrics("nees") if self.nees else {}),
            },
        }


def source_statistics(
    estimates: EstimateTable, truth: Trajectory | None = None, pose_truth_map: Pose2 | None = None
) -> SourceStatistics:
    """Return the numbers of one localizer.

    Parameters
    ----------
    estimates : EstimateTable
        Its rows.
    truth : Trajectory, optional
        Ground truth, in its own frame.
    pose_truth_map : Pose2, optional
        ``pose_truth = pose_truth_map @ pose_map``; without it fixes are not compared with the truth.
    """
    age_s = estimates.arrived_s - estimates.stamp_s
    age_s = age_s[np.isfinite(age_s) & (estimates.outcome != "lost")]
    return SourceStatistics(
        n=len(estimates),
        outcomes=estimates.counts(),
        latency=percentiles(age_s) if len(age_s) else None,
        nis=_consistency_or_none(estimates.nis, estimates.dof),
        nees=None if truth is None else _consistency_or_none(*_nees(estimates, truth, pose_truth_map)),
    )


def _consistency_or_none(squares: Floats, dof: Floats) -> Consistency | None:
    try:
        return consistency_of(squares, dof)
    except DataError:
        return None


def _nees(estimates: EstimateTable, truth: Trajectory, pose_truth_map: Pose2 | None) -> tuple[Floats, Floats]:
    stated = estimates.where(estimates.outcome != "refused")
    tolerance_s = _TRUTH_INTERVALS * usual_interval_s(truth.stamps_s)
    motions, fixes = stated.where(stated.kind == "motion"), stated.where(stated.kind == "fix")
    since, now = (poses_at(truth, stamps, tolerance_s) for stamps in (motions.since_s, motions.stamp_s))
    errors, information = [motions.numbers - between(since, now)], [motions.information]
    if pose_truth_map is not None:
        in_truth = np.broadcast_to(pose_truth_map.array(), (len(fixes), 3))
        errors.append(fixes.numbers - between(in_truth, poses_at(truth, fixes.stamp_s, tolerance_s)))
        information.append(fixes.information)
    all_errors, all_information = np.concatenate(errors), np.concatenate(information)
    known = np.isfinite(all_errors).all(axis=1) & np.isfinite(all_information).all(axis=(1, 2))
    return nees(all_errors[known], all_information[known])
