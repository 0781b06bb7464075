"""Times of the omnidirectional camera's parts, beside OpenCV's SIFT in the same run, on one core.

    python benchmarks/omni_surf.py [--quick] [--json]

Pictures are made of random rectangles and noise: nothing is read from disk. Methods take turns, so that what else
the machine does hits all of them. ``x SIFT(200)`` is how many times faster than OpenCV's SIFT with 200 features.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.geometry import Pose2
from trailmark_omni_surf.bearings import locate
from trailmark_omni_surf.circle import find_circle
from trailmark_omni_surf.features import create_features
from trailmark_omni_surf.landmark_map import LandmarkMap
from trailmark_omni_surf.tracking import track_points

Grey = npt.NDArray[np.uint8]
Work = Callable[[], Any]

SIZES = ((320, 240), (640, 480))
#: Bars in ms; the paper's frame took 46.8 ms with SURF and 16.4 ms on average with tracking, on hardware of 2010.
BARS_MS = {
    ("surf fast", (320, 240)): 5.0,
    ("surf fast", (640, 480)): 12.0,
    ("surf quality", (320, 240)): 8.0,
    ("surf quality", (640, 480)): 25.0,
}
PEER = "cv2 sift(200)"


def picture(size: tuple[int, int], seed: int) -> Grey:
    """Return rectangles of many sizes and greys, blurred a little, with noise."""
    rng = np.random.default_rng(seed)
    width, height = size
    image = np.full((height, width), 128, np.uint8)
    for _ in range(width * height // 350):
        u, v = rng.integers(0, width), rng.integers(0, height)
        w, h = np.exp(rng.uniform(1.0, 4.0, 2)).astype(int)
        image[v : v + h, u : u + w] = rng.integers(0, 255)
    noisy = cv2.GaussianBlur(image, (0, 0), 0.8) + rng.normal(0, 2, image.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def works(size: tuple[int, int], image: Grey) -> dict[str, Work]:
    """Return what is timed at one picture size."""
    n_fast = 200 if size == (320, 240) else 600
    fast = create_features("surf", n_fast)
    quality, sift = create_features("surf", 200, "quality"), create_features("sift", 200)
    moved = np.roll(image, (1, 2), axis=(0, 1))
    points = fast(image).uv[:30]
    return {
        "surf fast": lambda: fast(image),
        "surf quality": lambda: quality(image),
        PEER: lambda: sift(image),
        "track 30 points": lambda: track_points(image, moved, points, return_px=None),
    }


def pose_works() -> dict[str, Work]:
    """Return what needs no picture size: poses from bearings, and the search for the circle."""
    rng = np.random.default_rng(3)
    landmarks = rng.uniform(-5, 5, (12, 2))
    bearings = np.arctan2(landmarks[:, 1], landmarks[:, 0]) + rng.normal(0, 0.01, 12)
    disc = np.zeros((240, 320), np.uint8)
    cv2.circle(disc, (160, 120), 110, 170, -1)
    seen, taught = create_features("surf", 250)(picture((320, 240), 4)), places(1000, rng)
    rim = np.where(disc > 0, picture((320, 240), 9), 5).astype(np.uint8)
    return {
        "locate 12 bearings, no start": lambda: locate(landmarks, bearings),
        "locate 12 bearings, tracked": lambda: locate(landmarks, bearings, start=Pose2(0.05, 0.0, 0.0)),
        "match 250 features, 1000 landmarks": lambda: taught.match(seen, 0.4, 0.85),
        "find the image circle (once)": lambda: find_circle(rim),
    }


def places(n: int, rng: np.random.Generator) -> LandmarkMap:
    """Return a map of `n` landmarks with three descriptors each, as unlike as chance makes them."""
    exemplars = rng.normal(size=(3 * n, 64)).astype(np.float32)
    exemplars /= np.linalg.norm(exemplars, axis=1, keepdims=True)
    signs, first = rng.choice(np.array([-1, 1], np.int8), 3 * n), np.arange(0, 3 * n, 3)
    return LandmarkMap(rng.uniform(0, 10, (n, 2)), np.zeros((n, 2, 2)), exemplars, signs, first, "surf")


def times_ms(chosen: dict[str, Work], rounds: int) -> dict[str, list[float]]:
    """Return the CPU times of every work, taking turns."""
    spent: dict[str, list[float]] = {name: [] for name in chosen}
    for work in chosen.values():
        work()
    for _ in range(rounds):
        for name, work in chosen.items():
            start = time.thread_time()
            work()
            spent[name].append(1e3 * (time.thread_time() - start))
    return spent


def rows(rounds: int, n_pictures: int) -> list[dict[str, Any]]:
    """Measure everything; one row a method and size."""
    found: list[dict[str, Any]] = []
    for size in SIZES:
        spent: dict[str, list[float]] = {}
        for seed in range(n_pictures):
            for name, values in times_ms(works(size, picture(size, seed)), rounds).items():
                spent.setdefault(name, []).extend(values)
        peer = float(np.median(spent[PEER]))
        found += [
            _row(name, values, f"{size[0]}x{size[1]}", BARS_MS.get((name, size)), peer)
            for name, values in spent.items()
        ]
    found += [_row(name, values, "", None, None) for name, values in times_ms(pose_works(), 3 * rounds).items()]
    return found


def _row(name: str, values: list[float], size: str, bar: float | None, peer: float | None) -> dict[str, Any]:
    median = float(np.median(values))
    against = peer / median if peer is not None and name.startswith("surf") else None
    met = None if bar is None else median <= bar
    return {"item": name, "size": size, "median_ms": median, "min_ms": min(values), "bar_ms": bar, "met": met,
            "times_faster_than_sift": against}  # fmt: skip


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer pictures and rounds")
    parser.add_argument("--json", action="store_true", help="print as JSON")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    found = rows(5, 2) if arguments.quick else rows(20, 6)
    if arguments.json:
        print(json.dumps(found, indent=1))
        return
    print(f"{'item':<36}{'size':<10}{'median':>9}{'min':>9}{'bar':>7}  x SIFT(200)")
    for row in found:
        bar = "" if row["bar_ms"] is None else f"{row['bar_ms']:.0f}"
        ratio = "" if row["times_faster_than_sift"] is None else f"{row['times_faster_than_sift']:.1f}"
        print(f"{row['item']:<36}{row['size']:<10}{row['median_ms']:>6.2f} ms{row['min_ms']:>6.2f} ms{bar:>7}  {ratio}")


if __name__ == "__main__":
    main()
