"""From light to bytes: exposure, the lens' falling off and blur, noise, tone curve, clipping."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np

from trailmark.arrays import AnyArray, Bgr8, Bools, Float32s
from trailmark.kernels import kernel
from trailmark_sim.hashing import hash2
from trailmark_sim.rng import frame_rng, stream_key
from trailmark_sim.workers import in_bands

__all__ = ["Film", "Sensitometry", "auto_exposure"]

_STEPS = 4096
_N_NOISE = 1 << 16
_F: Any = np.float32


@dataclass(frozen=True, slots=True)
class Sensitometry:
    """How a camera turns light into grey levels.

    Attributes
    ----------
    exposure : float or None
        Fixed exposure; None: automatic, from the picture itself.
    target : float
        Mean grey that the automatic exposure aims at, 0 to 1 of the tone curve's input.
    vignette : float
        Light lost in the corners.
    read_noise, shot_noise : float
        Standard deviation of a dark pixel, and what a white one has besides, as shares of white.
    blur_px : float
        Blur of the lens, one standard deviation [px].
    shoulder : float
        Highlights above this share of white are pressed together; 1: they clip.
    """

    exposure: float | None = None
    target: float = 0.28
    vignette: float = 0.25
    read_noise: float = 0.003
    shot_noise: float = 0.012
    blur_px: float = 0.6
    shoulder: float = 0.8


class _Noise(NamedTuple):
    """Noise of one picture: normal numbers, variances of a dark pixel and of unit light, seed of the picture."""

    strip: Float32s
    dark_var: Any
    light_var: Any
    seed: np.uint64


class Film:
    """Develops the pictures of one camera.

    Parameters
    ----------
    response : Sensitometry
        How it sees.
    shape : (int, int)
        Rows and columns [px].
    seed, stream
        Of the noise.
    mask : (H, W) bool or None
        Pixels that show anything; the others stay black but for the noise.
    """

    def __init__(
        self,
        response: Sensitometry,
        shape: tuple[int, int],
        seed: int,
        stream: str,
        mask: Bools | None = None,
    ) -> None:
        self._response, self._mask = response, mask
        self._seed, self._stream = seed, stream
        height, width = shape
        v, u = np.mgrid[0:height, 0:width]
        away = ((u - (width - 1) / 2) ** 2 + (v - (height - 1) / 2) ** 2) / ((width / 2) ** 2 + (height / 2) ** 2)
        self._falling = ((1.0 - response.vignette * away) * (1.0 if mask is None else mask)).astype(np.float32)
        self._noise = frame_rng(seed, f"{stream}/grain").standard_normal(_N_NOISE).astype(np.float32)
        self._tone = _tone_curve(response.shoulder)

    def develop(self, radiance: Float32s, k: int, gain: float, threads: int) -> Bgr8:
        """Return picture number `k`, (H, W, 3) uint8 BGR, of light (H, W, 3) red, green, blue."""
        sigma = self._response.blur_px
        if sigma > 0.0:
            reach = 2 * max(1, round(2.5 * sigma)) + 1
            radiance = np.asarray(cv2.GaussianBlur(radiance, (reach, reach), sigma), np.float32)
        exposure = self._response.exposure
        exposure = auto_exposure(radiance, self._response.target, self._mask) if exposure is None else exposure
        out = np.empty(radiance.shape, np.uint8)
        seed = np.uint64(stream_key(self._seed, f"{self._stream}/noise/{k}"))
        noise = _Noise(self._noise, _F(self._response.read_noise**2), _F(self._response.shot_noise**2), seed)

        def work(first: int, last: int) -> None:
            _develop_rows(first, last, radiance, self._falling, _F(exposure * gain), noise, self._tone, out)

        in_bands(work, len(out), threads)
        return out


def auto_exposure(radiance: Float32s, target: float, mask: Bools | None = None) -> float:
    """Return the gain that brings the mean light, with bright places cut off, to the target."""
    seen = radiance[::4, ::4] if mask is None else radiance[::4, ::4][mask[::4, ::4]]
    grey = np.sort(seen.reshape(-1, 3)[:, 1].astype(np.float64))
    if len(grey) == 0:
        return 1.0
    # A lamp or a window in the picture is not to make everything else dark.
    ceiling = 4.0 * float(grey[len(grey) // 2]) + 1e-6
    return target / max(1e-6, float(np.minimum(grey, ceiling).mean()))


def _tone_curve(shoulder: float) -> Bgr8:
    """Return grey levels for light from 0 to 2 in equal steps: a square root with a soft shoulder."""
    light = np.linspace(0.0, 2.0, _STEPS)
    if shoulder < 1.0:
        room = 1.0 - shoulder
        beyond = np.maximum(light - shoulder, 0.0)
        light = np.where(light > shoulder, shoulder + room * (1.0 - np.exp(-beyond / room)), light)
    return np.round(255.0 * np.sqrt(np.clip(light, 0.0, 1.0))).astype(np.uint8)


@kernel(error_model="numpy")
def _develop_rows(
    first: int,
    last: int,
    radiance: AnyArray,
    falling: AnyArray,
    gain: float,
    noise: _Noise,
    tone: AnyArray,
    out: AnyArray,
) -> None:
    width = radiance.shape[1]
    scale, top = _F((_STEPS - 1) / 2.0), np.int32(_STEPS - 1)
    index = np.empty(width, np.int32)
    strip, dark_var, light_var, seed = noise
    for row in range(first, last):
        for c in range(3):
            # A long strip of noise, entered at another place for each row, colour and picture.
            at = np.int64(hash2(row, c, seed) % np.uint64(_N_NOISE - width))
            for u in range(width):
                light = radiance[row, u, c] * falling[row, u] * gain
                light += strip[at + u] * np.sqrt(dark_var + light_var * light)
                index[u] = min(top, max(np.int32(0), np.int32(light * scale + _F(0.5))))
            for u in range(width):
                out[row, u, 2 - c] = tone[index[u]]
