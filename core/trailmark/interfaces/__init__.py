"""The parts of a pipeline. Plugins implement these; the pipeline runs them.

Every part has the same life: a cheap constructor, `start` (open, load, warm up; again = as new), work,
and `close` (from any thread, in any state, twice). A method added here later has a default, so that
plugins written for an older minor version keep working.
"""

from __future__ import annotations

from typing import Any

from trailmark.interfaces.methods import Controller, Estimator, Localizer
from trailmark.interfaces.outputs import PathStore, RunEnd, Sink
from trailmark.interfaces.session import Access, LocalizerMap, Mode, Pace, Part, Session
from trailmark.interfaces.sources import Drivable, Fault, FrameSource

__all__ = [
    "Access",
    "Controller",
    "Drivable",
    "Estimator",
    "Fault",
    "FrameSource",
    "Localizer",
    "LocalizerMap",
    "Mode",
    "Pace",
    "Part",
    "PathStore",
    "RunEnd",
    "Session",
    "Sink",
]

_OLD_NAMES = {"Drawer": LocalizerMap}


def __getattr__(name: str) -> Any:
    from trailmark.deprecation import deprecated_name  # hardly ever asked for

    return deprecated_name(__name__, name, _OLD_NAMES)
