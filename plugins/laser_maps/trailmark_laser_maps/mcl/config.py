"""Config of the localizer."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from trailmark.config import ExistingPath, PluginConfig, Sensor

__all__ = ["GridMclConfig"]


class GridMclConfig(PluginConfig):
    """Adaptive Monte Carlo localization of a planar laser on an occupancy grid."""

    laser: Sensor["scan"]
    """The laser."""
    map: ExistingPath | None = None
    """The map.yaml of an occupancy grid; left out: the scans of the taught place."""
    motion: Literal["differential", "holonomic"] = "differential"
    """Whether the robot slips to the side as much as it errs ahead."""
    n_start: int = Field(200_000, ge=1000, le=5_000_000)
    """Poses drawn over the map when nothing is known."""
    n_search: int = Field(20_000, ge=100, le=1_000_000)
    """Poses drawn at each further scan until a place is found."""
    n_fewest: int = Field(500, ge=50)
    """Particles at least; how many more there are follows from their spread (KLD sampling)."""
    n_most: int = Field(20_000, ge=500)
    """Particles at most."""
    n_rays: int = Field(120, ge=20)
    """Rays of a scan that are looked at, spread evenly."""
    max_range_m: float = Field(30.0, gt=0)
    """Longer returns are not used [m]."""
    min_quality: float = Field(0.6, gt=0, le=1)
    """Share of the rays that a place must explain (end within 0.15 m of a wall, none in the way); below it: lost. A
    place that nobody named must explain half of the rest too."""
    margin: float = Field(0.25, gt=0, le=1)
    """By how much of the rays a place must be better than any other to be believed after one look; after n looks the
    root of n times less."""
    start_sigma_m: float = Field(0.3, gt=0)
    """Standard deviation of a start pose that is given [m]."""
    start_sigma_deg: float = Field(10.0, gt=0)
    """Standard deviation of its heading [deg]."""
    map_sigma_m: float = Field(0.008, gt=0)
    """What no fix is better than on a straight map; how crooked the map is, scans tell [m]."""
    map_sigma_deg: float = Field(0.1, gt=0)
    """The same of the heading [deg]."""
    keyframe_m: float = Field(0.2, gt=0)
    """In teach, a scan is remembered every so far [m]."""
    keyframe_deg: float = Field(15.0, gt=0)
    """In teach, a scan is remembered after a turn of this much [deg]."""
    resolution_m: float = Field(0.05, gt=0, le=1)
    """Side of a cell of the map that is made of a taught place [m]."""
