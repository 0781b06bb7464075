"""Payloads as a sensor gives them on a bad day."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from trailmark.frames import RGBD, Image, Payload, Scan

__all__ = ["Spoil", "payloads_of_other_size", "spoil"]

Spoil = Literal["black", "white", "noise", "truncated"]


def spoil(payload: Payload, how: Spoil, rng: np.random.Generator) -> Payload | None:
    """Return a payload of the same size with nothing, too much, noise or only half of it to see; None: no picture.

    A depth or range is unknown where there is nothing or too much to see; a truncated picture is grey below its
    middle, as decoders leave it, and a truncated scan ends at its middle.
    """
    match payload:
        case Image(pixels):
            return Image(_pixels(pixels, how, rng))
        case RGBD(bgr, depth_m):
            return RGBD(_pixels(bgr, how, rng), _ranges(depth_m, how, rng))
        case Scan():
            ranges = _ranges(payload.ranges_m, how, rng)
            return Scan(ranges, payload.angle_min_rad, payload.angle_step_rad, payload.range_min_m, payload.range_max_m)
        case _:
            return None


def payloads_of_other_size(payload: Payload) -> tuple[Payload, ...]:
    """Return the same reading at half its size, and in another type of number; empty where it has no size."""
    match payload:
        case Image(pixels):
            other = pixels[..., 0] if pixels.ndim == 3 else np.dstack([pixels.astype(np.uint8)] * 3)
            return Image(np.ascontiguousarray(pixels[::2, ::2])), Image(np.ascontiguousarray(other))
        case RGBD(bgr, depth_m):
            small = np.ascontiguousarray(bgr[::2, ::2]), np.ascontiguousarray(depth_m[::2, ::2])
            return RGBD(*small), RGBD(bgr, np.ascontiguousarray(depth_m[::2, ::2]))
        case Scan(ranges_m, angle_min_rad, angle_step_rad):
            return (Scan(ranges_m[::2].astype(np.float64), angle_min_rad, 2 * angle_step_rad),)
        case _:
            return ()


def _pixels(pixels: Any, how: Spoil, rng: np.random.Generator) -> Any:
    highest = int(np.iinfo(pixels.dtype).max)
    if how == "noise":
        return rng.integers(0, highest, pixels.shape, pixels.dtype, endpoint=True)
    if how == "truncated":
        cut = np.array(pixels)
        cut[len(cut) // 2 :] = highest // 2
        return cut
    return np.full_like(pixels, 0 if how == "black" else highest)


def _ranges(ranges_m: Any, how: Spoil, rng: np.random.Generator) -> Any:
    if how == "noise":
        return rng.uniform(0.1, 10.0, ranges_m.shape).astype(ranges_m.dtype)
    cut = np.array(ranges_m)
    cut[len(cut) // 2 if how == "truncated" else 0 :] = np.nan
    return cut
