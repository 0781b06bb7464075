"""Differential visual streams: how far a robot has left its taught path, from what changes in the picture.

H. Perroni Filho, A. Ohya: Mobile Robot Path Drift Estimation Using Visual Streams, 2014.

The names below are imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trailmark.lazy import lazy_names

if TYPE_CHECKING:
    from trailmark_divs.config import DivsConfig
    from trailmark_divs.localizer import Divs

__all__ = ["Divs", "DivsConfig"]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "config": ("DivsConfig",),
        "localizer": ("Divs",),
    },
)
