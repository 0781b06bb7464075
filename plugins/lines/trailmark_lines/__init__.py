"""A robot of any language as a source: JSON lines in, commands as JSON lines out.

The names below are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark.lazy import lazy_names

if TYPE_CHECKING:
    from trailmark_lines.config import LinesConfig
    from trailmark_lines.source import LinesSource

__all__ = ["LinesConfig", "LinesSource"]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "config": ("LinesConfig",),
        "source": ("LinesSource",),
    },
)
