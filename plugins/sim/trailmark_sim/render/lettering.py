"""Text and signs: OpenCV 5 has outline fonts built in; older ones draw strokes."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from trailmark.arrays import Bgr8, Floats
from trailmark_sim.render.textures import clouds

__all__ = ["notice", "poster", "sign", "write"]

Rgb = Sequence[float]
_WORDS = (
    *("open", "exit", "storage", "notice", "seminar", "robotics", "spring", "please", "keep", "clear", "meeting"),
    *("safety", "level", "schedule", "laboratory", "printer", "north", "staff", "visitors", "monday", "welcome"),
)


def write(picture: Bgr8, text: str, left: int, base: int, height_px: int, colour: Rgb) -> None:
    """Write a line of text into a picture; `base` is the row of the base line [px]."""
    if hasattr(cv2, "FontFace"):
        face = cv2.FontFace("sans")
        size = max(4, round(height_px * 1.3))
        cv2.putText(picture, text, (left, base), tuple(colour), face, size, 700)
        return
    scale = height_px / 22.0
    weight = max(1, round(height_px / 9))
    cv2.putText(picture, text, (left, base), cv2.FONT_HERSHEY_DUPLEX, scale, tuple(colour), weight, cv2.LINE_AA)


def sign(text: str, background: Rgb, ink: Rgb, width: int = 256, height: int = 128) -> Bgr8:
    """Return a sign with one word as large as fits, and a border."""
    picture = np.full((height, width, 3), background, np.uint8)
    letter_px = int(min(height * 0.5, 0.84 * width / max(1, len(text))))
    write(picture, text, int(width * 0.06), int(height * 0.5 + letter_px * 0.4), letter_px, ink)
    cv2.rectangle(picture, (3, 3), (width - 4, height - 4), [float(c) for c in ink], 4)
    return picture


def poster(rng: np.random.Generator, size: int = 256) -> Bgr8:
    """Return a poster: a coloured ground, a headline, shapes, a block of small print."""
    first, second = _colour(rng), _colour(rng)
    picture = clouds(rng, first.tolist(), second.tolist(), size, 1.6)
    for _ in range(int(rng.integers(3, 8))):
        x, y, r = (int(v) for v in rng.integers(size // 8, 7 * size // 8, 3) * (1.0, 1.0, 0.3))
        colour = _colour(rng).tolist()
        if rng.random() < 0.5:
            cv2.circle(picture, (x, y), max(4, r), colour, -1, cv2.LINE_AA)
        else:
            cv2.rectangle(picture, (x, y), (x + 2 * r, y + r), colour, -1)
    ink = (245.0, 245.0, 245.0) if first.mean() < 128 else (15.0, 15.0, 15.0)
    write(picture, str(rng.choice(_WORDS)).upper(), size // 16, size // 6, size // 10, ink)
    _small_print(rng, picture, int(size * 0.68), ink)
    return picture


def notice(rng: np.random.Generator, size: int = 256) -> Bgr8:
    """Return a sheet of paper with a headline, lines and sometimes a figure."""
    picture = np.full((size, size, 3), float(rng.uniform(215, 250)), np.uint8)
    write(picture, str(rng.choice(_WORDS)).capitalize(), size // 12, size // 6, size // 10, (25, 25, 30))
    top = int(size * rng.uniform(0.25, 0.5))
    if rng.random() < 0.6:
        colour = rng.uniform(20, 220, 3).tolist()
        cv2.rectangle(picture, (size // 10, size // 4), (9 * size // 10, top), colour, -1)
    _small_print(rng, picture, top + size // 14, (45, 45, 50))
    return picture


def _colour(rng: np.random.Generator) -> Floats:
    """Return a colour as printed: seldom a pure one."""
    grey, hue = rng.uniform(20, 235), rng.uniform(0, 255, 3)
    return np.asarray(0.45 * grey + 0.55 * hue)


def _small_print(rng: np.random.Generator, picture: Bgr8, top: int, ink: Rgb) -> None:
    size = picture.shape[0]
    step = size // 18
    for base in range(top + step, size - size // 16, step):
        n = int(rng.integers(2, 5))
        write(picture, " ".join(str(word) for word in rng.choice(_WORDS, n)), size // 12, base, step // 2, ink)
