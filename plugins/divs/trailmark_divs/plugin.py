"""What the plugin offers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    from trailmark.plugins import Registry


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register the localizer."""
    registry.localizer(
        "divs",
        "trailmark_divs.localizer:Divs",
        config="trailmark_divs.config:DivsConfig",
        summary="Drift from a taught path, from differential visual streams of one uncalibrated camera",
        reference="Perroni Filho & Ohya 2014",
        gives=("path_offset",),
    )
