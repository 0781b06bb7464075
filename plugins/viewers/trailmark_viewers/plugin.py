"""Registers the sinks for viewers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    from trailmark.plugins import Registry


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register every sink, by import string."""
    registry.sink(
        "foxglove",
        "trailmark_viewers.foxglove_sink:FoxgloveSink",
        config="trailmark_viewers.config:FoxgloveConfig",
        summary="Frames, beliefs, estimates and commands for Foxglove: as an MCAP file, or live",
        reference="docs.foxglove.dev: message schemas",
        extra="foxglove",
    )
    registry.sink(
        "rerun",
        "trailmark_viewers.rerun_sink:RerunSink",
        config="trailmark_viewers.config:RerunConfig",
        summary="Frames, beliefs, estimates and commands for Rerun: as a recording (.rrd), or to a viewer",
        reference="ref.rerun.io: archetypes",
        extra="rerun",
    )
