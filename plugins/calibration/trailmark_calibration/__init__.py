"""Calibration from one ordinary drive: what two localizers say of the same motion.

The names below are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark.lazy import lazy_names

if TYPE_CHECKING:
    from trailmark_calibration.checking import Calibration, calibrate
    from trailmark_calibration.fitting import Fit, KnownPlacement, fit
    from trailmark_calibration.hand_eye import solve_hand_eye, solve_hand_eye_and_scale
    from trailmark_calibration.model import pairs_of
    from trailmark_calibration.tracks import ComparedTrack, track_of

__all__ = [
    "Calibration",
    "ComparedTrack",
    "Fit",
    "KnownPlacement",
    "calibrate",
    "fit",
    "pairs_of",
    "solve_hand_eye",
    "solve_hand_eye_and_scale",
    "track_of",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "checking": ("Calibration", "calibrate"),
        "fitting": ("Fit", "KnownPlacement", "fit"),
        "hand_eye": ("solve_hand_eye", "solve_hand_eye_and_scale"),
        "model": ("pairs_of",),
        "tracks": ("ComparedTrack", "track_of"),
    },
)
