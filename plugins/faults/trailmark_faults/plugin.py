"""What this plugin registers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark import hookimpl

if TYPE_CHECKING:
    from trailmark.plugins import Registry


@hookimpl
def trailmark_register(registry: Registry) -> None:
    """Register the faults."""
    registry.fault(
        "basic",
        "trailmark_faults.basic:BasicFault",
        config="trailmark_faults.basic:BasicConfig",
        summary="Noise, blur, brightness, lost and late frames, occluders, a wrong calibration: directly under perturb",
    )
