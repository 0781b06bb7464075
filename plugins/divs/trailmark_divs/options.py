"""The choices of the config, by name; importing this is cheap."""

from __future__ import annotations

from typing import Literal, get_args

__all__ = ["THRESHOLDS", "Average", "Correspond", "Gain", "Select", "Shift", "Threshold", "TurnSource", "WhenBlind"]

Select = Literal["distance", "time", "every"]
Threshold = Literal["otsu", "p90", "blur_otsu"]
#: Stored by their places here: append only.
THRESHOLDS: tuple[Threshold, ...] = get_args(Threshold)
Average = Literal["trimmed", "mean"]
Shift = Literal["robust", "paper"]
Correspond = Literal["distance", "time", "index", "appearance"]
Gain = Literal["geometry", "paper", "learned"]
TurnSource = Literal["auto", "belief", "images"]
WhenBlind = Literal["pictures", "single", "silent"]
