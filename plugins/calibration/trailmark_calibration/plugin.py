"""What this plugin registers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    import click


@hookimpl
def trailmark_commands(group: click.Group) -> None:
    """Add `trailmark calibrate odometry`, `mounting` and `delay`."""
    from trailmark_calibration.commands import COMMANDS

    calibrate = group.commands["calibrate"]
    assert hasattr(calibrate, "add_command")
    for command in COMMANDS:
        calibrate.add_command(command)
