"""A run at work: the loop over frames, what it goes on with, and what is left when it ends."""

from __future__ import annotations

from trailmark.pipeline.run.loop import Run

__all__ = ["Run"]
