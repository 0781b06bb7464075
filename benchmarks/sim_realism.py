"""How much the simulator's pictures are like photographs: the same statistics of both, side by side.

    python benchmarks/sim_realism.py [--data FOLDER]

Every statistic of a world should lie between 0.8 of the least and 1.25 of the greatest of the real pictures named
with it; what lies outside is marked. Parameters of the worlds are fixed by this table and never by what a localizer
makes of them. Pictures are brought to the size of the smaller side before they are compared.
"""

from __future__ import annotations

import argparse
import importlib
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.geometry import Pose2
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds.base import WorldOptions

Grey = npt.NDArray[np.uint8]
_PATCH, _REACH = 22, 16
_SIFT: Any = cv2.SIFT_create()  # type: ignore[attr-defined]


@dataclass(frozen=True)
class Comparison:
    """A world, where it is looked at, and the photographs that it is compared with."""

    world: str
    sensor: str
    poses: Sequence[tuple[float, float, float]]
    real: Sequence[str]
    height: int
    options: dict[str, Any]


COMPARISONS = (
    Comparison(
        "supermarket",
        "omni",
        ((1.2, 2.0, 0), (5.1, 5.6, 90), (5.5, 3.1, 30), (1.0, 7.6, 0), (8.9, 5.6, 180), (3.0, 2.0, 0)),
        ("omni/samples/hiperbolico_imagem1.jpg", "omni/samples/omniunwarp_example.jpg", "omni/samples/fisheye*.jpg"),
        240,
        {"people": 2},
    ),
    Comparison(
        "lab",
        "rgbd",
        ((0.8, 2.6, 0), (3, 2.8, 120), (2, 1.7, 60), (4.0, 3.6, -30)),
        ("rgbd/fr1_rpy_0_5s/rgb/*[05].jpg", "omni/photos/home.jpg"),
        480,
        {},
    ),
    Comparison(
        "hallway",
        "rgbd",
        ((0, 0, 0), (3, 0, 8), (6, 0, 0), (5, 0, -8)),
        ("rgbd/fr1_rpy_0_5s/rgb/*[05].jpg", "omni/photos/home.jpg"),
        480,
        {},
    ),
    Comparison(
        "corridor",
        "front",
        ((0, 0, 0), (4, 0.1, 3), (8, 0, 0), (12, -0.1, -3), (16, 0, 0)),
        ("divs/corridor/ref/00000[1-9]0.jpg", "divs/corridor/query/00000[1-9]5.jpg"),
        120,
        {"people": 2},
    ),
    Comparison(
        "street",
        "front",
        ((0, 0, 0), (6, 0, 3), (12, 0, 0), (18, 0, -3), (25, 0, 0)),
        ("divs/kitti_raw_stereo/left/*[05]0.*", "omni/photos/building.jpg", "omni/photos/leuvenA.jpg"),
        375,
        {"people": 3},
    ),
)
STATISTICS = ("SIFT/MP", "corners/MP", "edges", "slope", "contrast", "distinct")


def statistics(grey: Grey) -> list[float]:
    """Return keypoints and corners per megapixel, edge density, spectral slope, deviation, SAD distinctiveness."""
    megapixels = grey.size / 1e6
    sift = len(_SIFT.detect(grey, None)) / megapixels
    found = cv2.goodFeaturesToTrack(grey, 5000, 0.01, 3)
    corners = (0 if found is None else len(found)) / megapixels
    edges = float((cv2.Canny(grey, 80, 160) > 0).mean())
    return [sift, corners, edges, _slope(grey), float(grey.std()), _distinctiveness(grey)]


def _slope(grey: Grey) -> float:
    """Return the exponent with which power falls with frequency, between 1/64 and 1/4 of a cycle per pixel."""
    side = min(grey.shape)
    top, left = (grey.shape[0] - side) // 2, (grey.shape[1] - side) // 2
    square = grey[top : top + side, left : left + side].astype(float)
    window = np.hanning(side)
    power = np.abs(np.fft.fft2((square - square.mean()) * np.outer(window, window))) ** 2
    frequency = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.fftfreq(side)[None])
    bands = np.geomspace(1 / 64, 1 / 4, 13)
    means = [power[(frequency >= a) & (frequency < b)].mean() for a, b in pairwise(bands)]
    middles = np.sqrt(bands[:-1] * bands[1:])
    return float(-np.polyfit(np.log(middles), np.log(np.maximum(means, 1e-9)), 1)[0])


