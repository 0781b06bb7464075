"""The hooks that a plugin may implement. All carry the prefix ``trailmark_`` and may leave out arguments.

Hooks register factories and mark the ends of a run; frames never pass through one (a hook call costs
1.6 us against 0.04 us for a method call).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pluggy

if TYPE_CHECKING:
    import click

    from trailmark.plugins.registry import Registry

__all__ = ["HookSpecs"]

_hookspec = pluggy.HookspecMarker("trailmark")


class HookSpecs:
    """Specifications of all hooks, one method each."""

    @_hookspec
    def trailmark_register(self, registry: Registry) -> None:
        """Register the parts that this plugin brings, by import string."""

    @_hookspec
    def trailmark_run_started(self, run: Any) -> None:
        """Called when a pipeline has started all its parts; its first frame comes next."""

    @_hookspec
    def trailmark_run_finished(self, run: Any, result: Any) -> None:
        """Called when a pipeline has ended, however it ended; everything is written."""

    @_hookspec
    def trailmark_commands(self, group: click.Group) -> None:
        """Add commands to the command line; import what they need inside them.

        The group ``calibrate`` is there already and shared: a plugin that calibrates a sensor adds its command to
        ``group.commands["calibrate"]``. Without any it is not shown.
        """
