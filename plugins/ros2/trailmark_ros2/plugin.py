"""Registers the live source and the sink; nothing heavy is imported before one of them is used."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    import click

    from trailmark.plugins import Registry


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register both, by import string."""
    registry.source(
        "ros2",
        "trailmark_ros2.source:Ros2Source",
        config="trailmark_ros2.config:Ros2SourceConfig",
        summary="A robot of ROS 2, live: its topics as sensors, driven by /cmd_vel; needs no ROS",
        reference="docs.ros.org: REP-103, REP-105; OMG DDS",
        extra="ros2",
    )
    registry.sink(
        "ros2",
        "trailmark_ros2.sink:Ros2Sink",
        config="trailmark_ros2.config:Ros2SinkConfig",
        summary="Beliefs for ROS 2: transform map to odom, odometry, pose, paths, diagnostics; needs no ROS",
        reference="docs.ros.org: REP-105; docs.nav2.org: transforms",
        extra="ros2",
    )


@hookimpl
def trailmark_commands(group: click.Group) -> None:
    """Add `trailmark ros2`."""
    from trailmark_ros2.commands import ros2

    group.add_command(ros2)
