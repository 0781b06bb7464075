"""Kernels of the oldest faults of pictures; pixels keep their type, 8 bits or 16, grey or colour."""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import AnyArray

__all__ = ["Occluder", "add_speckle", "blur", "expose", "white_of"]


def white_of(pixels: AnyArray) -> float:
    """Return the value of white."""
    return 65535.0 if pixels.dtype == np.uint16 else 255.0


def blur(pixels: AnyArray, sigma_px: float) -> AnyArray:
    """Return a picture out of focus: Gaussian blur [px]."""
    import cv2

    blurred: AnyArray = cv2.GaussianBlur(pixels, (0, 0), sigma_px)
    return blurred


def expose(pixels: AnyArray, gain: float, noise: float, rng: np.random.Generator) -> AnyArray:
    """Return a picture brighter by a factor and with noise, cut off at black and white.

    Parameters
    ----------
    pixels : (H, W) or (H, W, 3) uint8 or uint16
        The picture.
    gain : float
        Brightness times this.
    noise : float
        Standard deviation [grey levels of 255]; nothing is drawn for 0.
    rng : numpy.random.Generator
        Of this frame.
    """
    if gain == 1.0 and not noise:
        return pixels
    white = white_of(pixels)
    level = pixels.astype(np.float32) * np.float32(gain)
    if noise:
        level += rng.standard_normal(pixels.shape, dtype=np.float32) * np.float32(noise * white / 255.0)
    exposed: AnyArray = np.clip(np.rint(level), 0.0, white).astype(pixels.dtype)
    return exposed


def add_speckle(pixels: AnyArray, share: float, rng: np.random.Generator) -> AnyArray:
    """Return a picture of which a share of the pixels is black or white, half of them each."""
    speckled = pixels.copy()
    chance = rng.random(pixels.shape[:2], dtype=np.float32)
    speckled[chance < share / 2] = 0
    speckled[chance > 1.0 - share / 2] = round(white_of(pixels))
    return speckled


class Occluder:
    """A square of one grey that crosses the picture again and again, straight on.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws its grey, where it starts and where it goes.
    size : float
        Its side, as a share of the shorter side of the picture.
    speed : float
        How fast it crosses [widths of the picture per second].
    """

    def __init__(self, rng: np.random.Generator, size: float, speed: float) -> None:
        self.grey = float(rng.random())
        self._at = rng.random(2)
        direction = rng.uniform(0.0, 2.0 * math.pi)
        self._speed = speed * np.array([math.cos(direction), math.sin(direction)])
        self._size = size

    def window(self, shape: tuple[int, ...], since_s: float) -> tuple[slice, slice]:
        """Return the rows and columns that it covers now."""
        height, width = shape[:2]
        side = max(1, round(self._size * min(height, width)))
        reach = np.array([width + side, height + side])
        u, v = ((self._at + self._speed * since_s) % 1.0 * reach - side).astype(int).tolist()
        return slice(max(v, 0), max(v + side, 0)), slice(max(u, 0), max(u + side, 0))
