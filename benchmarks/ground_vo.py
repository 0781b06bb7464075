"""Speed of the downward camera's localizers, beside the paper's figures (Nagai & Watanabe 2015, Sec. IV-E).

Thread CPU time of one core, median over at least 500 frames of 512 x 480 (``--quick``: 120), kernels compiled and
warm. Frames are rendered beforehand. The paper's machine was a laptop of 2011 (Core i5-2410M), its code C.

    python benchmarks/ground_vo.py [--quick] [--json]

* kernels: both groups of 768 pixels, 17 x 17 shifts, 11 turns; the patch of 44 x 44, 65 x 65 shifts, 31 turns, four
  groups. Each is first compared with the equation in plain numpy, bit by bit.
* step: everything from the frame to the estimate, in each mode, Python included; median and 99th percentile.
* absolute search: from the frame to the `Fix`, exhaustive and in a pyramid.
* start: CPU time of a process of its own, with an empty cache of kernels and with a full one, imports excluded.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.estimates import Belief
from trailmark.experiments import Row
from trailmark.frames import Frame, Image
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, Session
from trailmark.testing.ground import GroundCamera, GroundRun, MirroredFloor, ground_run, straight
from trailmark_ground_vo.absolute import group_places, patch_search, patch_search_plain, quadrants
from trailmark_ground_vo.config import GroundMapConfig, GroundVOConfig
from trailmark_ground_vo.filters import transpose
from trailmark_ground_vo.levels import half_picture, levelled, seven_bits
from trailmark_ground_vo.localizer import GroundVO
from trailmark_ground_vo.motion import ImageMotion
from trailmark_ground_vo.patch import PatchFinder
from trailmark_ground_vo.search import places, reach, rotation_angles, sad_search, sad_search_plain

SIZE, SHIFT_PX, STEP_RAD = (512, 480), 8, 1 / 128
CENTRES = ((255.5, 335.5), (255.5, 143.5))
Grey = npt.NDArray[np.uint8]


def wood() -> MirroredFloor:
    """Return the photographed wood floor, or a procedural floor where there is none."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    file = Path(os.environ.get("TRAILMARK_DATA", beside)) / "ground" / "wood_floor.jpg"
    if file.is_file():
        return MirroredFloor(np.asarray(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), np.uint8))
    return MirroredFloor.procedural(1, grain_px=1.5)


def drive(n_frames: int, vignette: float = 0.3) -> tuple[GroundRun, list[Frame]]:
    """Return a straight drive at the paper's speed, rendered: pictures repeat after 150, there and back."""
    camera = GroundCamera(SIZE, noise_sigma=3.0, vignette=vignette)
    motion = straight(0.26, sway_m=0.003, shake_rad=math.radians(0.05))
    run = ground_run(motion, min(n_frames, 150), ground=wood(), camera=camera)
    rendered = [frame.payload for frame in run.frames]
    order = [*range(len(rendered)), *range(len(rendered) - 2, 0, -1)]
    frames = [Frame("floor", index / 70.0, rendered[order[index % len(order)]]) for index in range(n_frames)]
    return run, frames


def timed(call: Callable[[], object], n: int) -> npt.NDArray[np.float64]:
    """Return the thread CPU time of each of `n` calls, after three that do not count [ms]."""
    times = []
    for _ in range(n + 3):
        began = time.thread_time()
        call()
        times.append(1e3 * (time.thread_time() - began))
    return np.array(times[3:])


