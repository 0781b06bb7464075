"""Omnidirectional camera and laser (Tasaki et al. 2010). The names below are imported on first use."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trailmark_omni_surf.bearings import BearingFix, BearingNoise, locate
    from trailmark_omni_surf.landmarks import LandmarkMeasurement, measure_landmark
    from trailmark_omni_surf.laser.matching import ScanMatch, SearchWindow, match_scan
    from trailmark_omni_surf.laser.scan_map import ScanMap

__all__ = [
    "BearingFix",
    "BearingNoise",
    "LandmarkMeasurement",
    "ScanMap",
    "ScanMatch",
    "SearchWindow",
    "locate",
    "match_scan",
    "measure_landmark",
]

_HOMES = {
    "bearings": ("BearingFix", "BearingNoise", "locate"),
    "landmarks": ("LandmarkMeasurement", "measure_landmark"),
    "laser.matching": ("ScanMatch", "SearchWindow", "match_scan"),
    "laser.scan_map": ("ScanMap",),
}


def __getattr__(name: str) -> Any:
    for module, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
