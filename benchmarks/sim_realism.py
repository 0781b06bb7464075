"""How much the simulator's pictures are like photographs: the same statistics of both, side by side.

    python benchmarks/sim_realism.py [--data FOLDER] [--world NAME] [--markdown]

Every statistic of a world or a floor should lie between 0.8 of the least and 1.25 of the greatest of the real pictures
named with it; what lies outside is marked. Parameters are fixed by this table and never by what a localizer makes of
them. Pictures of worlds are brought to the size of the smaller side before they are compared; floors are compared with
photographs at full size and reduced to 640 px. Statistics: `trailmark_sim.realism`; SURF: the detector of `omni_surf`.
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.geometry import Pose2
from trailmark_omni_surf.surf.detector import Surf, SurfOptions
from trailmark_sim.ground.floors import FLOORS
from trailmark_sim.ground.ground import Floor
from trailmark_sim.ground.statistics import PHOTOGRAPHS, floor_statistics, photographed_statistics
from trailmark_sim.pictures import read_grey
from trailmark_sim.realism import picture_statistics
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds import build_world
from trailmark_sim.worlds.base import WorldOptions

Grey = npt.NDArray[np.uint8]
Row = dict[str, float]


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
_MOST_PHOTOGRAPHS = 12


def statistics(grey: Grey) -> Row:
    """Return the statistics of a picture, with SURF key points per megapixel."""
    surf = Surf(SurfOptions(n_best=None, upright=True))
    return asdict(picture_statistics(grey)) | {"surf": len(surf(grey).uv) / (grey.size / 1e6)}


def sized(grey: Grey, height: int) -> Grey:
    """Return a picture of at most this height."""
    if grey.shape[0] <= height:
        return grey
    width = round(grey.shape[1] * height / grey.shape[0])
    return np.asarray(cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def simulated(comparison: Comparison) -> list[Row]:
    """Return the statistics of a world's pictures."""
    options = WorldOptions(sensors=(comparison.sensor,), extra=comparison.options, threads=2)
    sensor = build_world(comparison.world, options).sensors[0]
    rows = []
    for k, (x, y, heading_deg) in enumerate(comparison.poses):
        state = VehicleState(Pose2(x, y, math.radians(heading_deg)), travelled_m=x)
        payload: Any = sensor.render(k, 1.0 + k, state)
        bgr = payload.bgr if hasattr(payload, "bgr") else payload.pixels
        grey = np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY), np.uint8)
        rows.append(statistics(sized(grey, comparison.height)))
    return rows


def photographed(comparison: Comparison, data: Path) -> list[Row]:
    """Return the statistics of the photographs."""
    files = [path for pattern in comparison.real for path in sorted(data.glob(pattern))[:_MOST_PHOTOGRAPHS]]
    return [statistics(sized(read_grey(path), comparison.height)) for path in files]


def compared_worlds(data: Path, only: str | None) -> list[tuple[str, list[Row], list[Row]]]:
    """Return name, simulated and real statistics of each world."""
    chosen = [one for one in COMPARISONS if only in (None, one.world)]
    return [(f"{one.world} {one.sensor}", simulated(one), photographed(one, data)) for one in chosen]


def compared_floors(data: Path, only: str | None) -> list[tuple[str, list[Row], list[Row]]]:
    """Return name, simulated and real statistics of each floor; of some there is no photograph."""
    rows = []
    for floor in sorted(FLOORS):
        if only in (None, "floors", floor):
            has_photographs = floor in PHOTOGRAPHS and (data / "ground").is_dir()
            real = photographed_statistics(floor, data / "ground") if has_photographs else []
            rows.append((floor, [asdict(floor_statistics(Floor(floor)))], [asdict(one) for one in real]))
    return rows


def cells(ours: Sequence[Row], real: Sequence[Row]) -> tuple[list[str], list[str]]:
    """Return a row of means, what lies outside marked with `!`, and a row of the real spans."""
    means, spans = [], []
    for key in ours[0]:
        mean = float(np.mean([row[key] for row in ours]))
        least, most = (pick((row[key] for row in real), default=math.nan) for pick in (min, max))
        is_outside = bool(real) and not 0.8 * least <= mean <= 1.25 * most
        means.append(f"{mean:.3g}" if mean < 1e3 else f"{mean:.0f}")
        means[-1] += "!" if is_outside else ""
        spans.append(" to ".join(f"{edge:.3g}" if edge < 1e3 else f"{edge:.0f}" for edge in (least, most)))
    return means, spans if real else [""] * len(means)


def show(title: str, compared: Sequence[tuple[str, list[Row], list[Row]]], markdown: bool) -> None:
    """Print a table."""
    if not compared:
        return
    keys = list(compared[0][1][0])
    rows = [[title, *keys]]
    for name, ours, real in compared:
        means, spans = cells(ours, real)
        counted = f"{len(real)} photographs" if real else "no photograph of its kind"
        rows += [[name, *means], [counted, *spans]]
    if markdown:
        rows.insert(1, ["---"] * len(rows[0]))
        print("\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n")
        return
    print("\n".join("".join(f"{cell:<{26 if n == 0 else 16}}" for n, cell in enumerate(row)) for row in rows) + "\n")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    default = os.environ.get("TRAILMARK_DATA", str(Path(__file__).parents[2] / "shared" / "data"))
    parser.add_argument("--data", type=Path, default=Path(default), help="folder of the real recordings")
    parser.add_argument("--world", choices=[*(c.world for c in COMPARISONS), "floors", *FLOORS], help="this one only")
    parser.add_argument("--markdown", action="store_true", help="print the tables of the README")
    given = parser.parse_args()
    show("world, sensor", compared_worlds(given.data, given.world), given.markdown)
    show("floor", compared_floors(given.data, given.world), given.markdown)


if __name__ == "__main__":
    main()
