"""SURF beside OpenCV's SIFT and ORB on photographs that installed libraries ship: how good, and how quick.

    python benchmarks/surf_photographs.py [--folder DIR]

Photographs are those of scikit-image, scikit-learn and matplotlib (``pip install scikit-image``), or all of a folder,
in grey and 320 x 240. Each is warped in nine ways that are known to the bit, and features of both pictures are matched.

* repeatability: of the features that both pictures show, how many have one of the other picture within 2 px.
* precision: of the matches (each other's nearest, ratio 0.7), how many are within 2 px of where they belong.
* matching score: of the features that are repeated, how many are matched rightly.

Times are CPU time of one thread, medians of turns that alternate.
"""

from __future__ import annotations

import argparse
import importlib.util
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from trailmark_omni_surf.features import FeatureExtractor, Features, create_features, match

Grey = npt.NDArray[np.uint8]
Matrix = npt.NDArray[np.float64]

SIZE, N_BEST, WITHIN_PX, RATIO = (320, 240), 200, 2.0, 0.7
#: By module, those that are photographs, and no drawing, microscope, telescope or written page.
PHOTOGRAPHS: Mapping[str, tuple[str, ...]] = {
    "skimage": (
        *("data/astronaut.png", "data/brick.png", "data/camera.png", "data/chelsea.png", "data/coffee.png"),
        *("data/coins.png", "data/grass.png", "data/gravel.png", "data/motorcycle_left.png", "data/rocket.jpg"),
    ),
    "sklearn": ("datasets/images/china.jpg", "datasets/images/flower.jpg"),
    "matplotlib": ("mpl-data/sample_data/grace_hopper.jpg",),
}


def photographs() -> Iterator[Grey]:
    """Yield the photographs of the libraries that are installed."""
    for module, names in PHOTOGRAPHS.items():
        spec = importlib.util.find_spec(module)
        if spec is None or spec.origin is None:
            raise SystemExit(f"photographs of {module} are missing; pip install scikit-image scikit-learn matplotlib")
        yield from (grey(Path(spec.origin).parent / name) for name in names)


