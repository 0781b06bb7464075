"""How far a trajectory stays off a taught path."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import DataError
from trailmark.evaluation.absolute import Summary, summarize
from trailmark.geometry import Pose2, Trajectory
from trailmark.paths import Path

__all__ = ["LateralError", "lateral_error", "offsets_from_path"]


@dataclass(frozen=True, slots=True)
class LateralError:
    """Distance to the side of a path, and turn from its headings.

    Attributes
    ----------
    n : int
        Number of poses.
    lateral : Summary
        Of the absolute lateral offsets [m].
    heading : Summary
        Of the absolute turns from the taught heading [rad].
    """

    n: int
    lateral: Summary
    heading: Summary

    def metrics(self) -> dict[str, float]:
        """Return the metrics by name: metres and degrees."""
        return {
            **self.lateral.metrics("lateral", "m", f"n={self.n}"),
            **self.heading.metrics("path_heading", "deg", f"n={self.n}", scale=math.degrees(1.0)),
        }


def offsets_from_path(trajectory: Trajectory, path: Path) -> Floats:
    """Return (station, lateral, heading) of each pose, (N, 3) [m, m, rad].

    Each pose is looked for near the one before it, so that a path that crosses itself is followed in order.

    Parameters
    ----------
    trajectory : Trajectory
        Poses in the frame of the path.
    path : Path
        The taught path.

    Returns
    -------
    (N, 3) float64
        Station along the path, offset to its left, and heading against its tangent [m, m, rad].
    """
    offsets = np.empty((len(trajectory), 3))
    station_m: float | None = None
    for index, pose in enumerate(trajectory.poses):
        found = path.locate(Pose2.from_array(pose), near_station_m=station_m)
        offsets[index] = found.station_m, found.lateral_m, found.heading_rad
        station_m = found.station_m
    return offsets


def lateral_error(trajectory: Trajectory, path: Path) -> LateralError:
    """Return how far a trajectory, in the frame of the path, stays off it.

    Parameters
    ----------
    trajectory : Trajectory
        Poses in the frame of the path.
    path : Path
        The taught path.

    Returns
    -------
    LateralError
        Number of poses, and summaries of their absolute offsets [m] and headings [rad].

    Raises
    ------
    DataError
        If the trajectory is empty.
    """
    if len(trajectory) == 0:
        raise DataError("the trajectory is empty, so it has no lateral error")
    offsets = offsets_from_path(trajectory, path)
    return LateralError(len(trajectory), summarize(offsets[:, 1]), summarize(offsets[:, 2]))
