"""Pictures of the faults on the photograph of a floor, and what each of them costs a picture.

python benchmarks/faults.py sheet [--photo ground/pavers.jpg] [--out docs/assets/faults.jpg]
python benchmarks/faults.py costs [--n 50]
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from time import thread_time_ns
from typing import Any

import cv2
import numpy as np

from trailmark.frames import RGBD, Frame, Image, Payload, Scan, SensorInfo, payload_kind
from trailmark.interfaces import Fault, Session
from trailmark.pipeline.lifecycle import part_rng
from trailmark.pipeline.sources.perturbing import Perturber
from trailmark.plugins import load_plugins

REGISTRY = load_plugins().registry

#: What the sheet shows: a caption, the fault, its keys, and when the picture is taken [s].
SHEET: tuple[tuple[str, str, dict[str, Any], float], ...] = (
    ("as it is", "basic", {}, 0.0),
    ("lens_marks 1 %", "lens_marks", {}, 0.0),
    ("lens_marks drops 8 %", "lens_marks", {"kinds": ["drops"], "share": 0.08, "size": 0.15}, 0.0),
    ("glints", "glints", {}, 0.0),
    ("glints anywhere 3 %", "glints", {"ring": None, "n": 20, "share": 0.03}, 0.0),
    ("vignette", "vignette", {}, 0.0),
    ("cover, contrast 15", "cover", {"contrast": 15.0, "level": 60.0}, 0.0),
    ("wandering_shadow", "wandering_shadow", {"angle_deg": 20.0}, 0.7),
    ("mains, bands", "mains", {"readout_ms": 25.0}, 0.0),
    ("over_exposure", "over_exposure", {}, 4.5),
    ("wet_patch", "wet_patch", {}, 0.7),
    ("low_light", "low_light", {}, 0.0),
    ("motion_blur", "motion_blur", {"angle_deg": 30.0}, 0.0),
    ("specks", "specks", {}, 0.0),
    ("noise: 12", "basic", {"noise": 12.0}, 0.0),
    ("blur_px: 2", "basic", {"blur_px": 2.0}, 0.0),
    ("exposure: 1.5", "basic", {"exposure": 1.5}, 0.0),
    ("speckle: 0.02", "basic", {"speckle": 0.02}, 0.0),
    ("occluders", "basic", {"occluders": {"n": 2, "size": 0.3}}, 0.5),
    ("vignette + lens_marks", "", {"vignette": {}, "lens_marks": {"share": 0.05}}, 0.0),
)
_SIZE = (320, 240)
_COLUMNS = 5
_CAPTION_PX = 22


def main() -> None:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("sheet", "costs"))
    parser.add_argument("--photo", default="ground/pavers.jpg", help="a file, or one of TRAILMARK_DATA")
    parser.add_argument("--out", type=Path, default=Path("docs/assets/faults.jpg"))
    parser.add_argument("--n", type=int, default=50, help="pictures of each fault")
    arguments = parser.parse_args()
    photo = read_photo(arguments.photo)
    if arguments.what == "sheet":
        write_sheet(photo, arguments.out)
    else:
        print_costs(photo, arguments.n)


def read_photo(name: str) -> Any:
    """Return a photograph as a ground camera would see it, (240, 320) uint8."""
    path = Path(name) if Path(name).is_file() else Path(os.environ.get("TRAILMARK_DATA", "")) / name
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise SystemExit(f"no photograph {name}: give --photo, or set TRAILMARK_DATA")
    scale = 1.5 * _SIZE[0] / picture.shape[1]
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(small[: _SIZE[1], : _SIZE[0]])


def faults_of(wanted: Mapping[str, Mapping[str, Any]]) -> Perturber:
    """Return faults by name and keys, as a source would have them."""
    makers = {}
    for name, keys in wanted.items():
        spec = REGISTRY.find("fault", name)
        makers[name] = partial(spec.construct, spec.load_config().model_validate(keys))
    return Perturber("robot", makers, None)


def write_sheet(photo: Any, out: Path) -> None:
    """Write one picture of each fault, with captions, as a JPEG."""
    tiles = []
    for caption, fault, keys, at_s in SHEET:
        perturber = faults_of({fault: keys} if fault else keys)
        perturber.start(Session(rng=part_rng(3, "source", "robot")), {"floor": SensorInfo("floor", "image")})
        frames = [Frame("floor", 0.0, Image(photo)), Frame("floor", at_s or 1e-3, Image(photo))]
        *_, last = perturber.frames(iter(frames))
        tile = np.full((_SIZE[1] + _CAPTION_PX, _SIZE[0] + 4), 255, np.uint8)
        tile[: _SIZE[1], : _SIZE[0]] = last.payload.pixels
        cv2.putText(tile, caption, (2, _SIZE[1] + 16), cv2.FONT_HERSHEY_SIMPLEX, 0.5, 0, 1, cv2.LINE_AA)
        tiles.append(tile)
    rows = [np.hstack(tiles[i : i + _COLUMNS]) for i in range(0, len(tiles), _COLUMNS)]
    sheet = cv2.resize(np.vstack(rows), None, fx=0.75, fy=0.75, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(out), sheet, [cv2.IMWRITE_JPEG_QUALITY, 75])
    print(f"{out}: {sheet.shape[1]}x{sheet.shape[0]} px, {out.stat().st_size / 1e3:.0f} kB")


def print_costs(photo: Any, n: int) -> None:
    """Print what each fault costs: a grey picture of 320x240 and 640x480, colour with depth, a scan."""
    colour = cv2.cvtColor(cv2.resize(photo, (640, 480)), cv2.COLOR_GRAY2BGR)
    payloads: dict[str, Payload] = {
        "grey 320x240": Image(photo),
        "grey 640x480": Image(cv2.resize(photo, (640, 480))),
        "rgbd 640x480": RGBD(colour, np.full((480, 640), 2.0, np.float32)),
        "scan 720": Scan(np.full(720, 5.0), -np.pi, 2 * np.pi / 720),
    }
    print(f"| fault | {' | '.join(f'{name} [ms]' for name in payloads)} |")
    print(f"|---|{'---|' * len(payloads)}")
    cv2.setNumThreads(1)
    keys_of = {"basic": {"noise": 8.0, "blur_px": 1.0, "occluders": {}, "speckle": 0.01, "range_noise_m": 0.01}}
    for spec in REGISTRY.specs("fault"):
        config = spec.load_config().model_validate(keys_of.get(spec.name, {}))
        cells = []
        for payload in payloads.values():
            fault: Fault = spec.construct(config)
            fits = not fault.kinds or payload_kind(payload) in fault.kinds
            cells.append(f"{median_ms(fault, payload, n):.2f}" if fits else "")
        print(f"| `{spec.name}` | {' | '.join(cells)} |")


def median_ms(fault: Fault, payload: Payload, n: int) -> float:
    """Return the median time of a core for one frame, generator included but for the first one [ms]."""
    fault.start(Session(sensors={"one": SensorInfo("one", payload_kind(payload))}))
    times = []
    for i in range(n + 1):
        began_ns = thread_time_ns()
        rng = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(i,)))
        fault.apply(Frame("one", 0.03 * i, payload), rng, 0.03 * i)
        times.append(thread_time_ns() - began_ns)
    return float(np.median(times[1:])) / 1e6


if __name__ == "__main__":
    main()
