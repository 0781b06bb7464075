"""Faults of depth cameras."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pydantic import Field

from trailmark.arrays import Depth
from trailmark.config import PluginConfig
from trailmark.deprecation import deprecated_name
from trailmark.frames import RGBD, Frame
from trailmark.interfaces import Fault

__all__ = ["DepthHoles", "DepthHolesConfig", "DepthShift", "DepthShiftConfig", "add_depth_noise", "shift_depth"]


def add_depth_noise(depth_m: Depth, noise_m: float, rng: np.random.Generator) -> Depth:
    """Return depth with noise of a standard deviation [m]; what falls behind the camera is unknown."""
    noise = rng.standard_normal(depth_m.shape, dtype=np.float32) * np.float32(noise_m)
    noisy: Depth = np.where(depth_m + noise > 0, depth_m + noise, np.float32(np.nan))
    return noisy


class DepthHolesConfig(PluginConfig):
    """Depth that is unknown in places: black, shiny or slanted surfaces, sunlight."""

    share: float = Field(default=0.1, gt=0, le=1)
    """Share of the depth picture, new places in every picture; where they overlap it is less."""
    size_px: float = Field(default=20.0, gt=0)
    """Typical width of a hole [px]."""


class DepthHoles(Fault):
    """Discs without depth; colour stays."""

    kinds = frozenset({"rgbd"})
    config: DepthHolesConfig

    def apply(self, frame: Frame, rng: np.random.Generator, since_s: float) -> Frame:
        """Return the frame with holes in its depth."""
        if not isinstance(frame.payload, RGBD):
            return frame
        import cv2

        depth_m = frame.payload.depth_m
        height, width = depth_m.shape
        n = max(1, round(self.config.share * height * width / (math.pi * self.config.size_px**2 / 4)))
        centres = rng.random((n, 2)) * (width, height)
        radii = np.maximum(1, np.rint(self.config.size_px / 2 * rng.uniform(0.6, 1.4, n))).astype(int)
        holes = np.zeros(depth_m.shape, np.uint8)
        for (u, v), radius in zip(centres.astype(int).tolist(), radii.tolist()):
            cv2.circle(holes, (u, v), radius, 1, -1)
        holed = np.where(holes > 0, np.float32(np.nan), depth_m)
        return Frame(frame.sensor, frame.stamp_s, RGBD(frame.payload.bgr, holed))


class DepthShiftConfig(PluginConfig):
    """Depth that belongs to other pixels of the colour picture than is believed: the two are not registered."""

    u_px: int = 8
    """Depth lies so many columns further right in its picture than is believed [px]."""
    v_px: int = 0
    """And so many rows further down [px]."""


class DepthShift(Fault):
    """Depth moved against colour."""

    kinds = frozenset({"rgbd"})
    config: DepthShiftConfig

    def apply(self, frame: Frame, rng: np.random.Generator, since_s: float) -> Frame:
        """Return the frame with its depth moved."""
        if not isinstance(frame.payload, RGBD):
            return frame
        moved = shift_depth(frame.payload.depth_m, self.config.u_px, self.config.v_px)
        return Frame(frame.sensor, frame.stamp_s, RGBD(frame.payload.bgr, moved))


def shift_depth(depth_m: Depth, u_px: int, v_px: int) -> Depth:
    """Return depth moved to the right and down; what comes in is unknown."""
    height, width = depth_m.shape
    moved = np.full_like(depth_m, np.nan)
    if abs(u_px) < width and abs(v_px) < height:
        rows, from_rows = slice(max(v_px, 0), height + min(v_px, 0)), slice(max(-v_px, 0), height + min(-v_px, 0))
        columns, from_columns = slice(max(u_px, 0), width + min(u_px, 0)), slice(max(-u_px, 0), width + min(-u_px, 0))
        moved[rows, columns] = depth_m[from_rows, from_columns]
    return moved


def __getattr__(name: str) -> Any:
    return deprecated_name(__name__, name, {"shifted": shift_depth})
