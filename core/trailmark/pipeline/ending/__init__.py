"""How a run ends that cannot end step by step: from another thread, and by force where a part does not come back."""

from __future__ import annotations

from trailmark.pipeline.ending.hangs import HangError, HangWatch

__all__ = ["HangError", "HangWatch"]
