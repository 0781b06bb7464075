"""Procedural textures: (H, W, 3) RGB uint8 whose sides are powers of two; those that repeat fit at their seams."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import cv2
import numpy as np

from trailmark.arrays import Bgr8, Float32s

__all__ = [
    "boards",
    "bricks",
    "clouds",
    "door",
    "facade",
    "foliage",
    "noise",
    "panels",
    "paving",
    "plaster",
    "products",
    "speckle",
    "tint",
    "window",
]

Rgb = Sequence[float]


def noise(rng: np.random.Generator, size: int, slope: float = 1.0, finest_px: float = 2.0) -> Float32s:
    """Return noise (size, size) of mean 0 and deviation 1 whose amplitude falls with frequency; it repeats."""
    white = np.fft.rfft2(rng.standard_normal((size, size)))
    fy, fx = np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None]
    frequency = np.hypot(fx, fy)
    frequency[0, 0] = 1.0
    shaped = white / frequency**slope * np.exp(-((frequency * finest_px) ** 2))
    shaped[0, 0] = 0.0
    values = np.fft.irfft2(shaped, s=(size, size))
    return np.asarray(values / values.std(), np.float32)


def tint(grey: Float32s, colour: Rgb) -> Bgr8:
    """Return a picture of a relative brightness (about 1) in a colour [0, 255]."""
    return np.clip(grey[..., None] * np.asarray(colour, np.float32), 0, 255).astype(np.uint8)


def plaster(rng: np.random.Generator, colour: Rgb, size: int = 512, roughness: float = 0.02) -> Bgr8:
    """Return a painted wall: fine grain, faint stains, a few scratches."""
    grey = 1.0 + roughness * noise(rng, size, 0.3, 1.0) + roughness * noise(rng, size, 1.4)
    for _ in range(size // 40):
        start = rng.integers(0, size, 2)
        end = start + rng.integers(-size // 12, size // 12, 2)
        depth = float(rng.uniform(-0.12, 0.06))
        mark = np.zeros((size, size), np.float32)
        cv2.line(mark, start.tolist(), end.tolist(), depth, 1, cv2.LINE_AA)
        grey += mark
    return tint(np.asarray(grey, np.float32), colour)


def speckle(rng: np.random.Generator, colour: Rgb, size: int = 512, contrast: float = 0.12, joints: int = 0) -> Bgr8:
    """Return a floor of terrazzo or lino, with `joints` tiles along a side."""
    grey = 1.0 + contrast * 0.5 * noise(rng, size, 0.2, 1.5) + contrast * 0.5 * noise(rng, size, 0.9)
    chips = noise(rng, size, 0.0, 3.0)
    grey += contrast * 1.2 * (chips > 1.6) - contrast * 1.5 * (chips < -1.7)
    for n in range(joints):
        at = n * size // joints
        grey[at : at + 2] *= 0.75
        grey[:, at : at + 2] *= 0.75
    for i in range(joints):
        for j in range(joints):
            a, b = (slice(n * size // joints, (n + 1) * size // joints) for n in (i, j))
            grey[a, b] *= rng.uniform(0.95, 1.05)
    return tint(np.asarray(grey, np.float32), colour)


def boards(rng: np.random.Generator, colour: Rgb, size: int = 512, n_boards: int = 4) -> Bgr8:
    """Return wood: boards along u with grain."""
    grain = cv2.GaussianBlur(np.asarray(noise(rng, size, 0.3, 1.0)), (0, 0), sigmaX=14.0, sigmaY=0.6)
    grey = 1.0 + 0.5 * grain * 0.12 / max(1e-6, float(grain.std())) + 0.03 * noise(rng, size, 1.2)
    edges = np.linspace(0, size, n_boards + 1).astype(int)
    for top, bottom in itertools.pairwise(edges):
        grey[top:bottom] *= rng.uniform(0.85, 1.12)
        grey[top : top + 1] *= 0.6
    return tint(np.asarray(grey, np.float32), colour)


def bricks(
    rng: np.random.Generator, colour: Rgb, size: int = 512, rows: int = 16, columns: int = 8, contrast: float = 0.14
) -> Bgr8:
    """Return a wall of bricks, or tiles."""
    grey = np.ones((size, size), np.float32)
    high, wide = size // rows, size // columns
    for row in range(rows):
        for column in range(-1, columns):
            left = column * wide + (wide // 2) * (row % 2)
            shade = float(rng.normal(1.0, contrast))
            grey[row * high : (row + 1) * high, max(0, left) : max(0, left + wide)] = shade
            if left < 0:
                grey[row * high : (row + 1) * high, size + left :] = shade
    grey *= 1.0 + 0.06 * noise(rng, size, 0.4, 1.0) + 0.05 * noise(rng, size, 1.3)
    joint = np.zeros((size, size), np.bool_)
    for row in range(rows):
        joint[row * high : row * high + 2] = True
        for column in range(columns):
            left = column * wide + (wide // 2) * (row % 2)
            joint[row * high : (row + 1) * high, left : left + 2] = True
    picture = tint(grey, colour)
    picture[joint] = np.clip(150 + 12 * rng.standard_normal((int(joint.sum()), 1)), 0, 255).astype(np.uint8)
    return picture


def paving(rng: np.random.Generator, colour: Rgb, size: int = 512, rows: int = 8, contrast: float = 0.08) -> Bgr8:
    """Return square slabs with dirty joints and stains."""
    grey = 1.0 + 0.11 * noise(rng, size, 0.1, 0.8) + 0.07 * noise(rng, size, 1.2)
    side = size // rows
    for row in range(rows):
        for column in range(rows):
            grey[row * side : (row + 1) * side, column * side : (column + 1) * side] *= rng.normal(1.0, contrast)
    for n in range(rows):
        grey[n * side : n * side + 2] *= 0.6
        grey[:, n * side : n * side + 2] *= 0.6
    spots = noise(rng, size, 0.0, 4.0)
    grey *= np.where(spots > 2.3, 0.6, 1.0)
    return tint(np.asarray(grey, np.float32), colour)


def panels(rng: np.random.Generator, colour: Rgb, size: int = 512, n: int = 4) -> Bgr8:
    """Return a ceiling of mineral panels: pores and a grid of rails."""
    pores = noise(rng, size, 0.0, 1.6)
    grey = 1.0 - 0.10 * (pores > 1.7) + 0.01 * noise(rng, size, 1.0)
    side = size // n
    for k in range(n):
        grey[k * side : k * side + 3] = 1.02
        grey[k * side + 3 : k * side + 4] = 0.8
        grey[:, k * side : k * side + 3] = 1.02
        grey[:, k * side + 3 : k * side + 4] = 0.8
    return tint(np.asarray(grey, np.float32), colour)


def clouds(rng: np.random.Generator, dark: Rgb, bright: Rgb, size: int = 256, slope: float = 1.3) -> Bgr8:
    """Return soft patches between two colours: cloth, soil, a reflection."""
    part = np.clip(0.5 + 0.25 * noise(rng, size, slope, 1.5), 0, 1)[..., None]
    return np.asarray(np.asarray(dark) * (1 - part) + np.asarray(bright) * part, np.uint8)


def foliage(rng: np.random.Generator, colour: Rgb = (70, 95, 45), size: int = 256) -> Bgr8:
    """Return leaves: bright ones over dark gaps."""
    leaf, gap = noise(rng, size, 0.1, 2.5), noise(rng, size, 0.8, 2.0)
    grey = 0.75 + 0.38 * leaf + 0.26 * gap
    picture = tint(np.clip(grey, 0.12, 1.9), colour)
    hue = noise(rng, size, 0.3, 2.0)[..., None] * np.array([14.0, 6.0, 2.0])
    return np.asarray(np.clip(picture + hue, 0, 255), np.uint8)


def products(rng: np.random.Generator, width: int = 512, height: int = 128, n: int = 7) -> Bgr8:
    """Return the front of one shelf board: packets side by side in groups, each with label, stripes and small print."""
    picture = np.full((height, width, 3), 28, np.uint8)
    at = int(rng.integers(0, 4))
    while at < width - 12:
        wide = int(rng.integers(width // (2 * n), width // n))
        high = int(height * rng.uniform(0.62, 0.95))
        packet = _packet(rng, wide, high)
        for _ in range(int(rng.integers(2, 5))):
            if at >= width - 4:
                break
            shown = packet[:, : width - at]
            lit = float(rng.uniform(0.82, 1.0))
            picture[height - high :, at : at + shown.shape[1]] = (shown * lit).astype(np.uint8)
            at += wide + int(rng.integers(0, 3))
        at += int(rng.integers(0, max(2, width // 40)))
    return picture


def _packet(rng: np.random.Generator, wide: int, high: int) -> Bgr8:
    base = 0.4 * rng.uniform(20, 235) + 0.6 * rng.uniform(10, 240, 3)
    packet = np.full((high, wide, 3), base, np.float32)
    contrast = np.clip(255.0 - base + rng.uniform(-40, 40, 3), 10, 245)
    style = int(rng.integers(4))
    if style == 0:
        cv2.circle(packet, (wide // 2, high // 2), max(2, wide // 3), contrast.tolist(), -1, cv2.LINE_AA)
    elif style == 1:
        packet[high // 4 : high // 2] = contrast
    elif style == 2:
        packet[:, : wide // 3] = contrast
    else:
        cv2.rectangle(packet, (2, high // 3), (max(3, wide - 3), 2 * high // 3), contrast.tolist(), -1)
    for line in range(int(rng.integers(3, 9))):
        top = int(high * rng.uniform(0.05, 0.9))
        left, right = sorted(rng.integers(1, max(3, wide - 1), 2).tolist())
        packet[top : top + 1 + line % 2, left : right + 1] = rng.uniform(0, 255, 3)
    # Packets are round or bent: their edges are darker.
    across = np.linspace(-1.0, 1.0, wide, dtype=np.float32)[None, :, None]
    return np.asarray(np.clip(packet * (1.0 - 0.35 * across**4), 0, 255), np.uint8)


def door(rng: np.random.Generator, colour: Rgb, width: int = 256, height: int = 512) -> Bgr8:
    """Return a door with frame, panel, handle and a small plate."""
    grain = cv2.resize(boards(rng, colour, 512, 1), (width, height), interpolation=cv2.INTER_AREA)
    picture: Bgr8 = np.ascontiguousarray(np.rot90(np.asarray(cv2.resize(grain, (height, width)), np.uint8)))
    frame = (np.asarray(colour) * 0.55).tolist()
    cv2.rectangle(picture, (0, 0), (width - 1, height + 20), frame, 14)
    cv2.rectangle(picture, (60, 60), (width - 60, height // 2 - 20), frame, 3)
    cv2.rectangle(picture, (width - 52, height // 2 + 8), (width - 24, height // 2 + 16), (190, 190, 185), -1)
    cv2.circle(picture, (width - 34, height // 2 + 34), 5, (60, 60, 60), -1, cv2.LINE_AA)
    cv2.rectangle(picture, (90, 96), (166, 124), (235, 235, 228), -1)
    return picture


def window(rng: np.random.Generator, size: int = 256, panes: int = 2) -> Bgr8:
    """Return a window: blurred outdoors behind its frame."""
    picture = clouds(rng, (120, 140, 160), (255, 255, 255), size, 1.6)
    for n in range(panes + 1):
        at = round(n * (size - 1) / panes)
        cv2.line(picture, (at, 0), (at, size), (95, 95, 98), 10)
    cv2.line(picture, (0, size // 3), (size, size // 3), (95, 95, 98), 6)
    cv2.rectangle(picture, (0, 0), (size - 1, size - 1), (90, 90, 92), 12)
    return picture


def facade(rng: np.random.Generator, colour: Rgb, size: int = 1024, rows: int = 4, columns: int = 6) -> Bgr8:
    """Return a house front: plaster or brick, rows of windows with different curtains and reflections."""
    wall = bricks(rng, colour, size, 64, 32, 0.16) if rng.random() < 0.5 else plaster(rng, colour, size, 0.07)
    picture = np.ascontiguousarray(wall)
    high, wide = size // rows, size // columns
    for row in range(rows):
        picture[row * high : row * high + 6] = (np.asarray(colour) * 0.8).astype(np.uint8)
        for column in range(columns):
            _put_window(rng, picture, row * high + high // 5, column * wide + wide // 5, 3 * high // 5, 3 * wide // 5)
    stains = 1.0 + 0.05 * noise(rng, size, 1.3)
    return np.asarray(np.clip(picture * stains[..., None], 0, 255), np.uint8)


def _put_window(rng: np.random.Generator, picture: Bgr8, top: int, left: int, high: int, wide: int) -> None:
    pane = cv2.resize(clouds(rng, (18, 22, 28), (95, 110, 130), 64, 1.5), (wide, high))
    if rng.random() < 0.5:
        pane[: int(high * rng.uniform(0.2, 0.9))] = rng.uniform(120, 225, 3).astype(np.uint8)
    frame = rng.uniform(60, 235) * np.ones(3)
    cv2.rectangle(pane, (0, 0), (wide - 1, high - 1), frame.tolist(), 6)
    cv2.line(pane, (wide // 2, 0), (wide // 2, high), frame.tolist(), 4)
    cv2.line(pane, (0, high // 3), (wide, high // 3), frame.tolist(), 3)
    picture[top : top + high, left : left + wide] = pane
    picture[top + high : top + high + 8, left - 6 : left + wide + 6] = (frame * 0.8).astype(np.uint8)
