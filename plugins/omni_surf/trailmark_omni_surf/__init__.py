"""Omnidirectional camera and laser (Tasaki et al. 2010). The names below are imported on first use."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trailmark_omni_surf.bearings import BearingFix, BearingNoise, locate
    from trailmark_omni_surf.circle import BearingCamera, ImageCircle, find_circle
    from trailmark_omni_surf.features import Features, create_features, match
    from trailmark_omni_surf.landmarks import LandmarkMeasurement, measure_landmark
    from trailmark_omni_surf.laser.matching import ScanMatch, SearchWindow, match_scan
    from trailmark_omni_surf.laser.scan_map import ScanMap
    from trailmark_omni_surf.surf.detector import Surf, SurfOptions

__all__ = [
    "BearingCamera",
    "BearingFix",
    "BearingNoise",
    "Features",
    "ImageCircle",
    "LandmarkMeasurement",
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

_HOMES = {
    "bearings": ("BearingFix", "BearingNoise", "locate"),
    "circle": ("BearingCamera", "ImageCircle", "find_circle"),
    "features": ("Features", "create_features", "match"),
    "landmarks": ("LandmarkMeasurement", "measure_landmark"),
    "laser.matching": ("ScanMatch", "SearchWindow", "match_scan"),
    "laser.scan_map": ("ScanMap",),
    "surf.detector": ("Surf", "SurfOptions"),
}


def __getattr__(name: str) -> Any:
    for module, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
