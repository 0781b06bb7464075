"""Recording: the frames of any source as a data set on disk, in formats that any program reads."""

from trailmark.recording.dataset import DatasetWriter
from trailmark.recording.pictures import write_png
from trailmark.recording.record import Recording, record_sources

__all__ = ["DatasetWriter", "Recording", "record_sources", "write_png"]
