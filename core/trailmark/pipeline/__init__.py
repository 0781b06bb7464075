"""The pipeline: frames in, beliefs and commands out."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from trailmark.clock import Clock, SystemClock, live_stamp_s
from trailmark.estimates import EstimateRecord
from trailmark.pipeline.outputs.result import RunResult, Step
from trailmark.pipeline.parts import LocalizerPart, Parts, build_parts, build_sources
from trailmark.pipeline.pipeline import Pipeline
from trailmark.pipeline.request import RunRequest, read_config
from trailmark.pipeline.sources.stream import SourceStream

if TYPE_CHECKING:
    from trailmark.pipeline.outputs.run_folder import link_latest, new_folder

__all__ = [
    "Clock",
    "LocalizerPart",
    "Parts",
    "Pipeline",
    "RunRequest",
    "RunResult",
    "SourceStream",
    "Step",
    "SystemClock",
    "build_parts",
    "build_sources",
    "link_latest",
    "live_stamp_s",
    "new_folder",
    "read_config",
]

_OLD_NAMES = {"Feed": SourceStream, "Told": EstimateRecord}


def __getattr__(name: str) -> Any:
    if name in ("link_latest", "new_folder"):  # not every run has a folder
        return getattr(import_module("trailmark.pipeline.outputs.run_folder"), name)
    from trailmark.deprecation import deprecated_name  # hardly ever asked for

    return deprecated_name(__name__, name, _OLD_NAMES)
