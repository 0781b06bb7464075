"""Localizers at work, and the estimator that takes what they say.

A localizer is waited for, works beside the run on the virtual clock, or has a thread of its own.
"""

from __future__ import annotations

from trailmark.pipeline.localizers.freezes import FreezeWatch
from trailmark.pipeline.localizers.runner import (
    LocalizerFailedError,
    LocalizerRunner,
    ObserveResult,
    beginning_early,
    new_runner,
)

__all__ = ["FreezeWatch", "LocalizerFailedError", "LocalizerRunner", "ObserveResult", "beginning_early", "new_runner"]
