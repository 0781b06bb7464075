"""A wet patch on the floor."""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field

from trailmark.arrays import Float32s, GreyF
from trailmark.config import PluginConfig
from trailmark.interfaces import Session
from trailmark_faults.picture import PictureFault, add_window, per_channel

__all__ = ["WetPatch", "WetPatchConfig", "patch_outline"]

#: Highlights stand between the floor and the lamp: they slide at this share of the patch's speed.
_SLIDE = 0.5


class WetPatchConfig(PluginConfig):
    """Water on the floor that passes through the picture: darker, with less contrast, and lamps shine in it."""

    size: float = Field(default=0.8, gt=0)
    """Its width, as a share of the shorter side of the picture."""
    speed: float = Field(default=0.2, ge=0)
    """How fast it passes, again and again, in a direction of its own [widths of the picture per second]."""
    light: float = Field(default=0.6, gt=0, le=1)
    """Share of the light that it leaves."""
    contrast: float = Field(default=0.5, ge=0, le=1)
    """Share of the floor's contrast that it leaves."""
    glints: int = Field(default=6, ge=0)
    """Reflections of lamps in it; they slide over the floor."""
    glint_px: float = Field(default=6.0, gt=0)
    """Width of each of them [px]."""


class WetPatch(PictureFault):
    """A patch of irregular outline that crosses the picture, with highlights that move slower than it does."""

    config: WetPatchConfig

    def start(self, session: Session) -> None:
        """Draw where the patch comes from and how far beside the middle it passes, and where lamps shine in it."""
        rng = session.rng
        self._rng = rng
        self._begin, self._beside = float(rng.random()), float(rng.uniform(-0.25, 0.25))
        direction = rng.uniform(0.0, 2.0 * math.pi)
        self._ahead = np.array([math.cos(direction), math.sin(direction)])
        self._lamps = rng.random((self.config.glints, 2))
        self._outline: GreyF | None = None

    def worsen(self, levels: Float32s, rng: np.random.Generator, since_s: float) -> Float32s:
        """Return the picture with the patch where it is now."""
        height, width = levels.shape[:2]
        if self._outline is None:
            self._outline = patch_outline(max(8, round(self.config.size * min(height, width))), self._rng)
        side = len(self._outline)
        passed_px = self.config.speed * width * since_s
        way_px = math.hypot(width, height) + side  # from where it comes into sight to where it is out of it
        along = (self._begin * way_px + passed_px) % way_px - way_px / 2
        aside = self._beside * min(width, height) * np.array([-self._ahead[1], self._ahead[0]])
        centre = np.array([width, height]) / 2 + along * self._ahead + aside
        u, v = np.floor(centre - side / 2).astype(int).tolist()
        window = add_window(levels.shape, (side, side), (u, v))
        if window is None:
            return levels
        rows, columns, *inner = window
        wet = self._wet(levels[rows, columns])
        lamps = (self._lamps * (width, height) + _SLIDE * passed_px * self._ahead) % (width, height)
        wet = wet + per_channel(glint_light(wet.shape, lamps - (columns.start, rows.start), self.config.glint_px), wet)
        mask = per_channel(self._outline[inner[0], inner[1]], levels)
        levels[rows, columns] += mask * (wet - levels[rows, columns])
        return levels

    def _wet(self, dry: Float32s) -> Float32s:
        import cv2

        mean = cv2.blur(dry, (15, 15), borderType=cv2.BORDER_REPLICATE)
        wet: Float32s = np.float32(self.config.light) * (mean + np.float32(self.config.contrast) * (dry - mean))
        return wet


def patch_outline(side: int, rng: np.random.Generator) -> GreyF:
    """Return a patch, (side, side): 1 within, 0 outside, with a soft and irregular edge."""
    v, u = np.mgrid[0:side, 0:side].astype(np.float32)
    u, v = (u - side / 2) / (side / 2), (v - side / 2) / (side / 2)
    angle = np.arctan2(v, u)
    edge = np.full_like(angle, 0.75)
    for n in (2, 3, 5):
        edge += np.float32(rng.uniform(0.0, 0.08)) * np.cos(n * angle + np.float32(rng.uniform(0.0, 2.0 * math.pi)))
    outline: GreyF = np.clip((edge - np.hypot(u, v)) / 0.06 + 0.5, 0.0, 1.0).astype(np.float32)
    return outline


def glint_light(shape: tuple[int, ...], lamps_uv: Float32s, width_px: float) -> GreyF:
    """Return the light of highlights at some places, (H, W) [grey levels]; only those within the picture."""
    height, width = shape[:2]
    light = np.zeros((height, width), np.float32)
    reach = math.ceil(2 * width_px)
    v, u = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(np.float32)
    for lamp_u, lamp_v in lamps_uv.tolist():
        left, top = math.floor(lamp_u), math.floor(lamp_v)
        du, dv = lamp_u - left, lamp_v - top
        spot = 510.0 * np.exp(-4.0 * math.log(2.0) * ((u - du) ** 2 + (v - dv) ** 2) / width_px**2)
        window = add_window(shape, spot.shape, (left - reach, top - reach))
        if window is not None:
            rows, columns, inner_rows, inner_columns = window
            light[rows, columns] += spot[inner_rows, inner_columns].astype(np.float32)
    return light
