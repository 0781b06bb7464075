"""Routes that a vehicle can be sent along."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trailmark.geometry import Pose2
from trailmark.paths import Path, Waypoint

__all__ = ["Route"]


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """A way through a world and the speed to drive it with.

    Attributes
    ----------
    path : Path
        Poses along the way, dense enough (about 10 mm) that straight lines between them do.
    speed_mps : float
        Speed to drive with [m/s].
    summary : str
        What it is, in a few words.
    """

    path: Path
    speed_mps: float
    summary: str = ""

    @classmethod
    def from_poses(cls, poses: npt.ArrayLike, speed_mps: float, summary: str = "") -> Route:
        """Return the route of poses (N, 3) as x, y, theta [m, m, rad]."""
        rows = np.asarray(poses, dtype=np.float64)
        stations = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(rows[:, :2], axis=0).T))])
        waypoints = [Waypoint(i, float(s), Pose2.from_array(row)) for i, (s, row) in enumerate(zip(stations, rows))]
        return cls(Path(waypoints), speed_mps, summary)
