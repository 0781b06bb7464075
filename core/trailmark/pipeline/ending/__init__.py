"""How a run ends: step by step, from another thread where it cannot, and by force where a part does not come back."""

from __future__ import annotations

from trailmark.pipeline.ending.hangs import HangError, HangWatch
from trailmark.pipeline.ending.steps import Ending

__all__ = ["Ending", "HangError", "HangWatch"]
