"""Known landmarks: beacons, fiducials, radios at surveyed places, seen at ranges, bearings or both.

The names below are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark.lazy import lazy_names

if TYPE_CHECKING:
    from trailmark_landmarks.config import KnownLandmarksConfig
    from trailmark_landmarks.localizer import KnownLandmarks

__all__ = ["KnownLandmarks", "KnownLandmarksConfig"]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "config": ("KnownLandmarksConfig",),
        "localizer": ("KnownLandmarks",),
    },
)
