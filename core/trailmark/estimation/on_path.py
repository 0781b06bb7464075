"""A belief in the coordinates of a path."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark.estimates import PathOffset
from trailmark.estimation.symmetric import ZERO, Sym3, congruence, frozen_matrix, inverse, sheared
from trailmark.geometry import Pose2

if TYPE_CHECKING:
    from trailmark.paths import Path

__all__ = ["covariance_on_path", "offset_on_path"]


def offset_on_path(
    path: Path, pose: Pose2, covariance: Sym3, *, stamp_s: float, near_station_m: float | None
) -> PathOffset:
    """Return a belief in the coordinates of a path.

    Parameters
    ----------
    path : Path
        The path.
    pose : Pose2
        Base in the map.
    covariance : Sym3
        Of `pose`.
    stamp_s : float
        The instant that the belief is about [s].
    near_station_m : float or None
        Where the belief before was [m].
    """
    located = path.locate(pose, near_station_m)
    information = inverse(covariance_on_path(covariance, path, located.station_m)) or ZERO
    return PathOffset(stamp_s, located.station_m, located.lateral_m, located.heading_rad, frozen_matrix(information))


def covariance_on_path(covariance: Sym3, path: Path, station_m: float) -> Sym3:
    """Return the covariance of (station, lateral, heading) of a covariance of (x, y, theta)."""
    line = path.line_at(station_m)
    along = congruence(covariance, line.cos, -line.sin, 0.0, 0.0)
    return sheared(along, -path.turn_rate_at(station_m))
