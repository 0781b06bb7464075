"""A camera that looks at the ground (Nagai & Watanabe 2015): its motion, and where it is on taught ground.

The names below are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark.lazy import lazy_names

if TYPE_CHECKING:
    from trailmark_ground_vo.config import GroundMapConfig, GroundVOConfig
    from trailmark_ground_vo.localizer import GroundVO
    from trailmark_ground_vo.map_localizer import GroundMap

__all__ = ["GroundMap", "GroundMapConfig", "GroundVO", "GroundVOConfig"]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "config": (
            "GroundMapConfig",
            "GroundVOConfig",
        ),
        "localizer": ("GroundVO",),
        "map_localizer": ("GroundMap",),
    },
)
