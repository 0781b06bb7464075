"""A planar laser and a floor plan: occupancy grids of ROS, a robot found on them, and motion from scans alone.

The names below are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark.lazy import lazy_names

if TYPE_CHECKING:
    from trailmark_laser_maps.mcl.config import GridMclConfig
    from trailmark_laser_maps.mcl.localizer import GridMcl
    from trailmark_laser_maps.odometry.config import ScanOdometryConfig
    from trailmark_laser_maps.odometry.localizer import ScanOdometry

__all__ = ["GridMcl", "GridMclConfig", "ScanOdometry", "ScanOdometryConfig"]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "mcl.config": ("GridMclConfig",),
        "mcl.localizer": ("GridMcl",),
        "odometry.config": ("ScanOdometryConfig",),
        "odometry.localizer": ("ScanOdometry",),
    },
)
