"""Config of the laser localizer."""

from __future__ import annotations

from pydantic import Field

from trailmark.config import PluginConfig, Sensor

__all__ = ["LaserIcpConfig"]


class LaserIcpConfig(PluginConfig):
    """A planar laser against the taught map (Tasaki et al. 2010, Sec. IV-C, with ICP of Besl & McKay)."""

    laser: Sensor["scan"]
    """The laser."""
    error: str = Field("line", pattern="^(line|point)$")
    """Distance to the wall's line (`line`), or to its nearest point as in the original ICP (`point`)."""
    span_m: float = Field(0.8, gt=0)
    """Search around the believed position [m]."""
    span_deg: float = Field(12.0, gt=0, le=180)
    """Search around the believed heading [deg]."""
    keyframe_m: float = Field(0.1, gt=0)
    """In teach, a scan is remembered every so far [m]."""
    keyframe_deg: float = Field(10.0, gt=0)
    """In teach, a scan is remembered after a turn of this much [deg]."""
    min_hits: int = Field(2, ge=1)
    """A place enters the map when this many scans saw it: what walked through is left out."""
    min_inlier_share: float = Field(0.6, gt=0, le=1)
    """Below this share of points within 0.1 m of the map the scan does not fit; an unknown start asks for 0.9 at
    least."""
    ambiguity_margin_m: float = Field(0.01, ge=0)
    """A fit elsewhere that costs no more than this beyond the best makes the answer ambiguous [m]."""
    max_range_m: float = Field(30.0, gt=0)
    """Longer returns are not used [m]."""
    correct_while_teaching: bool = True
    """In teach, match each scan to those just before it and answer with a `Motion`; otherwise only remember."""
