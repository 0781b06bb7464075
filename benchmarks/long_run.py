"""Hours of a fused robot in accelerated time: does memory grow, do stamps go on, does the pace drift?

Wheel odometry, floor camera (`ground_vo`, `ground_map`), omnidirectional camera and laser drive a taught way through
the supermarket forth and back, from frames that are rendered once.

    python benchmarks/long_run.py --hours 6 [--out docs/results/long-run.md]

Memory is what the process holds (resident set), sampled every simulated minute: of the run alone, with the frames that
it plays. A process of its own has taught the way and rendered them.
"""

from __future__ import annotations

import argparse
import math
import os
import pickle
import platform
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from sys import modules
from typing import Any

import cv2
import numpy as np
import remembered
from real_time import config, taught
from remembered import MARKET, Kept, keep

import trailmark
from trailmark import Pipeline
from trailmark.pipeline.outputs.provenance import cpu_model
from trailmark.plugins import Plugins, load_plugins

RATES_HZ = {"floor": 30.0, "omni": 2.0, "laser": 4.0, "wheels": 40.0}
USED = ("wheels", "floor", "floor_map", "omni", "laser")
WARM_S = 600.0


def resident_mb() -> float:
    """Return what the process holds now."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """What was seen each minute [s, MB, s a frame, m since a fix], and what was counted."""

    rows: np.ndarray
    last_s: float
    n_back: int
    n_lost: int
    counters: dict[str, int]
    frames_mb: float


def main() -> None:
    """Drive and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=6.0, help="simulated")
    parser.add_argument("--until", type=float, default=math.inf, help="stop after so many seconds of this machine")
    parser.add_argument("--data", type=Path, help="folder that keeps the taught way, for the next time")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        text = page(drive(options.data or Path(temporary), options.hours, options.until), options.hours)
    print(text)
    if options.out:
        options.out.write_text(text, encoding="utf-8")


def drive(folder: Path, hours: float, until_s: float) -> Drive:
    """Drive for so many simulated hours, or seconds of this machine, and return what was seen every minute."""
    cv2.setNumThreads(1)
    folder.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(1, get_context("spawn")) as simulator:
        store, file = simulator.submit(render_drive, folder).result()
    plugins, frames_mb = read_frames(file)
    written = _with_used(config("replay", {"plugin": "remembered", "duration_s": 3600.0 * hours}, False))
    rows, last_s, n_back, n_lost = [], -math.inf, 0, 0
    began_s = time.perf_counter()
    with Pipeline(written | {"pace": "step"}, store=store, mode="replay", plugins=plugins) as pipeline:
        next_s, cpu_s, n_steps = 0.0, time.process_time(), 0
        for step in pipeline:
            n_back += step.stamp_s < last_s
            n_lost += step.belief.pose_map_base is None
            last_s, n_steps = step.stamp_s, n_steps + 1
            if step.stamp_s >= next_s:
                now_s = time.process_time()
                rows.append((step.stamp_s, resident_mb(), (now_s - cpu_s) / max(1, n_steps), step.belief.fix_age_m))
                cpu_s, n_steps = now_s, 0
                next_s = step.stamp_s + 60.0
                if len(rows) % 10 == 1:
                    print(f"{step.stamp_s / 60:.0f} min: {rows[-1][1]:.1f} MB, {1e3 * rows[-1][2]:.2f} ms", flush=True)
                if time.perf_counter() - began_s > until_s:
                    break
        counters = dict(pipeline.counters)
    return Drive(np.array(rows), last_s, n_back, n_lost, counters, frames_mb)


def render_drive(folder: Path) -> tuple[Path, Path]:
    """Teach the way and drive it again; return the store, and a file of what the sensors gave."""
    store, file = taught(folder), folder / "frames.pickle"
    source = {**MARKET, "sensors": list(RATES_HZ), "rates_hz": RATES_HZ, "duration_s": 20.0}
    kept, _ = keep(_with_used(config("track", source, False)))
    file.write_bytes(pickle.dumps(kept))
    return store, file


def read_frames(file: Path) -> tuple[Plugins, float]:
    """Return plugins of which one plays the frames of a file, and how much the frames hold [MB]."""
    plugins = load_plugins(files=[remembered.__file__])
    before_mb = resident_mb()
    with file.open("rb") as opened:
        kept: Kept = pickle.load(opened)
    file.unlink()
    modules["trailmark_file_remembered"].KEPT.append(kept)
    return plugins, resident_mb() - before_mb


def _with_used(written: dict[str, Any]) -> dict[str, Any]:
    return written | {"localizers": {name: written["localizers"][name] for name in USED}}


def page(drive: Drive, hours: float) -> str:
    """Return the results as a page."""
    rows, last_s, counters = drive.rows, drive.last_s, drive.counters
    paragraphs = [" ".join(paragraph.split()) for paragraph in str(__doc__).split("\n\n")]
    warm = rows[rows[:, 0] >= min(WARM_S, 0.5 * last_s)]
    growth = 100 * (warm[-1, 1] / warm[0, 1] - 1)
    hour_mb = (warm[-1, 1] - warm[0, 1]) / max(1e-9, warm[-1, 0] - warm[0, 0]) * 3600
    half = len(warm) // 2
    early, late = 1e3 * np.median(warm[: max(1, half), 2]), 1e3 * np.median(warm[half:, 2])
    asked = f"of the {hours:g} h asked for, " if last_s < 3590 * hours else ""
    bad = {key: n for key, n in counters.items() if key.endswith(("disabled", "dropped", "skipped", "repeated"))}
    picked = warm[:: max(1, len(warm) // 12)]
    return "\n".join(
        [
            "# A long run",
            "",
            f"`python benchmarks/long_run.py --hours {hours:g}`, {time.strftime('%Y-%m-%d')}, "
            f"trailmark {trailmark.__version__}, Python {platform.python_version()}, {os.cpu_count()} x {cpu_model()}.",
            "",
            f"{paragraphs[1]} {paragraphs[-1]}",
            "",
            f"**{asked}{last_s / 60:.1f} simulated minutes were driven**, {counters.get('frames', 0)} frames.",
            "",
            f"- Memory from {warm[0, 0] / 60:.0f} min on: {warm[0, 1]:.1f} to {warm[-1, 1]:.1f} MB, {growth:+.2f} % "
            f"({hour_mb:+.1f} MB an hour; bar: less than 1 % after the first 10 minutes). "
            f"Of it {drive.frames_mb:.0f} MB are the frames that are played.",
            f"- Stamps that went back: {drive.n_back}. Steps without a pose: {drive.n_lost}.",
            f"- Processor time of a frame, median of minutes: {early:.3f} ms in the first half, {late:.3f} ms "
            "in the second.",
            "- Counted: "
            + (", ".join(f"`{key}` {n}" for key, n in bad.items()) or "nothing dropped, disabled or skipped"),
            "",
            "| simulated [min] | memory [MB] | processor time of a frame [ms] | way since the last fix [m] |",
            "|--:|--:|--:|--:|",
            *(f"| {s / 60:.0f} | {mb:.1f} | {1e3 * cpu:.3f} | {age:.2f} |" for s, mb, cpu, age in picked),
            "",
        ]
    )


if __name__ == "__main__":
    main()
