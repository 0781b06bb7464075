"""Hooks of the simulator."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    import click

    from trailmark.plugins import Registry


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register the source."""
    registry.source(
        "sim",
        "trailmark_sim.source:SimSource",
        config="trailmark_sim.config:SimConfig",
        summary="Simulated worlds, sensors and vehicles, in closed loop, with exact ground truth",
    )


@hookimpl
def trailmark_commands(group: click.Group) -> None:
    """Add `trailmark sim`."""
    from trailmark_sim.commands import sim

    group.add_command(sim)
