"""What sources of any plugin are built on: a base for recordings, and the order of stamps."""

from trailmark.sources.recorded import Reading, Readings, RecordedSource, form_of
from trailmark.sources.reorder import in_stamp_order

__all__ = ["Reading", "Readings", "RecordedSource", "form_of", "in_stamp_order"]
