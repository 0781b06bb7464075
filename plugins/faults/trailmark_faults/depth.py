"""Faults of depth cameras."""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Depth

__all__ = ["add_depth_noise"]


def add_depth_noise(depth_m: Depth, noise_m: float, rng: np.random.Generator) -> Depth:
    """Return depth with noise of a standard deviation [m]; what falls behind the camera is unknown."""
    noise = rng.standard_normal(depth_m.shape, dtype=np.float32) * np.float32(noise_m)
    noisy: Depth = np.where(depth_m + noise > 0, depth_m + noise, np.float32(np.nan))
    return noisy
