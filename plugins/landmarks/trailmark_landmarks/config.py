"""Config of the localizer."""

from __future__ import annotations

from pydantic import Field

from trailmark.config import PluginConfig, Sensor

__all__ = ["KnownLandmarksConfig"]


class KnownLandmarksConfig(PluginConfig):
    """Landmarks at known places, seen at ranges, bearings or both."""

    sightings: Sensor["range_bearing", "bearing", "range"]
    """Sees the landmarks: arrays ids, ranges_m and bearings_rad, NaN where one of the two is not told."""
    landmarks: dict[int, tuple[float, float]] | None = None
    """Where they stand in the map, `{1: [0.0, 0.0], 2: [6.0, 0.0]}`; left out: as the sensor's calibration says [m]."""
    bearing_sigma_deg: float = Field(1.0, gt=0, le=45)
    """Standard deviation of a bearing to begin with; the noise that is seen takes its place [deg]."""
    range_sigma_m: float = Field(0.1, gt=0)
    """Standard deviation of a range to begin with; the noise that is seen takes its place [m]."""
    learn_noise: bool = True
    """false: the two standard deviations stay as they are."""
    mounting_sigma_deg: float = Field(1.0, ge=0)
    """How well the sensor's heading on base is known: an error that all bearings share, and so never averages out
    over the landmarks of an instant [deg]."""
    gate_bearing_deg: float = Field(8.0, gt=0, le=90)
    """A bearing farther off than this, and than 4 sigmas, is not of the landmark that it was taken for [deg]."""
    gate_range_m: float = Field(1.0, gt=0)
    """A range farther off than this, and than 4 sigmas, is not of the landmark that it was taken for [m]."""
    max_position_sigma_m: float = Field(0.5, gt=0)
    """A pose from one instant's sightings alone that is less certain than this is not told [m]."""
