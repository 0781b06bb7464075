"""Registers the localizer."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    from trailmark.plugins import Registry


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register the localizer."""
    registry.localizer(
        "known_landmarks",
        "trailmark_landmarks.localizer:KnownLandmarks",
        config="trailmark_landmarks.config:KnownLandmarksConfig",
        summary="Pose from ranges and bearings to landmarks at known places: beacons, fiducials, radios",
        reference="Pierlot & Van Droogenbroeck 2014 (three bearings)",
        gives=("fix",),
    )
