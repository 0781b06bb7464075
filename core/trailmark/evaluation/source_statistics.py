"""What each localizer of a run said: outcomes, latency, and whether its covariances say the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import DataError
from trailmark.evaluation.consistency import Consistency, consistency_of, nees
from trailmark.evaluation.estimate_errors import estimate_errors
from trailmark.evaluation.estimates_table import EstimateTable
from trailmark.evaluation.latency import Percentiles, percentiles
from trailmark.evaluation.map_frame import ONE_FRAME, MapFrame
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
    estimates: EstimateTable,
    truth: Trajectory | None = None,
    map_frame: MapFrame = ONE_FRAME,
    path: Path | None = None,
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
        The taught path; without it path offsets are not compared with the truth.
    """
    age_s = estimates.arrived_s - estimates.stamp_s
    age_s = age_s[np.isfinite(age_s) & (estimates.outcome != "lost")]
    return SourceStatistics(
        n=len(estimates),
        outcomes=estimates.counts(),
        latency=percentiles(age_s) if len(age_s) else None,
        nis=_consistency_or_none(estimates.nis, estimates.dof),
        nees=None if truth is None else _nees(estimates, truth, map_frame, path),
    )


def _consistency_or_none(squares: Floats, dof: Floats) -> Consistency | None:
    try:
        return consistency_of(squares, dof)
    except DataError:
        return None


def _nees(estimates: EstimateTable, truth: Trajectory, map_frame: MapFrame, path: Path | None) -> Consistency | None:
    found = estimate_errors(estimates, truth, map_frame, path)
    known = np.isfinite(found.errors).all(axis=1) & np.isfinite(found.information).all(axis=(1, 2))
    return _consistency_or_none(*nees(found.errors[known], found.information[known]))
