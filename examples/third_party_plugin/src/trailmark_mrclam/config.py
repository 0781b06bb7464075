"""Configs of the source and the localizer."""

from __future__ import annotations

from pydantic import Field

from trailmark.config import ExistingPath, PluginConfig, Sensor, SourceConfig

__all__ = ["MrclamLandmarksConfig", "RangeBearingConfig"]


class MrclamLandmarksConfig(SourceConfig):
    """Sightings of one robot of a UTIAS MRCLAM recording."""

    path: ExistingPath
    """``RobotN_Measurement.dat``."""
    barcodes: ExistingPath | None = None
    """Which barcode each subject bears; default: ``Barcodes.dat`` beside it."""
    landmarks: ExistingPath | None = None
    """Where the landmarks stand; default: ``Landmark_Groundtruth.dat`` beside it."""


class RangeBearingConfig(PluginConfig):
    """Landmarks at known places."""

    sightings: Sensor["range_bearing"]
    """Sees landmarks at ranges and bearings."""
    range_sigma_m: float = Field(0.2, gt=0)
    """Standard deviation of a range [m]."""
    bearing_sigma_deg: float = Field(4.6, gt=0)
    """Standard deviation of a bearing [deg]."""
