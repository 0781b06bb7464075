"""What sources of any plugin are built on: a base for recordings, and the order of stamps."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark.lazy import lazy_names
from trailmark.sources.recorded import Reading, Readings, RecordedSource, form_of

if TYPE_CHECKING:
    from trailmark.sources.reorder import in_stamp_order

__all__ = ["Reading", "Readings", "RecordedSource", "form_of", "in_stamp_order"]

__getattr__, __dir__ = lazy_names(__name__, {"reorder": ["in_stamp_order"]})
