"""The pipeline: frames in, beliefs and commands out."""

from trailmark.pipeline.clock import Clock, SystemClock, live_stamp_s
from trailmark.pipeline.pipeline import Pipeline
from trailmark.pipeline.plan import Plan, PlannedLocalizer, Settled, StorePlan
from trailmark.pipeline.result import RunResult
from trailmark.pipeline.run_folder import link_latest, new_folder
from trailmark.pipeline.sources import Feed
from trailmark.pipeline.steps import Step, Told

__all__ = [
    "Clock",
    "Feed",
    "Pipeline",
    "Plan",
    "PlannedLocalizer",
    "RunResult",
    "Settled",
    "Step",
    "StorePlan",
    "SystemClock",
    "Told",
    "link_latest",
    "live_stamp_s",
    "new_folder",
]
