"""What this plugin registers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    import click

    from trailmark.plugins import Registry

_REFERENCE = "Toth, Paulovic, Palkova & Vacho 2015"


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register the localizers for an RGB-D camera."""
    registry.localizer(
        "kinect_landmarks",
        "trailmark_kinect_landmarks.localizer:KinectLandmarks",
        config="trailmark_kinect_landmarks.config:KinectLandmarksConfig",
        summary="Pose from landmarks that are found, remembered and found again in colour and depth",
        reference=_REFERENCE,
        gives=("fix",),
    )
    registry.localizer(
        "kinect_motion",
        "trailmark_kinect_landmarks.localizer:KinectMotion",
        config="trailmark_kinect_landmarks.config:KinectLandmarksConfig",
        summary="kinect_landmarks, told as motion since the last answer",
        reference=_REFERENCE,
        gives=("motion",),
    )
    registry.localizer(
        "kinect_flow",
        "trailmark_kinect_landmarks.flow:KinectFlow",
        config="trailmark_kinect_landmarks.config:KinectFlowConfig",
        summary="Motion between two pictures with depth, by optical flow",
        reference=f"{_REFERENCE}, Eqs. (1)-(2)",
        gives=("motion",),
    )


@hookimpl
def trailmark_commands(group: click.Group) -> None:
    """Add `trailmark calibrate rgbd`."""
    from trailmark_kinect_landmarks.calibrating.command import rgbd

    group.commands["calibrate"].add_command(rgbd)  # type: ignore[attr-defined]
