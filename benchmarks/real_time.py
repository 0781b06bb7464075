"""All four methods on one robot in real time: who is ready when, and what happens when they are too slow.

A floor camera at 70 Hz, an omnidirectional camera at 15 Hz, a laser at 15 Hz, a forward camera at 20 Hz, a depth
camera at 10 Hz and wheel odometry at 50 Hz drive a taught way through the supermarket. Frames are rendered before, kept
in memory, and held to their stamps (``pace: realtime``). `ground_vo` works in the main loop; the others have
threads of their own. A deadline is the next frame of the same sensor.

    python benchmarks/real_time.py [--seconds 20] [--out docs/results/real-time.md]

The second run is an overload: the slow localizers sleep for three periods of their sensor at every frame.
"""

from __future__ import annotations

import argparse
import os
import platform
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from remembered import MARKET, keep

import trailmark
from trailmark import Pipeline
from trailmark.clock import SystemClock
from trailmark.pipeline.outputs.provenance import cpu_model
from trailmark.plugins import Plugins

RATES_HZ = {"floor": 70.0, "omni": 15.0, "laser": 15.0, "front": 20.0, "rgbd": 10.0, "wheels": 50.0}
TEACH_HZ = {"floor": 30.0, "omni": 4.0, "laser": 4.0, "front": 8.0, "rgbd": 4.0, "wheels": 40.0}
SENSOR_OF = {
    "wheels": "wheels",
    "floor": "floor",
    "floor_map": "floor",
    "omni": "omni",
    "laser": "laser",
    "kinect": "rgbd",
    "streams": "front",
}
SLOW = ("floor_map", "omni", "laser", "kinect", "streams")
TEACH_S = 27.0


@dataclass
class Calls:
    """The calls of one localizer: when the frame was due, when the work began and ended, and the processor time [s]."""

    due_s: list[float] = field(default_factory=list)
    began_s: list[float] = field(default_factory=list)
    ended_s: list[float] = field(default_factory=list)
    cpu_s: list[float] = field(default_factory=list)

    def late_s(self, offset_s: float) -> np.ndarray:
        """Return how long after its frame each answer was there."""
        return np.array(self.ended_s) - np.array(self.due_s) - offset_s


def localizers(is_async: bool) -> dict[str, dict[str, Any]]:
    """Return the localizers; those that are slow in threads of their own."""
    found: dict[str, dict[str, Any]] = {
        "wheels": {"plugin": "odometry"},
        "floor": {"plugin": "ground_vo", "camera": "floor"},
        "floor_map": {"plugin": "ground_map", "camera": "floor"},
        "omni": {"plugin": "omni_surf", "camera": "omni"},
        "laser": {"plugin": "laser_icp", "laser": "laser"},
        "kinect": {"plugin": "kinect_landmarks", "camera": "rgbd", "solve": "plane"},
        "streams": {"plugin": "divs", "camera": "front"},
    }
    return {name: keys | ({"async": True} if is_async and name in SLOW else {}) for name, keys in found.items()}


def config(mode: str, source: dict[str, Any], is_async: bool) -> dict[str, Any]:
    """Return a run config."""
    return {
        "mode": mode,
        "sources": {"robot": source},
        "localizers": localizers(is_async),
        "estimator": {"plugin": "kalman", **({"use": ["wheels", "floor"]} if mode == "teach" else {})},
        "path_store": {"plugin": "sqlite", "spacing_m": 0.05},
        "start": "first" if mode == "replay" else [1.0, 2.0, 0.0],
        "seed": 1,
    }


def taught(folder: Path) -> Path:
    """Teach the way, unless that is done; return the store."""
    store = folder / "market.trail"
    if not store.exists():
        source = {**MARKET, "sensors": list(TEACH_HZ), "rates_hz": TEACH_HZ, "duration_s": TEACH_S}
        with Pipeline(config("teach", source, False) | {"pace": "step"}, store=store, mode="teach") as pipeline:
            for _ in pipeline:
                pass
    return store


@contextmanager
def watched(pipeline: Pipeline, plugins: Plugins, sleep_periods: float) -> Iterator[dict[str, Calls]]:
    """Note every call of every localizer; let the slow ones sleep besides."""
    calls: dict[str, Calls] = defaultdict(Calls)
    kept = []
    for name, keys in localizers(True).items():
        cls = plugins.registry.find("localizer", keys["plugin"]).load()
        kept.append((cls, cls.observe))
        cls.observe = _watching(cls.observe, calls[name], sleep_periods / RATES_HZ[SENSOR_OF[name]] * (name in SLOW))
    try:
        yield calls
    finally:
        for cls, observe in kept:
            cls.observe = observe


