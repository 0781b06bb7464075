"""Controllers that bring a robot along a taught path.

The names below are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark.lazy import lazy_names

if TYPE_CHECKING:
    from trailmark_controllers.drift_steering import DriftSteering
    from trailmark_controllers.drift_steering_config import DriftSteeringConfig
    from trailmark_controllers.goal_seeking import GoalSeeking
    from trailmark_controllers.goal_seeking_config import GoalSeekingConfig
    from trailmark_controllers.path_tracking import PathTracking4WS
    from trailmark_controllers.path_tracking_config import PathTrackingConfig
    from trailmark_controllers.tracking import PathTracking
    from trailmark_controllers.tracking_config import TrackingConfig

__all__ = [
    "DriftSteering",
    "DriftSteeringConfig",
    "GoalSeeking",
    "GoalSeekingConfig",
    "PathTracking",
    "PathTracking4WS",
    "PathTrackingConfig",
    "TrackingConfig",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "drift_steering": ("DriftSteering",),
        "drift_steering_config": ("DriftSteeringConfig",),
        "goal_seeking": ("GoalSeeking",),
        "goal_seeking_config": ("GoalSeekingConfig",),
        "path_tracking": ("PathTracking4WS",),
        "path_tracking_config": ("PathTrackingConfig",),
        "tracking": ("PathTracking",),
        "tracking_config": ("TrackingConfig",),
    },
)