def _distinctiveness(grey: Grey) -> float:
    """Return how much worse the second-best place of a patch fits than its own, with noise of 2 grey levels."""
    rng = np.random.default_rng(7)
    ratios = []
    margin = _PATCH + _REACH
    for _ in range(40):
        v, u = (int(rng.integers(margin, n - margin)) for n in grey.shape)
        patch = grey[v : v + _PATCH, u : u + _PATCH].astype(np.float32)
        around = grey[v - _REACH : v + _PATCH + _REACH, u - _REACH : u + _PATCH + _REACH].astype(np.float32)
        patch = patch + 2.0 * rng.standard_normal(patch.shape).astype(np.float32)
        score = np.sqrt(np.maximum(cv2.matchTemplate(around, patch, cv2.TM_SQDIFF), 0.0) / patch.size)
        best = float(score[_REACH, _REACH])
        score[_REACH - 3 : _REACH + 4, _REACH - 3 : _REACH + 4] = np.inf
        ratios.append(float(score.min()) / max(best, 1e-6))
    return float(np.median(ratios))


def _sized(grey: Grey, height: int) -> Grey:
    if grey.shape[0] <= height:
        return grey
    return np.asarray(
        cv2.resize(grey, (round(grey.shape[1] * height / grey.shape[0]), height), interpolation=cv2.INTER_AREA)
    )


def simulated(comparison: Comparison) -> list[list[float]]:
    """Return the statistics of a world's pictures."""
    module = importlib.import_module(f"trailmark_sim.worlds.{comparison.world}")
    world = module.build(WorldOptions(sensors=(comparison.sensor,), extra=comparison.options, threads=2))
    rows = []
    for k, (x, y, heading_deg) in enumerate(comparison.poses):
        state = VehicleState(Pose2(x, y, math.radians(heading_deg)), travelled_m=x)
        payload = world.sensors[0].render(k, 1.0 + k, state)
        bgr = payload.bgr if hasattr(payload, "bgr") else payload.pixels
        rows.append(statistics(_sized(np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY), np.uint8), comparison.height)))
    return rows


def photographed(comparison: Comparison, data: Path) -> list[list[float]]:
    """Return the statistics of the photographs."""
    files = [path for pattern in comparison.real for path in sorted(data.glob(pattern))[:12]]
    pictures = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in files]
    return [
        statistics(_sized(np.asarray(picture, np.uint8), comparison.height))
        for picture in pictures
        if picture is not None
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    default = os.environ.get("TRAILMARK_DATA", str(Path(__file__).parents[2] / "shared" / "data"))
    parser.add_argument("--data", type=Path, default=Path(default), help="folder of the real recordings")
    parser.add_argument("--world", choices=[c.world for c in COMPARISONS], help="this world only")
    arguments = parser.parse_args()
    print(f"{'':24}" + "".join(f"{name:>16}" for name in STATISTICS))
    for comparison in COMPARISONS:
        if arguments.world in (None, comparison.world):
            _print_rows(comparison, arguments.data)


def _print_rows(comparison: Comparison, data: Path) -> None:
    ours = np.mean(simulated(comparison), axis=0)
    real = photographed(comparison, data)
    name = f"{comparison.world} {comparison.sensor}"
    if not real:
        print(f"{name:24}" + "".join(f"{value:16.3g}" for value in ours) + "  (no photographs)")
        return
    low, high = np.min(real, axis=0), np.max(real, axis=0)
    within = (ours >= 0.8 * low) & (ours <= 1.25 * high)
    print(f"{name:24}" + "".join(f"{value:15.3g}{' ' if ok else '!'}" for value, ok in zip(ours, within, strict=True)))
    print(
        f"{f'  {len(real)} photographs':24}"
        + "".join(f"{f'{a:.3g}..{b:.3g}':>15} " for a, b in zip(low, high, strict=True))
    )


if __name__ == "__main__":
    main()
