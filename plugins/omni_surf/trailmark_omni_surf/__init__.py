"""Omnidirectional camera and laser (Tasaki et al. 2010). The names below are imported on first use."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark.lazy import lazy_names

if TYPE_CHECKING:
    from trailmark_omni_surf.bearings import BearingFix, BearingNoise, locate
    from trailmark_omni_surf.circle import BearingCamera, ImageCircle, find_circle
    from trailmark_omni_surf.config import OmniSurfConfig
    from trailmark_omni_surf.features import Features, create_features, match
    from trailmark_omni_surf.landmarks import LandmarkMeasurement, measure_landmark
    from trailmark_omni_surf.laser.config import LaserIcpConfig
    from trailmark_omni_surf.laser.localizer import LaserIcp
    from trailmark_omni_surf.laser.matching import ScanMatch, SearchWindow, match_scan
    from trailmark_omni_surf.laser.scan_map import ScanMap
    from trailmark_omni_surf.localizer import OmniSurf
    from trailmark_omni_surf.surf.detector import Surf, SurfOptions

__all__ = [
    "BearingCamera",
    "BearingFix",
    "BearingNoise",
    "Features",
    "ImageCircle",
    "LandmarkMeasurement",
    "LaserIcp",
    "LaserIcpConfig",
    "OmniSurf",
    "OmniSurfConfig",
    "ScanMap",
    "ScanMatch",
    "SearchWindow",
    "Surf",
    "SurfOptions",
    "create_features",
    "find_circle",
    "locate",
    "match",
    "match_scan",
    "measure_landmark",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "bearings": ("BearingFix", "BearingNoise", "locate"),
        "circle": ("BearingCamera", "ImageCircle", "find_circle"),
        "features": ("Features", "create_features", "match"),
        "landmarks": ("LandmarkMeasurement", "measure_landmark"),
        "laser.matching": ("ScanMatch", "SearchWindow", "match_scan"),
        "laser.scan_map": ("ScanMap",),
        "surf.detector": ("Surf", "SurfOptions"),
        "config": ("OmniSurfConfig",),
        "laser.config": ("LaserIcpConfig",),
        "laser.localizer": ("LaserIcp",),
        "localizer": ("OmniSurf",),
    },
)