def _watching(observe: Any, calls: Calls, sleep_s: float) -> Any:
    clock = SystemClock()

    def watch(self: Any, frame: Any, belief: Any) -> Any:
        began_s, cpu_s = clock.now_s(), time.thread_time()
        answer = observe(self, frame, belief)
        if sleep_s:
            time.sleep(sleep_s)
        calls.due_s.append(frame.stamp_s)
        calls.began_s.append(began_s)
        calls.ended_s.append(clock.now_s())
        calls.cpu_s.append(time.thread_time() - cpu_s)
        return answer

    return watch


def drive(store: Path, plugins: Plugins, seconds: float, sleep_periods: float) -> list[str]:
    """Play the frames in real time; return the lines of a table, and what else is to be told."""
    source = {"plugin": "remembered", "duration_s": seconds}
    written = config("replay", source, True) | {"pace": "realtime"}
    clock, ready, stamps = SystemClock(), [], []
    with Pipeline(written, store=store, mode="replay", plugins=plugins, clock=clock) as pipeline:
        with watched(pipeline, plugins, sleep_periods) as calls:
            began_s, cpu_s = time.perf_counter(), time.process_time()
            for step in pipeline:
                if step.frame is not None:
                    ready.append(clock.now_s())
                    stamps.append((step.frame.sensor, step.frame.stamp_s))
            took_s, used_s = time.perf_counter() - began_s, time.process_time() - cpu_s
        counters = dict(pipeline.counters)
    offset_s = ready[0] - stamps[0][1]  # the first frame is on time
    lines = [
        "| localizer | frames of its sensor | worked on | overwritten | deadline [ms] | met [%] | p50 [ms] | p99 [ms] "
        "| max [ms] | processor [%] |",
        "|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for name, one in calls.items():
        late_ms = 1e3 * one.late_s(offset_s)
        deadline_ms = 1e3 / RATES_HZ[SENSOR_OF[name]]
        n_frames = sum(sensor == SENSOR_OF[name] for sensor, _ in stamps)
        p50, p99 = np.percentile(late_ms, [50, 99])
        lines.append(
            f"| {name} | {n_frames} | {len(late_ms)} | {counters.get(f'localizer.{name}.overwritten', 0)} "
            f"| {deadline_ms:.1f} | {100 * np.mean(late_ms <= deadline_ms):.1f} | {p50:.1f} | {p99:.1f} "
            f"| {late_ms.max():.1f} | {100 * sum(one.cpu_s) / took_s:.1f} |"
        )
    behind_ms = 1e3 * (np.array(ready) - np.array([stamp_s for _, stamp_s in stamps]) - offset_s)
    p50, p99 = np.percentile(behind_ms, [50, 99])
    lines += [
        "",
        f"The belief after a frame: p50 {p50:.1f} ms, p99 {p99:.1f} ms, at most {behind_ms.max():.1f} ms after its "
        f"stamp; within 14.3 ms for {100 * np.mean(behind_ms <= 1e3 / 70):.1f} % of {len(behind_ms)} frames. "
        f"{took_s:.1f} s, {100 * used_s / took_s:.0f} % of one processor.",
    ]
    lost = {key: n for key, n in counters.items() if key.endswith((".given_up", ".dropped", ".disabled"))}
    lines += ["", "Counted besides: " + (", ".join(f"`{key}` {n}" for key, n in lost.items()) or "nothing") + "."]
    return lines


def main() -> None:
    """Render, play twice, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--data", type=Path, help="folder that keeps the taught store")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    folder = options.data or Path(tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    store = taught(folder)
    source = {**MARKET, "sensors": list(RATES_HZ), "rates_hz": RATES_HZ, "duration_s": options.seconds}
    kept, plugins = keep(config("track", source, False))
    print(f"{len(kept.frames)} frames rendered", flush=True)
    drive(store, plugins, 1.0, 0.0)  # compiles and loads
    load = os.getloadavg()[0]
    loads = [f"{load:.1f}"]
    normal = drive(store, plugins, options.seconds, 0.0)
    loads.append(f"{os.getloadavg()[0]:.1f}")
    overload = drive(store, plugins, options.seconds, 3.0)
    loads.append(f"{os.getloadavg()[0]:.1f}")
    text = "\n".join(
        [
            "# Real time",
            "",
            f"`python benchmarks/real_time.py --seconds {options.seconds:g}`, {time.strftime('%Y-%m-%d')}, "
            f"trailmark {trailmark.__version__}, Python {platform.python_version()}, {os.cpu_count()} x {cpu_model()}. "
            f"Load of the machine before, between and after the runs: {', '.join(loads)}.",
            "",
            " ".join(str(__doc__).split("\n\n")[1].split()),
            "Latency is from the stamp of a frame to the end of the call, waiting included.",
            "",
            *("## As fast as they are", "", *normal, ""),
            *("## Overload", "", "Every call of a slow localizer takes three periods of its sensor longer.", ""),
            *overload,
            "",
        ]
    )
    print(text)
    if options.out:
        options.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
