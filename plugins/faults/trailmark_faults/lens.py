"""What sits on a lens or comes through it: marks, reflections, vignette, a cover. All of it stays where it is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from trailmark.arrays import Float32s, Grey8, GreyF
from trailmark.config import PluginConfig
from trailmark.interfaces import Session
from trailmark_faults.picture import PictureFault, per_channel, radius_over
from trailmark_faults.span import TimeSpanConfig

__all__ = [
    "Cover",
    "CoverConfig",
    "Glints",
    "GlintsConfig",
    "LensMarks",
    "LensMarksConfig",
    "Marks",
    "Vignette",
    "VignetteConfig",
    "draw_marks",
    "put_marks",
]

Mark = Literal["specks", "scratches", "drops"]

#: A drop is a lens of its own: what lies behind it is blurred over this share of its radius.
_DROP_BLUR = 0.25


class LensMarksConfig(PluginConfig):
    """Dirt, scratches and drops on the lens."""

    share: float = Field(default=0.01, gt=0, le=0.5)
    """Share of the picture that they cover."""
    kinds: tuple[Mark, ...] = Field(default=("specks", "scratches"), min_length=1)
    """Of specks (dirt), scratches (thin lines that scatter light) and drops (round, they blur what lies behind)."""
    opacity: float = Field(default=0.9, gt=0, le=1)
    """How much of the light specks and scratches take; the rest of the picture shines through."""
    size: float = Field(default=0.03, gt=0, le=0.5)
    """Typical width of a speck or drop, as a share of the shorter side of the picture."""
    edge_px: float = Field(default=1.5, ge=0)
    """How soft their edges are: the lens is out of focus [px]."""


@dataclass(frozen=True, slots=True)
class Marks:
    """Marks on a lens as pictures of it.

    Attributes
    ----------
    cover : (H, W) float32
        Share of the light that marks take.
    levels : (H, W) float32
        Their own brightness [grey levels].
    drops : (H, W) float32
        Share of the light that goes through drops.
    blur_px : float
        Blur behind drops [px].
    """

    cover: GreyF
    levels: GreyF
    drops: GreyF
    blur_px: float


class LensMarks(PictureFault):
    """Marks fixed to the lens: where and what they are is drawn once."""

    config: LensMarksConfig

    def start(self, session: Session) -> None:
        """Forget the marks of the run before."""
        self._rng = session.rng
        self._marks: Marks | None = None

    def worsen(self, levels: Float32s, rng: np.random.Generator, since_s: float) -> Float32s:
        """Return the picture behind the marks."""
        if self._marks is None:
            self._marks = draw_marks(levels.shape, self.config, self._rng)
        return put_marks(levels, self._marks)


def draw_marks(shape: tuple[int, ...], config: LensMarksConfig, rng: np.random.Generator) -> Marks:
    """Return marks that cover the share that is asked for, each kind its part of it."""
    import cv2

    height, width = shape[:2]
    side = min(height, width)
    cover: GreyF = np.zeros((height, width), np.float32)
    drops, levels = cover.copy(), cover.copy()
    for kind in dict.fromkeys(config.kinds):
        wanted = config.share * height * width / len(set(config.kinds))
        mask = np.zeros((height, width), np.uint8)
        while np.count_nonzero(mask) < wanted:
            left_px = wanted - np.count_nonzero(mask)
            one = np.zeros_like(mask)
            _draw_one(one, kind, config.size * side, left_px, rng)
            levels[one > 0] = rng.uniform(150.0, 230.0) if kind == "scratches" else rng.uniform(5.0, 90.0)
            mask |= one
        soft: GreyF = mask.astype(np.float32)
        if config.edge_px:
            soft = np.asarray(cv2.GaussianBlur(soft, (0, 0), config.edge_px), dtype=np.float32)
            levels = np.where(levels > 0, levels, cv2.dilate(levels, np.ones((5, 5), np.uint8)))
        if kind == "drops":
            drops = np.maximum(drops, soft)
        else:
            cover = np.maximum(cover, soft * np.float32(config.opacity))
    return Marks(cover, levels, drops, max(1.0, _DROP_BLUR * config.size * side))


def _draw_one(mask: Grey8, kind: Mark, size_px: float, left_px: float, rng: np.random.Generator) -> None:
    """Draw one mark into an empty mask, no larger than what is left to cover."""
    import cv2

    height, width = mask.shape
    centre = (int(rng.integers(width)), int(rng.integers(height)))
    if kind == "scratches":
        length = min(size_px * float(rng.lognormal(1.5, 0.4)), left_px)
        angle, bend = rng.uniform(0.0, 2.0 * math.pi), rng.normal(0.0, 0.3)
        along = np.linspace(-0.5, 0.5, 8) * length
        heading = angle + bend * along / max(length, 1.0)
        points = np.stack([centre[0] + along * np.cos(heading), centre[1] + along * np.sin(heading)], axis=1)
        cv2.polylines(mask, [np.rint(points).astype(np.int32)], False, 1, 1 if length < 40 else 2)
        return
    radius = min(size_px / 2 * float(rng.lognormal(0.0, 0.4)), math.sqrt(left_px / math.pi))
    squash = 1.0 if kind == "drops" else float(rng.uniform(0.5, 1.0))
    axes = (max(1, round(radius / math.sqrt(squash))), max(1, round(radius * math.sqrt(squash))))
    cv2.ellipse(mask, centre, axes, float(rng.uniform(0.0, 180.0)), 0, 360, 1, -1)


def put_marks(levels: Float32s, marks: Marks) -> Float32s:
    """Return a picture behind marks."""
    import cv2

    if marks.drops.any():
        smaller = max(1, round(marks.blur_px / 2))  # blurred at a coarser scale: the cost does not grow with the drop
        height, width = levels.shape[:2]
        small = cv2.resize(levels, (max(1, width // smaller), max(1, height // smaller)), interpolation=cv2.INTER_AREA)
        blurred = cv2.resize(cv2.GaussianBlur(small, (0, 0), 2.0), (width, height), interpolation=cv2.INTER_LINEAR)
        levels = levels + per_channel(marks.drops, levels) * (blurred - levels)
    cover = per_channel(marks.cover, levels)
    behind: Float32s = levels + cover * (per_channel(marks.levels, levels) - levels)
    return behind


class GlintsConfig(PluginConfig):
    """Reflections of lamps that move with the camera: saturated spots."""

    n: int = Field(default=8, ge=1)
    """How many."""
    share: float = Field(default=0.01, gt=0, le=0.5)
    """Share of the picture that they saturate, all together."""
    ring: float | None = Field(default=0.5, gt=0, le=1)
    """Radius of the ring that they stand on, as a share of half the shorter side; null: anywhere."""
    halo: float = Field(default=0.3, ge=0, le=1)
    """Brightness of the veil around them, as a share of white."""
    twinkle: float = Field(default=0.0, ge=0, le=1)
    """How much each of them varies from picture to picture: a rough floor reflects unevenly."""


class Glints(PictureFault):
    """Spots of light added to the picture, fixed to the lens."""

    config: GlintsConfig

    def start(self, session: Session) -> None:
        """Forget the spots of the run before."""
        self._rng = session.rng
        self._spots: Float32s | None = None

    def worsen(self, levels: Float32s, rng: np.random.Generator, since_s: float) -> Float32s:
        """Return the picture with the spots added."""
        if self._spots is None:
            spots = draw_glints(levels.shape, self.config, self._rng)
            self._spots = spots if self.config.twinkle else spots.sum(axis=0, keepdims=True)
        if self.config.twinkle:
            strengths = 1.0 - self.config.twinkle * rng.random(len(self._spots), dtype=np.float32)
            light = np.tensordot(strengths, self._spots, axes=1)
        else:
            light = self._spots[0]
        return levels + per_channel(light, levels)


def draw_glints(shape: tuple[int, ...], config: GlintsConfig, rng: np.random.Generator) -> Float32s:
    """Return the light of each spot, (n, H, W) [grey levels].

    A core that would be twice as bright as white, so that its middle is cut off, and a veil three times as wide.
    """
    height, width = shape[:2]
    radius = math.sqrt(config.share * height * width / (config.n * math.pi))
    sigma = radius / math.sqrt(2.0 * math.log(2.0))
    turn = rng.uniform(0.0, 2.0 * math.pi)
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    spots = np.empty((config.n, height, width), np.float32)
    for i in range(config.n):
        at_u, at_v = rng.uniform(0, width), rng.uniform(0, height)
        if config.ring is not None:
            angle, reach = turn + 2.0 * math.pi * i / config.n, config.ring * min(height, width) / 2
            at_u, at_v = width / 2 + reach * math.cos(angle), height / 2 + reach * math.sin(angle)
        squared = ((u - at_u) ** 2 + (v - at_v) ** 2) / sigma**2
        spots[i] = 255.0 * (2.0 * np.exp(-0.5 * squared) + config.halo * np.exp(-0.5 * squared / 9.0))
    return spots


class VignetteConfig(PluginConfig):
    """Corners darker than the middle."""

    fall: float = Field(default=0.4, ge=0, le=1)
    """Share of the light that is missing in the corners; it grows with the square of the distance from the middle."""


class Vignette(PictureFault):
    """A picture darker towards its corners."""

    config: VignetteConfig

    def start(self, session: Session) -> None:
        """Forget the size of the run before."""
        self._gain: GreyF | None = None

    def worsen(self, levels: Float32s, rng: np.random.Generator, since_s: float) -> Float32s:
        """Return the picture with dark corners."""
        if self._gain is None:
            self._gain = 1.0 - np.float32(self.config.fall) * radius_over(levels.shape) ** 2
        levels *= per_channel(self._gain, levels)
        return levels


class CoverConfig(TimeSpanConfig):
    """Something that lies on the lens from some time on: a leaf, a sheet of paper, a hand."""

    level: float = Field(default=20.0, ge=0, le=255)
    """How bright it is [grey levels]."""
    contrast: float = Field(default=0.0, ge=0, le=127)
    """Texture of its own, standard deviation: the picture then has content, and stands still [grey levels]."""
    texture_px: float = Field(default=3.0, gt=0)
    """How coarse this texture is [px]."""
    leak: float = Field(default=0.0, ge=0, lt=1)
    """Share of the light that still comes through."""
    noise: float = Field(default=1.0, ge=0)
    """Noise of the camera, which a covered lens does not take away, standard deviation [grey levels]."""


class Cover(PictureFault):
    """A cover with a texture of its own that is drawn once, and noise that is new in every picture."""

    config: CoverConfig

    def start(self, session: Session) -> None:
        """Forget the cover of the run before."""
        self._rng = session.rng
        self._cover: GreyF | None = None

    def is_on(self, since_s: float) -> bool:
        """Return whether the lens is covered now."""
        return self.config.includes(since_s)

    def worsen(self, levels: Float32s, rng: np.random.Generator, since_s: float) -> Float32s:
        """Return the cover, with what still comes through it."""
        config = self.config
        if self._cover is None:
            self._cover = config.level + config.contrast * smooth_noise(levels.shape, config.texture_px, self._rng)
        noise = config.noise * rng.standard_normal(levels.shape, dtype=np.float32)
        covered: Float32s = config.leak * levels + (1.0 - config.leak) * per_channel(self._cover, levels) + noise
        return covered


def smooth_noise(shape: tuple[int, ...], sigma_px: float, rng: np.random.Generator) -> GreyF:
    """Return a random texture of mean 0 and standard deviation 1, (H, W), smoothed by a Gaussian [px]."""
    import cv2

    rough = cv2.GaussianBlur(rng.standard_normal(shape[:2], dtype=np.float32), (0, 0), sigma_px)
    smooth: GreyF = ((rough - rough.mean()) / max(float(rough.std()), 1e-6)).astype(np.float32)
    return smooth
