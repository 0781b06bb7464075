"""What this plugin registers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    from trailmark.plugins import Registry


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register the controllers."""
    registry.controller(
        "path_tracking",
        "trailmark_controllers.tracking:PathTracking",
        config="trailmark_controllers.tracking_config:TrackingConfig",
        summary="Follows a taught path: differential, holonomic, Ackermann, four-wheel steering",
        reference="Micaelli & Samson 1993, INRIA RR-2097",
    )
    registry.controller(
        "path_tracking_4ws",
        "trailmark_controllers.path_tracking:PathTracking4WS",
        config="trailmark_controllers.path_tracking_config:PathTrackingConfig",
        summary="Follows a taught path with front and rear steering, there and back",
        reference="Nagai & Watanabe 2015, Eqs. (6)-(8)",
    )
    registry.controller(
        "drift_steering",
        "trailmark_controllers.drift_steering:DriftSteering",
        config="trailmark_controllers.drift_steering_config:DriftSteeringConfig",
        summary="Replays a taught path's bends and steers against the drift from it",
        reference="Perroni Filho & Ohya 2014, Sec. IV",
    )
    registry.controller(
        "goal_seeking",
        "trailmark_controllers.goal_seeking:GoalSeeking",
        config="trailmark_controllers.goal_seeking_config:GoalSeekingConfig",
        summary="Drives to a goal pose from anywhere, and stands while lost",
        reference="Tasaki et al. 2010, Sec. IV-C",
    )
