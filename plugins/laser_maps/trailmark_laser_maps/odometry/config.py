"""Config of the localizer."""

from __future__ import annotations

from pydantic import Field

from trailmark.config import PluginConfig, Sensor

__all__ = ["ScanOdometryConfig"]


class ScanOdometryConfig(PluginConfig):
    """Motion of a planar laser from scan to the scans before it, point to line."""

    laser: Sensor["scan"]
    """The laser."""
    keep_scans: int = Field(12, ge=1, le=200)
    """So many scans of the last way are matched to."""
    keyscan_m: float = Field(0.25, gt=0)
    """A scan joins them every so far [m]."""
    keyscan_deg: float = Field(10.0, gt=0)
    """And after a turn of this much [deg]."""
    n_rays: int = Field(240, ge=30)
    """Rays of a scan that are matched, spread evenly."""
    max_range_m: float = Field(30.0, gt=0)
    """Longer returns are not used [m]."""
    min_share: float = Field(0.6, gt=0, le=1)
    """Below this share of points within 0.15 m of the scans before, the scan does not match: lost."""
    sigma_m: float = Field(0.015, gt=0)
    """Standard deviation of the distance of a return to its wall; the residual takes its place where larger [m]."""
