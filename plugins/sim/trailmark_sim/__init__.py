"""Simulated worlds, cameras and vehicles, in closed loop.

The names below are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark.lazy import lazy_names

if TYPE_CHECKING:
    from trailmark_sim.config import SimConfig
    from trailmark_sim.source import SimSource

__all__ = ["SimConfig", "SimSource"]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "config": ("SimConfig",),
        "source": ("SimSource",),
    },
)