def kernel_rows(n: int) -> Iterator[Row]:
    """Yield the times of the two searches, with vectors and plain, after comparing them with numpy."""
    image, image_t, groups = _relative_case()
    angles = rotation_angles(5, STEP_RAD)
    limits = (SHIFT_PX, SIZE[0] - 1 - reach(SHIFT_PX), SHIFT_PX, SIZE[1] - 1 - reach(SHIFT_PX))

    def relative(search: Callable[..., Any]) -> list[Any]:
        turned = [places(x, y, c, (9.0, 0.0), angles, 1.0, limits) for (x, y, _), c in zip(groups, CENTRES)]
        return [search(image, image_t, spots, values) for spots, (_, _, values) in zip(turned, groups)]

    spots = [places(x, y, c, (9.0, 0.0), angles, 1.0, limits) for (x, y, _), c in zip(groups, CENTRES)]
    for errors, where, (_, _, values) in zip(relative(sad_search(SHIFT_PX)), spots, groups):
        assert np.array_equal(errors[[0, 7]], _equation_1(image, where[:, [0, 7]], values, SHIFT_PX))
    yield _row("relative search, exhaustive", timed(lambda: relative(sad_search(SHIFT_PX)), n), 3.5, 0.35, 0.15)
    yield _row("relative search, exhaustive, plain kernel", timed(lambda: relative(sad_search_plain(SHIFT_PX)), n), 3.5)
    bits, bits_t, where, values = _absolute_case()
    search = patch_search(32)
    errors = search(bits, bits_t, where, values)
    for group, turn in ((0, 3), (3, 27)):
        expected = _equation_1(bits, where[:, group, turn : turn + 1], values[group], 32)
        assert np.array_equal(errors[group, turn], expected[0])
    yield _row("absolute search, kernel", timed(lambda: search(bits, bits_t, where, values), n // 5), 196.0, 5.0, 2.7)
    plain = patch_search_plain(32)
    times = timed(lambda: plain(bits, bits_t, where, values), max(3, n // 50))
    yield _row("absolute search, plain kernel", times, 196.0)


def _relative_case() -> tuple[Grey, Grey, list[tuple[Any, Any, Any]]]:
    _, frames = drive(1)
    assert isinstance(frames[0].payload, Image)
    image, rng = np.array(frames[0].payload.pixels), np.random.default_rng(0)
    groups = []
    for _, middle in CENTRES:
        x = np.repeat(np.arange(64.0, 448.0), 2)
        y = rng.uniform(middle - 80.0, middle + 80.0, len(x))
        groups.append((x, y, rng.integers(0, 256, len(x), np.uint8)))
    return image, transpose(image), groups


def _absolute_case() -> tuple[Any, Any, Any, Any]:
    _, frames = drive(1, vignette=0.0)
    assert isinstance(frames[0].payload, Image)
    bits = seven_bits(levelled(half_picture(np.array(frames[0].payload.pixels))), True)
    v, u = np.asarray(np.mgrid[:44, :44] - 21.5, np.float64)
    middle, angles = (130.5, 117.5), rotation_angles(15, STEP_RAD)
    where = group_places(quadrants(u), quadrants(v), middle, angles, 1.0, (32, 222, 32, 206))
    return bits, np.ascontiguousarray(bits.T), where, quadrants(bits[98:142, 106:150])


def _equation_1(image: npt.NDArray[Any], spots: npt.NDArray[np.int64], values: npt.NDArray[Any], shift_px: int) -> Any:
    shifts = range(-shift_px, shift_px + 1)
    wide, grey = image.astype(np.int64), values.astype(np.int64)
    return np.array(
        [[[np.abs(wide[v + j, u + i] - grey).sum() for i in shifts] for j in shifts] for u, v in zip(*spots)]
    )


def step_rows(n: int) -> Iterator[Row]:
    """Yield the times of whole steps in each mode."""
    bars = {"paper": (0.5, 0.25, 1.0), "pyramid": (None, None, None), "refined": (1.2, 0.5, 2.0)}
    for vignette in (0.0, 0.3):
        run, frames = drive(n + 20, vignette)
        light = "even light" if vignette == 0.0 else "flat field"
        for mode, (bar, stretch, slowest) in bars.items():
            localizer = GroundVO(
                GroundVOConfig.model_validate(
                    {"camera": "floor"} | ({"preset": "paper"} if mode == "paper" else {"mode": mode})
                )
            )
            localizer.start(Session(sensors={"floor": run.sensor}))
            times = _observed(localizer, frames)[20:]
            yield _row(f"step, mode {mode}, {light}", times, 3.5, bar, stretch)
            yield _row(f"step, mode {mode}, {light}, p99", np.quantile(times, 0.99), 6.3, slowest)


def _observed(localizer: Localizer, frames: list[Frame]) -> npt.NDArray[np.float64]:
    times = []
    for frame in frames:
        belief = Belief(frame.stamp_s)
        began = time.thread_time()
        said = localizer.observe(frame, belief)
        times.append(1e3 * (time.thread_time() - began))
        assert len(times) == 1 or len(said) == 1
    return np.array(times)


def absolute_rows(n: int) -> Iterator[Row]:
    """Yield the times of absolute searches from the picture to the pose."""
    camera, ground = GroundCamera(SIZE, noise_sigma=3.0), wood()
    first, second = camera.image(ground, Pose2(), 1), camera.image(ground, Pose2(0.004, 0.003, 0.02), 2)
    for search, bar, stretch in (("exhaustive", 8.0, None), ("pyramid", 8.0, 1.0)):
        finder = PatchFinder(GroundMapConfig.model_validate({"camera": "floor", "search": search}), SIZE)
        patch = finder.register(finder.view(first))
        assert not finder.find(finder.view(second), patch, ImageMotion(0.0, 0.0, 0.0)).reason

        def whole(finder: PatchFinder = finder, patch: Grey = patch) -> object:
            return finder.find(finder.view(second), patch, ImageMotion(0.0, 0.0, 0.0))

        times = timed(whole, n // 5)
        yield _row(f"absolute search, picture to pose, {search}", times, 196.0, bar, stretch)
        yield _row(f"absolute search, picture to pose, {search}, p99", np.quantile(times, 0.99), 360.0)
    finder = PatchFinder(GroundMapConfig.model_validate({"camera": "floor"}), SIZE)
    yield _row("registration of a patch", timed(lambda: finder.register(finder.view(first)), n // 5))


_START = """
import time, numba, cv2
from trailmark.frames import GroundPlane, SensorInfo
from trailmark.interfaces import Session
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.localizer import GroundVO
began = time.process_time()
localizer = GroundVO(GroundVOConfig(camera="floor"))
sensor = SensorInfo("floor", "image", (512, 480), 70.0, calibration=GroundPlane((3.9e-4, 3.9e-4)))
localizer.start(Session(sensors={"floor": sensor}))
print(time.process_time() - began)
"""


def start_rows() -> Iterator[Row]:
    """Yield the CPU time of a start with an empty cache of kernels, and with a full one [s]."""
    with tempfile.TemporaryDirectory() as folder:
        for item, bar, stretch in (("start, kernels compiled", 10.0, 6.0), ("start, kernels cached", 1.0, 0.5)):
            environment = os.environ | {"NUMBA_CACHE_DIR": folder}
            done = subprocess.run(
                [sys.executable, "-c", _START], env=environment, capture_output=True, text=True, check=True
            )
            yield replace(_row(item, float(done.stdout), None, bar, stretch), unit="s")


def _row(
    item: str, times: Any, paper: float | None = None, bar: float | None = None, stretch: float | None = None
) -> Row:
    values = np.atleast_1d(np.asarray(times, np.float64))
    return Row("ground_vo speed", item, "ms", float(np.median(values)), paper, bar, stretch, n=len(values))


def measure(is_quick: bool) -> Iterator[Row]:
    """Yield all rows."""
    n = 120 if is_quick else 600
    yield from kernel_rows(n)
    yield from step_rows(n)
    yield from absolute_rows(n)
    yield from start_rows()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="120 frames instead of 600")
    parser.add_argument("--json", action="store_true", help="a list of rows")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    rows = []
    for row in measure(options.quick):
        rows.append(row)
        if not options.json:
            bar = "" if row.bar is None else f"bar {row.bar:g}  {'met' if row.met else 'NOT MET'}"
            ratio = "" if row.paper is None else f"paper {row.paper:g}: {row.paper / (row.ours or 1.0):.1f} x"
            print(f"{row.item:56}{row.ours:9.3f} {row.unit:4}{bar:20}{ratio:20} n={row.n}", flush=True)
    if options.json:
        print(json.dumps([row.document() for row in rows], indent=2))


if __name__ == "__main__":
    main()
