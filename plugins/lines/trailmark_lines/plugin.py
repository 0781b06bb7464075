"""Registers the source."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    from trailmark.plugins import Registry


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register it, by import string."""
    registry.source(
        "lines",
        "trailmark_lines.source:LinesSource",
        config="trailmark_lines.config:LinesConfig",
        summary="A robot of any language: frames as lines of JSON, commands back the same way",
    )
