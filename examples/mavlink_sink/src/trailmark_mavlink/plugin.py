"""Registers the sink."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    from trailmark.plugins import Registry


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register it, by import string."""
    registry.sink(
        "mavlink",
        "trailmark_mavlink.sink:MavlinkSink",
        config="trailmark_mavlink.config:MavlinkSinkConfig",
        summary="Beliefs as MAVLink ODOMETRY and VISION_POSITION_ESTIMATE, over UDP",
        reference="mavlink.io: common message set",
    )
