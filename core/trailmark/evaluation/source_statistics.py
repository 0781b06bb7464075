"""What each localizer of a run said: outcomes, latency, and whether its covariances say the truth."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import DataError
from trailmark.evaluation.consistency import Consistency, consistency_of, nees
from trailmark.evaluation.estimate_errors import EstimateErrors, estimate_errors
from trailmark.evaluation.estimates_table import EstimateTable
from trailmark.evaluation.latency import Percentiles, percentiles
from trailmark.evaluation.lost_reasons import reasons_of
from trailmark.evaluation.map_frame import ONE_FRAME, MapFrame
from trailmark.evaluation.offset_errors import OffsetErrors, offset_errors
from trailmark.geometry import Trajectory
from trailmark.paths import Path

__all__ = ["SourceStatistics", "source_statistics"]


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
        Against the truth, of motions, fixes and path offsets; None without ground truth. Noise of the truth counts
        as the localizer's.
    offsets : OffsetErrors or None
        Of path offsets: against the truth, or where that is not known against the belief.
    says_places : bool
        Whether it said a motion or a pose; a localizer of path offsets alone has no way of its own.
    lost_reasons : dict of str to int
        Why it was lost, the most frequent first.
    """

    n: int
    outcomes: dict[str, int]
    latency: Percentiles | None
    nis: Consistency | None
    nees: Consistency | None
    offsets: OffsetErrors | None = None
    offsets_are_errors: bool = True
    says_places: bool = True
    lost_reasons: dict[str, int] = field(default_factory=dict)

    def document(self) -> dict[str, Any]:
        """Return everything, for ``metrics.json``."""
        return {
            "estimates": self.n,
            "outcomes": self.outcomes,
            "latency": self.latency.document() if self.latency else None,
            "nis": self.nis.document() if self.nis else None,
            "nees": self.nees.document() if self.nees else None,
            "lost_reasons": self.lost_reasons,
            "says_places": self.says_places,
            "metrics": {
                **(self.offsets.metrics(against_truth=self.offsets_are_errors) if self.offsets else {}),
                **(self.nis.metrics("nis") if self.nis else {}),
                **(self.nees.metrics("nees") if self.nees else {}),
            },
        }


def source_statistics(
    estimates: EstimateTable,
    truth: Trajectory | None = None,
    map_frame: MapFrame = ONE_FRAME,
    path: Path | None = None,
    fused: Trajectory | None = None,
) -> SourceStatistics:
    """Return the numbers of one localizer.

    Parameters
    ----------
    estimates : EstimateTable
        Its rows.
    truth : Trajectory, optional
        Ground truth, in its own frame.
    map_frame : MapFrame
        How the map lies in the frame of the truth.
    path : Path, optional
        The taught path; without it path offsets are not compared with anything.
    fused : Trajectory, optional
        The belief, which path offsets are compared with where the truth is not known.
    """
    judged = None if truth is None else estimate_errors(estimates, truth, map_frame, path)
    beside = estimate_errors(estimates, fused, path=path) if judged is None and fused is not None else judged
    is_place = np.isin(estimates.kind, ("motion", "fix"))
    age_s = estimates.arrived_s - estimates.stamp_s
    age_s = age_s[np.isfinite(age_s) & (estimates.outcome != "lost")]
    return SourceStatistics(
        n=len(estimates),
        outcomes=estimates.counts(),
        latency=percentiles(age_s) if len(age_s) else None,
        nis=_consistency_or_none(estimates.nis, estimates.dof),
        nees=None if judged is None else _nees(judged),
        offsets=None if beside is None else offset_errors(beside),
        offsets_are_errors=judged is not None,
        says_places=bool(is_place.any()) or not (estimates.kind == "pathoffset").any(),
        lost_reasons=reasons_of(estimates),
    )


def _consistency_or_none(squares: Floats, dof: Floats) -> Consistency | None:
    try:
        return consistency_of(squares, dof)
    except DataError:
        return None


def _nees(judged: EstimateErrors) -> Consistency | None:
    known = np.isfinite(judged.errors).all(axis=1) & np.isfinite(judged.information).all(axis=(1, 2))
    return _consistency_or_none(*nees(judged.errors[known], judged.information[known]))
