"""What this plugin registers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    import click

    from trailmark.plugins import Registry


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register the localizers."""
    registry.localizer(
        "grid_mcl",
        "trailmark_laser_maps.mcl.localizer:GridMcl",
        config="trailmark_laser_maps.mcl.config:GridMclConfig",
        summary="A planar laser on an occupancy grid: adaptive Monte Carlo localization, without a start pose",
        reference="Thrun, Burgard, Fox 2005, Ch. 8; Fox 2003 (KLD sampling)",
        gives=("fix",),
    )
    registry.localizer(
        "scan_odometry",
        "trailmark_laser_maps.odometry.localizer:ScanOdometry",
        config="trailmark_laser_maps.odometry.config:ScanOdometryConfig",
        summary="Motion from a planar laser alone: each scan against the last ones, point to line",
        reference="Chen & Medioni 1992",
        gives=("motion",),
    )


@hookimpl
def trailmark_commands(group: click.Group) -> None:
    """Add `trailmark map`."""
    from trailmark_laser_maps.commands import map_group

    group.add_command(map_group)
