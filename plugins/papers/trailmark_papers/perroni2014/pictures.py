"""Pictures of a drive, as the streams see them."""

from __future__ import annotations

from trailmark.arrays import Grey8
from trailmark.frames import Image
from trailmark_divs.layout import grey_region
from trailmark_papers.kit import FrameKeeper

__all__ = ["upper_halves"]


def upper_halves() -> FrameKeeper[Grey8]:
    """Return a keeper of the upper half of every picture, in grey."""
    return FrameKeeper(Image, lambda image: grey_region(image, (0, image.pixels.shape[0] // 2)))
