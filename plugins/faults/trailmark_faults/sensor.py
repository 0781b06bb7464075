"""What the camera itself does: too little light, motion blur, grains in front of it."""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from trailmark.arrays import Float32s
from trailmark.config import PluginConfig
from trailmark_faults.picture import PictureFault

__all__ = ["LowLight", "LowLightConfig", "MotionBlur", "MotionBlurConfig", "Specks", "SpecksConfig", "photograph"]


class LowLightConfig(PluginConfig):
    """Too little light, and a gain that makes noise of it; the defaults are a small industrial camera at dusk."""

    light: float = Field(default=0.02, gt=0, le=1)
    """Share of the light that is left."""
    gain: float = Field(default=16.0, gt=0)
    """What the camera multiplies the signal by, noise included."""
    full_well: float = Field(default=5000.0, gt=0)
    """Electrons of a white pixel at gain 1; their number is Poisson distributed (shot noise)."""
    read_noise: float = Field(default=8.0, ge=0)
    """Noise of the readout, standard deviation [electrons]."""


class LowLight(PictureFault):
    """A dark picture with shot and read noise."""

    config: LowLightConfig

    def worsen(self, levels: Float32s, rng: np.random.Generator, since_s: float) -> Float32s:
        """Return what the camera makes of the little light."""
        config = self.config
        electrons = config.full_well * config.light / 255.0
        return photograph(levels * np.float32(electrons), config.read_noise, rng) * np.float32(
            config.gain * 255.0 / config.full_well
        )


def photograph(electrons: Float32s, read_noise: float, rng: np.random.Generator) -> Float32s:
    """Return how many electrons are read of pixels that hold so many on average.

    Shot and read noise in one draw of a normal distribution of the variance of both, which differs from a Poisson
    distribution below ten electrons, where read noise is what counts.
    """
    spread = np.sqrt(electrons + np.float32(read_noise**2))
    read: Float32s = electrons + spread * rng.standard_normal(electrons.shape, dtype=np.float32)
    return read


class MotionBlurConfig(PluginConfig):
    """Blur along one direction, as of an exposure that is too long for the speed."""

    length_px: float = Field(default=8.0, gt=0)
    """How far things move while the picture is exposed [px]."""
    angle_deg: float = 0.0
    """Direction, 0 along the columns' numbers, 90 along the rows' [deg]."""


class MotionBlur(PictureFault):
    """Pictures smeared along a line; the middle of the smear is where things are."""

    config: MotionBlurConfig

    def worsen(self, levels: Float32s, rng: np.random.Generator, since_s: float) -> Float32s:
        """Return the smeared picture."""
        import cv2

        kernel = line_kernel(self.config.length_px, math.radians(self.config.angle_deg))
        return np.asarray(cv2.filter2D(levels, -1, kernel, borderType=cv2.BORDER_REPLICATE), dtype=np.float32)


def line_kernel(length_px: float, angle: float) -> Float32s:
    """Return the kernel of a line of a length [px] and direction [rad], of sum 1."""
    reach = math.ceil(length_px / 2)
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), np.float32)
    n = 8 * reach + 1
    along = ((np.arange(n) - (n - 1) / 2) * (length_px / n)).tolist()
    for step in along:
        u, v = step * math.cos(angle) + reach, step * math.sin(angle) + reach
        left, top = min(int(u), 2 * reach - 1), min(int(v), 2 * reach - 1)
        right, below = u - left, v - top
        kernel[top, left] += (1 - right) * (1 - below)
        kernel[top, left + 1] += right * (1 - below)
        kernel[top + 1, left] += (1 - right) * below
        kernel[top + 1, left + 1] += right * below
    return np.asarray(kernel / kernel.sum(), dtype=np.float32)


class SpecksConfig(PluginConfig):
    """Grains in front of the camera, at other places in every picture: dust, snow, rain, insects."""

    share: float = Field(default=0.01, gt=0, le=0.5)
    """Share of the picture that they cover."""
    size_px: float = Field(default=4.0, gt=0)
    """Their typical width [px]."""
    bright: float = Field(default=0.5, ge=0, le=1)
    """Share of them that are white; the others are black."""


class Specks(PictureFault):
    """Small discs of black and white, new in every picture."""

    config: SpecksConfig

    def worsen(self, levels: Float32s, rng: np.random.Generator, since_s: float) -> Float32s:
        """Return the picture behind the grains."""
        import cv2

        height, width = levels.shape[:2]
        n = round(self.config.share * height * width / (math.pi * self.config.size_px**2 / 4))
        centres = rng.random((n, 2)) * (width, height)
        radii = np.maximum(1, np.rint(self.config.size_px / 2 * rng.uniform(0.6, 1.4, n))).astype(int)
        whites = np.where(rng.random(n) < self.config.bright, 255.0, 0.0)
        for (u, v), radius, white in zip(centres.astype(int).tolist(), radii.tolist(), whites.tolist()):
            cv2.circle(levels, (u, v), radius, (white,) * 3, -1, cv2.LINE_AA)
        return levels
