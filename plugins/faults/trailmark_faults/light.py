"""Light that changes: a shadow whose edge wanders, lamps on mains, a camera that has to get used to the sun."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from pydantic import Field

from trailmark.arrays import Float32s, Floats, GreyF
from trailmark.config import PluginConfig
from trailmark.interfaces import Session
from trailmark_faults.picture import PictureFault, per_channel

__all__ = [
    "Mains",
    "MainsConfig",
    "OverExposure",
    "OverExposureConfig",
    "WanderingShadow",
    "WanderingShadowConfig",
    "mains_gain",
    "shadow_gain",
]


class WanderingShadowConfig(PluginConfig):
    """The edge of a shadow that swings through the picture: of a branch, a passer-by, the robot itself."""

    depth: float = Field(default=0.5, gt=0, le=1)
    """Share of the light that is missing in the shadow."""
    edge: float = Field(default=0.1, gt=0)
    """Width of the penumbra, as a share of the picture's width."""
    reach: float = Field(default=0.3, ge=0)
    """How far the edge swings to each side of the middle, as a share of the picture's width."""
    speed: float = Field(default=0.3, ge=0)
    """How fast it is in the middle [widths of the picture per second]."""
    angle_deg: float | None = None
    """Direction across the edge, 0 along the columns' numbers; left out: at random [deg]."""


class WanderingShadow(PictureFault):
    """Half of the picture in a shadow whose edge swings to and fro."""

    config: WanderingShadowConfig

    def start(self, session: Session) -> None:
        """Draw the direction of the edge and where its swing begins."""
        angle_deg, self._phase = session.rng.uniform(0.0, 360.0), float(session.rng.uniform(0.0, 2.0 * math.pi))
        self._angle = math.radians(angle_deg if self.config.angle_deg is None else self.config.angle_deg)

    def worsen(self, levels: Float32s, rng: np.random.Generator, since_s: float) -> Float32s:
        """Return the picture, darker behind the edge."""
        config = self.config
        swing = config.speed / config.reach * since_s if config.reach else 0.0
        offset = config.reach * math.sin(swing + self._phase)
        gain = shadow_gain(levels.shape, (self._angle, offset), config.depth, config.edge)
        levels *= per_channel(gain, levels)
        return levels


def shadow_gain(shape: tuple[int, ...], line: tuple[float, float], depth: float, edge: float) -> GreyF:
    """Return the light that is left beside the edge of a shadow, (H, W).

    Parameters
    ----------
    shape : tuple of int
        Of the picture.
    line : (float, float)
        Direction across the edge [rad], and its distance from the middle along it [widths].
    depth, edge : float
        Share of the light that the shadow takes, and width of the penumbra [widths].
    """
    height, width = shape[:2]
    angle, offset = line
    u = (np.arange(width, dtype=np.float32) / width - 0.5)[None, :] * np.float32(math.cos(angle))
    v = ((np.arange(height, dtype=np.float32) - height / 2) / width)[:, None] * np.float32(math.sin(angle))
    into = np.clip((u + v - np.float32(offset)) / np.float32(edge) + np.float32(0.5), 0.0, 1.0)
    dark = np.float32(depth) * into * into * (3.0 - 2.0 * into)  # smooth at both ends
    return np.asarray(1.0 - dark, dtype=np.float32)


class MainsConfig(PluginConfig):
    """Lamps on alternating current: their light swings twice a period of the mains."""

    hz: Literal[100, 120] = 100
    """How often a second the light swings: 100 where the mains has 50 Hz, 120 where it has 60."""
    depth: float = Field(default=0.3, gt=0, le=1)
    """How far it swings, as a share of its mean: 0.1 of a light bulb, 0.3 of old tubes, up to 1 of cheap LEDs."""
    exposure_ms: float = Field(default=2.0, gt=0)
    """For how long a picture is exposed; a whole number of swings (10 ms at 100 Hz) sees none of it [ms]."""
    readout_ms: float = Field(default=0.0, ge=0)
    """How much later the last row is exposed than the first: a rolling shutter, which makes bands [ms]."""


class Mains(PictureFault):
    """Brightness that beats between the frequency of the lamps and the rate of the camera."""

    config: MainsConfig

    def start(self, session: Session) -> None:
        """Draw where in its swing the light is at first."""
        self._phase = float(session.rng.uniform(0.0, 2.0 * math.pi))

    def worsen(self, levels: Float32s, rng: np.random.Generator, since_s: float) -> Float32s:
        """Return the picture as bright as the lamps were while it was exposed."""
        config = self.config
        rows: Floats = np.arange(levels.shape[0]) / levels.shape[0] if config.readout_ms else np.zeros(1)
        gain = mains_gain(since_s + rows * config.readout_ms / 1e3, config, self._phase).astype(np.float32)
        levels *= gain.reshape((-1,) + (1,) * (levels.ndim - 1))
        return levels


def mains_gain(start_s: Floats, config: MainsConfig, phase: float) -> Floats:
    """Return the mean light of exposures that begin at some times: the mean of ``1 + depth cos(2 pi hz t + phase)``."""
    exposure_s = config.exposure_ms / 1e3
    middle = 2.0 * math.pi * config.hz * (start_s + exposure_s / 2) + phase
    gain: Floats = 1.0 + config.depth * np.sinc(config.hz * exposure_s) * np.cos(middle)
    return gain


class OverExposureConfig(PluginConfig):
    """Out of the shade into the sun: too bright until the camera's automatic exposure has followed."""

    gain: float = Field(default=3.0, gt=1)
    """How much brighter it is at first; what is beyond white is cut off."""
    every_s: float = Field(default=5.0, gt=0)
    """How often [s]."""
    settle_s: float = Field(default=0.5, ge=0)
    """How long the camera takes to get used to it, to 1/e; 0 of a fixed exposure: as bright for half the time [s]."""


class OverExposure(PictureFault):
    """Pictures that are too bright again and again."""

    config: OverExposureConfig

    def start(self, session: Session) -> None:
        """Draw when it begins."""
        self._offset_s = float(session.rng.uniform(0.0, self.config.every_s))

    def worsen(self, levels: Float32s, rng: np.random.Generator, since_s: float) -> Float32s:
        """Return the picture as bright as the camera lets it be."""
        config = self.config
        since_sun_s = (since_s + self._offset_s) % config.every_s
        if config.settle_s:
            gain = config.gain ** math.exp(-since_sun_s / config.settle_s)
        else:
            gain = config.gain if since_sun_s < config.every_s / 2 else 1.0
        levels *= np.float32(gain)
        return levels
