"""Registers the source and the localizer."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    from trailmark.plugins import Registry


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register what this distribution brings."""
    registry.source(
        "mrclam_landmarks",
        "trailmark_mrclam.source:MrclamLandmarks",
        config="trailmark_mrclam.config:MrclamLandmarksConfig",
        summary="Sightings of known landmarks, of a UTIAS MRCLAM recording",
        reference="Leung, Halpern, Barfoot & Liu 2011",
    )
    registry.localizer(
        "range_bearing",
        "trailmark_mrclam.localizer:RangeBearing",
        config="trailmark_mrclam.config:RangeBearingConfig",
        summary="One fix of rank two for each landmark that is seen at a range and a bearing",
        gives=("fix",),
    )
