"""Localizers at work, and the estimator that takes what they say.

A localizer is waited for, works beside the run on the virtual clock, or has a thread of its own.
"""

from __future__ import annotations

from trailmark.pipeline.localizers.runner import (
    LocalizerFailedError,
    LocalizerRunner,
    ObserveResult,
    beginning_early,
    new_runner,
)
from trailmark.pipeline.localizers.standstill import RepeatWatch

__all__ = ["LocalizerFailedError", "LocalizerRunner", "ObserveResult", "RepeatWatch", "beginning_early", "new_runner"]
