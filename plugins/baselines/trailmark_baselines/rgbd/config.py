"""Config of the ORB + depth baseline."""

from __future__ import annotations

from pydantic import Field

from trailmark.config import PluginConfig, Sensor

__all__ = ["OrbRgbdConfig"]


class OrbRgbdConfig(PluginConfig):
    """Motion between pictures: ORB features with depth, RANSAC, rigid alignment (Kabsch)."""

    camera: Sensor["rgbd"]
    """Colour camera with depth registered to it, and a calibration."""
    features: int = Field(800, ge=50)
    """ORB features in each picture."""
    far_m: float = Field(5.0, gt=0.0)
    """Features farther than this are not used [m]."""
    tolerance_m: float = Field(0.03, gt=0.0)
    """Distance at which a pair counts as agreeing, at 1 m; grows with the square of the depth [m]."""
    min_pairs: int = Field(12, ge=3)
    """Pairs that must agree."""
    tries: int = Field(200, ge=10)
    """Minimal sets of three pairs that are tried."""
