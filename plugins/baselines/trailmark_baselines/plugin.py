"""Registers what people would use instead of the papers' methods."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    from trailmark.plugins import Registry


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register the localizers."""
    registry.localizer(
        "odometry",
        "trailmark_baselines.odometry:OdometryLocalizer",
        config="trailmark_baselines.config:OdometryConfig",
        summary="Wheel odometry, with a covariance for slip",
        gives=("motion",),
    )
    registry.localizer(
        "constant_speed",
        "trailmark_baselines.constant_speed:ConstantSpeed",
        config="trailmark_baselines.config:ConstantSpeedConfig",
        summary="Drives on at a known speed, whatever it sees",
        reference="Perroni Filho & Ohya 2014 (correspondence by time)",
        gives=("motion",),
    )
