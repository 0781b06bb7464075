"""The share of time in which a localizer knew where it was."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trailmark.errors import DataError
from trailmark.evaluation.association import usual_interval_s
from trailmark.evaluation.naming import metric_name, number_text
from trailmark.geometry import Trajectory

__all__ = ["Tracked", "tracked_fraction"]

_INTERVALS = 3.0


@dataclass(frozen=True, slots=True)
class Tracked:
    """Share of a span of time that a trajectory covers.

    Attributes
    ----------
    fraction : float
        Between 0 and 1. Time counts, not answers: ten fast answers do not make up for a second without one.
    max_gap_s : float
        Two poses further apart leave the time between them uncovered [s].
    span_s : float
        The span [s].
    """

    fraction: float
    max_gap_s: float
    span_s: float

    def metrics(self) -> dict[str, float]:
        """Return the metric by name."""
        return {metric_name("tracked_fraction", f"gap<={number_text(self.max_gap_s)}s"): self.fraction}


def tracked_fraction(
    trajectory: Trajectory, start_s: float, stop_s: float, *, max_gap_s: float | None = None
) -> Tracked:
    """Return the share of ``[start_s, stop_s]`` between poses that are at most `max_gap_s` apart.

    Parameters
    ----------
    max_gap_s : float, optional
        Default: three of the trajectory's usual intervals [s].

    Raises
    ------
    DataError
        If the span is empty.
    """
    if not stop_s > start_s:
        raise DataError(f"a tracked fraction needs a span of time, not {start_s} to {stop_s} s")
    if len(trajectory) < 2:
        return Tracked(0.0, max_gap_s or 0.0, stop_s - start_s)
    gap_s = _INTERVALS * usual_interval_s(trajectory.stamps_s) if max_gap_s is None else max_gap_s
    clipped = np.clip(trajectory.stamps_s, start_s, stop_s)
    covered = np.diff(clipped)[np.diff(trajectory.stamps_s) <= gap_s].sum()
    return Tracked(float(covered) / (stop_s - start_s), gap_s, stop_s - start_s)
