"""What this plugin registers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    import click


@hookimpl
def trailmark_commands(group: click.Group) -> None:
    """Add `trailmark map`."""
    from trailmark_laser_maps.commands import map_group

    group.add_command(map_group)
