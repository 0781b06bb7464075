"""What the localizer needs to know of a camera: under which bearing a pixel looks."""

from __future__ import annotations

from typing import Protocol

from trailmark.arrays import Bools, Floats

__all__ = ["PixelBearings"]


class PixelBearings(Protocol):
    """Turns pixels (N, 2) into bearings: a circular picture, or an unwrapped panorama."""

    def bearings(self, uv: Floats) -> Floats:
        """Return the bearing of every pixel in sensor axes, counter-clockwise from forward, (N,) [rad]."""

    def distances(self, uv: Floats) -> Floats:
        """Return how far every pixel is from where the ground below the camera is, (N,) [px]."""

    def pixels(self, bearings: Floats, shares: Floats) -> Floats:
        """Return the pixels under bearings [rad], (N, 2); a share of 0 is the lowest that is seen, 1 the highest."""

    def is_inside(self, uv: Floats, margin_px: float = 4.0) -> Bools:
        """Return which pixels show the surroundings, at least a margin from their edges."""
