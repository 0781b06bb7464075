"""Sinks for programs that show what a robot sees and believes.

The names below are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark.lazy import lazy_names

if TYPE_CHECKING:
    from trailmark_viewers.config import FoxgloveConfig, RerunConfig
    from trailmark_viewers.foxglove_sink import FoxgloveSink
    from trailmark_viewers.rerun_sink import RerunSink

__all__ = ["FoxgloveConfig", "FoxgloveSink", "RerunConfig", "RerunSink"]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "config": (
            "FoxgloveConfig",
            "RerunConfig",
        ),
        "foxglove_sink": ("FoxgloveSink",),
        "rerun_sink": ("RerunSink",),
    },
)