def grey(path: Path) -> Grey:
    """Return a photograph, its middle cut to 4 : 3, in grey and of the size that is compared."""
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise SystemExit(f"no picture at {path}")
    height, width = image.shape
    kept_w, kept_h = min(width, height * 4 // 3), min(height, width * 3 // 4)
    top, left = (height - kept_h) // 2, (width - kept_w) // 2
    kept = image[top : top + kept_h, left : left + kept_w]
    return np.asarray(cv2.resize(kept, SIZE, interpolation=cv2.INTER_AREA), np.uint8)


def turned(angle_deg: float, scale: float = 1.0) -> Matrix:
    """Return a turn about the middle, (3, 3) [px]."""
    middle = ((SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2)
    return np.vstack([cv2.getRotationMatrix2D(middle, angle_deg, scale), [0.0, 0.0, 1.0]])


def tilted(angle_deg: float, about_v: bool) -> Matrix:
    """Return the homography of a plane that is tilted before a camera whose picture is as wide as it is far away."""
    focal, angle = float(SIZE[0]), np.radians(angle_deg)
    camera = np.array([[focal, 0, (SIZE[0] - 1) / 2], [0, focal, (SIZE[1] - 1) / 2], [0, 0, 1]])
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array(
        [[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]] if about_v else [[1, 0, 0], [0, cos, -sin], [0, sin, cos]]
    )
    plane = turn @ np.diag([1.0, 1.0, 0.0]) + np.outer([0.0, 0.0, 1.0], [0.0, 0.0, 1.0])
    return np.asarray(camera @ plane @ np.linalg.inv(camera))


#: Name, homography, gain, sigma of a blur [px] and of noise [grey levels].
WARPS: tuple[tuple[str, Matrix, float, float, float], ...] = (
    ("turned by 25 deg", turned(25.0), 1.0, 0.0, 2.0),
    ("turned by 110 deg", turned(110.0), 1.0, 0.0, 2.0),
    ("0.67 of the size", turned(0.0, 0.67), 1.0, 0.0, 2.0),
    ("1.5 of the size, turned by 15 deg", turned(15.0, 1.5), 1.0, 0.0, 2.0),
    ("tilted by 35 deg", tilted(35.0, True), 1.0, 0.0, 2.0),
    ("tilted by 45 deg the other way", tilted(45.0, False), 1.0, 0.0, 2.0),
    ("blurred", turned(3.0), 1.0, 1.2, 2.0),
    ("dark", turned(8.0), 0.5, 0.0, 2.0),
    ("noisy", turned(0.0), 1.0, 0.0, 9.0),
)


def warped(image: Grey, homography: Matrix, gain: float, blur_px: float, noise: float, seed: int) -> Grey:
    """Return what a camera sees after a warp."""
    seen = cv2.warpPerspective(image, homography, SIZE, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_CONSTANT)
    if blur_px > 0.0:
        seen = cv2.GaussianBlur(seen, (0, 0), blur_px)
    noisy = gain * seen + np.random.default_rng(seed).normal(0.0, noise, seen.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def moved(points: Matrix, homography: Matrix) -> Matrix:
    """Return where points (N, 2) are after a homography [px]."""
    rows = np.column_stack([points, np.ones(len(points))]) @ homography.T
    return np.asarray(rows[:, :2] / rows[:, 2:])


def is_inside(points: Matrix, margin_px: float = 8.0) -> npt.NDArray[np.bool_]:
    """Whether points are in the picture."""
    return np.all((points >= margin_px) & (points <= np.array(SIZE) - 1 - margin_px), axis=1)


def score(first: Features, second: Features, homography: Matrix) -> tuple[float, float, float]:
    """Return repeatability, precision and matching score of two pictures' features; NaN of nothing."""
    first = first.select(is_inside(moved(first.uv, homography)))
    second = second.select(is_inside(moved(second.uv, np.linalg.inv(homography))))
    if min(len(first), len(second)) == 0:
        return np.nan, np.nan, np.nan
    distance = np.linalg.norm(moved(first.uv, homography)[:, None] - second.uv[None], axis=2)
    n_repeated = min((distance.min(axis=1) <= WITHIN_PX).sum(), (distance.min(axis=0) <= WITHIN_PX).sum())
    one, other, _ = match(first.descriptors, first.sign, second.descriptors, second.sign, 2.0, RATIO)
    n_right = (distance[one, other] <= WITHIN_PX).sum()
    n = min(len(first), len(second))
    return n_repeated / n, n_right / max(len(one), 1), n_right / max(n_repeated, 1)


def compared(images: list[Grey], methods: Mapping[str, Callable[[], FeatureExtractor]]) -> dict[str, Matrix]:
    """Return the mean over all warps of all photographs of each method: three scores and the median time [ms]."""
    extractors = {name: make() for name, make in methods.items()}
    scores: dict[str, list[tuple[float, float, float]]] = {name: [] for name in methods}
    times: dict[str, list[float]] = {name: [] for name in methods}
    for extract in extractors.values():
        extract(images[0])
    for seed, image in enumerate(images):
        plain = {name: extract(image) for name, extract in extractors.items()}
        for k, (_, homography, gain, blur_px, noise) in enumerate(WARPS):
            seen = warped(image, homography, gain, blur_px, noise, 100 * seed + k)
            for name, extract in extractors.items():
                began = time.thread_time()
                found = extract(seen)
                times[name].append(1e3 * (time.thread_time() - began))
                scores[name].append(score(plain[name], found, homography))
    return {name: np.append(np.nanmean(scores[name], axis=0), np.median(times[name])) for name in methods}


METHODS: dict[str, Callable[[], FeatureExtractor]] = {
    "surf fast": lambda: create_features("surf", N_BEST),
    "surf compact": lambda: create_features("surf", N_BEST, "compact"),
    "surf quality": lambda: create_features("surf", N_BEST, "quality"),
    "sift of OpenCV": lambda: create_features("sift", N_BEST),
    "orb of OpenCV": lambda: create_features("orb", N_BEST),
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, help="take the pictures of a folder instead")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    images = [grey(path) for path in sorted(options.folder.iterdir())] if options.folder else list(photographs())
    print(f"{len(images)} photographs, {len(WARPS)} warps each")
    for name, (repeated, precision, right, ms) in compared(images, METHODS).items():
        print(f"{name:<20}{repeated:8.3f}{precision:8.3f}{right:8.3f}{ms:8.2f} ms")


if __name__ == "__main__":
    main()
