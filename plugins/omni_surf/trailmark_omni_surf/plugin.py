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
        "omni_surf",
        "trailmark_omni_surf.localizer:OmniSurf",
        config="trailmark_omni_surf.config:OmniSurfConfig",
        summary="Landmarks from an uncalibrated omnidirectional camera: pose without a start pose",
        reference="Tasaki et al. 2010",
        gives=("fix",),
    )
    registry.localizer(
        "laser_icp",
        "trailmark_omni_surf.laser.localizer:LaserIcp",
        config="trailmark_omni_surf.laser.config:LaserIcpConfig",
        summary="A planar laser against the taught map: multi-start iterative closest points",
        reference="Tasaki et al. 2010, Sec. IV-C; Besl & McKay 1992",
        gives=("fix",),
    )


@hookimpl
def trailmark_commands(group: click.Group) -> None:
    """Add `trailmark omni`."""
    from trailmark_omni_surf.commands import omni

    group.add_command(omni)
