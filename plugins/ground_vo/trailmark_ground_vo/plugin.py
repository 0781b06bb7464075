"""What this plugin registers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    import click

    from trailmark.plugins import Registry


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register the localizers for a downward camera."""
    registry.localizer(
        "ground_vo",
        "trailmark_ground_vo.localizer:GroundVO",
        config="trailmark_ground_vo.config:GroundVOConfig",
        summary="Motion from a downward camera: two groups of reference pixels, refined to a hundredth of a pixel",
        reference="Nagai & Watanabe 2015",
        gives=("motion",),
    )
    registry.localizer(
        "ground_map",
        "trailmark_ground_vo.map_localizer:GroundMap",
        config="trailmark_ground_vo.config:GroundMapConfig",
        summary="Pose from a downward camera: patches of the ground, registered while teaching and searched for again",
        reference="Nagai & Watanabe 2015",
        gives=("fix",),
    )


@hookimpl
def trailmark_commands(group: click.Group) -> None:
    """Add `trailmark calibrate ground`."""
    from trailmark_ground_vo.commands import ground

    calibrate = group.commands["calibrate"]
    assert hasattr(calibrate, "add_command")
    calibrate.add_command(ground)
