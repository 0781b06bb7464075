"""A robot driven in real time by what its cameras say: is it ready in time, and does it drive as well as without haste?

A floor camera at 70 Hz (`ground_vo`, in the main loop) and an omnidirectional camera at 15 Hz (`omni_surf`, in a thread
of its own), fused, lead a simulated robot along a taught way through the supermarket to its end. The simulator renders
every picture in the same process, within the same deadlines. A deadline is the next frame of the same sensor.

    python benchmarks/real_time_loop.py [--seeds 3] [--out docs/results/real-time-loop.md]

The same drives in step pace, where nothing can be late, stand beside.
"""

from __future__ import annotations

import argparse
import math
import os
import platform
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from remembered import MARKET

import trailmark
from trailmark import Pipeline
from trailmark.clock import SystemClock
from trailmark.geometry import Trajectory
from trailmark.pipeline.outputs.provenance import cpu_model

RATES_HZ = {"floor": 70.0, "omni": 15.0}
TEACH_HZ = {"floor": 30.0, "omni": 4.0}
TEACH_S = 27.0
LIMIT_S = 90.0
LOCALIZERS = {
    "floor": {"plugin": "ground_vo", "camera": "floor"},
    "omni": {"plugin": "omni_surf", "camera": "omni", "async": True},
}
#: As `trailmark evaluate ... --noise` measured them in this world.
KALMAN = {
    "plugin": "kalman",
    "sources": {"omni": {"floor_m": 0.02, "floor_deg": 0.3}},
}


@dataclass(frozen=True)
class Drive:
    """What a drive to the goal was like."""

    arrived: str
    took_s: float
    end_off_mm: float
    mean_off_mm: float
    largest_off_mm: float
    late_ms: Mapping[str, np.ndarray]
    stages: Mapping[str, Mapping[str, float]]
    counters: Mapping[str, int]
    processor: float


def taught(store: Path) -> np.ndarray:
    """Teach the way; return the true poses, (N, 3)."""
    source = {**MARKET, "sensors": list(TEACH_HZ), "rates_hz": TEACH_HZ, "duration_s": TEACH_S}
    written = {
        "sources": {"robot": source},
        "localizers": LOCALIZERS,
        "estimator": KALMAN,
        "path_store": {"plugin": "sqlite", "spacing_m": 0.05},
        "start": [1.0, 2.0, 0.0],
        "seed": 1,
    }
    with Pipeline(written, store=store, mode="teach") as pipeline:
        for _ in pipeline:
            pass
    assert pipeline.result is not None
    return _truth(pipeline.result.ground_truth).poses


def driven(store: Path, way: np.ndarray, pace: str, seed: int) -> Drive:
    """Drive along the taught way to its end."""
    source = MARKET | {"sensors": list(RATES_HZ), "rates_hz": RATES_HZ, "driver": "commands", "duration_s": LIMIT_S}
    written: dict[str, Any] = {
        "mode": "replay",
        "sources": {"robot": source},
        "localizers": LOCALIZERS,
        "estimator": KALMAN,
        "controller": {"plugin": "goal_seeking", "goal": way[-1, :2].tolist(), "drive": "holonomic", "speed_mps": 0.5},
        "control_hz": 20.0,
        "start": "first",
        "seed": seed,
        "pace": pace,
    }
    clock = SystemClock()
    with Pipeline(written, store=store, mode="replay", clock=clock) as pipeline:
        began_s, cpu_s = time.perf_counter(), time.process_time()
        ready = [(step.frame.sensor, step.frame.stamp_s, clock.now_s()) for step in pipeline if step.frame is not None]
        processor = (time.process_time() - cpu_s) / (time.perf_counter() - began_s)
    result = pipeline.result
    assert result is not None
    offset_s = ready[0][2] - ready[0][1]  # the first frame is on time
    late_ms = {
        name: 1e3 * np.array([now_s - stamp_s - offset_s for sensor, stamp_s, now_s in ready if sensor == name])
        for name in RATES_HZ
    }
    truth = _truth(result.ground_truth)
    off_mm = 1e3 * _off_way(truth.poses, way)
    return Drive(
        result.reason or result.status,
        ready[-1][1] - ready[0][1],
        1e3 * math.dist(truth.poses[-1, :2], way[-1, :2]),
        float(off_mm.mean()),
        float(off_mm.max()),
        late_ms,
        result.timing["stages"],
        result.counters,
        processor,
    )


def _truth(found: Trajectory | None) -> Trajectory:
    assert found is not None
    return found


def _off_way(poses: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Return the distance of each pose from the way, as a line through its points [m]."""
    a, b = way[:-1, None, :2], way[1:, None, :2]
    along = b - a
    length2 = np.maximum((along**2).sum(2), 1e-12)
    share = np.clip(((poses[None, :, :2] - a) * along).sum(2) / length2, 0.0, 1.0)
    return np.linalg.norm(poses[None, :, :2] - a - share[..., None] * along, axis=2).min(0)


def page(paces: Mapping[str, list[Drive]], command: str, load: float) -> str:
    """Return the results as a page."""
    lines = [
        "# Closed loop in real time",
        "",
        f"`{command}`, {time.strftime('%Y-%m-%d')}, trailmark {trailmark.__version__}, Python "
        f"{platform.python_version()}, {os.cpu_count()} x {cpu_model()}. Load of the machine before: {load:.1f}.",
        "",
        " ".join(str(__doc__).split("\n\n")[1].split()),
        "",
        "| pace | seed | end of the run | took [s] | off the end [mm] | off the way, mean [mm] | largest [mm] "
        "| processor [%] |",
        "|---|--:|---|--:|--:|--:|--:|--:|",
    ]
    for pace, drives in paces.items():
        for seed, one in enumerate(drives):
            lines.append(
                f"| {pace} | {seed} | {one.arrived} | {one.took_s:.1f} | {one.end_off_mm:.0f} | {one.mean_off_mm:.1f} "
                f"| {one.largest_off_mm:.1f} | {100 * one.processor:.0f} |"
            )
    lines += [
        "",
        "In real time, from the stamp of a frame to the belief and the command after it:",
        "",
        "| sensor | frames | deadline [ms] | met [%] | p50 [ms] | p99 [ms] | max [ms] |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    for name, rate_hz in RATES_HZ.items():
        late_ms = np.concatenate([one.late_ms[name] for one in paces["realtime"]])
        p50, p99 = np.percentile(late_ms, [50, 99])
        met = 100 * np.mean(late_ms <= 1e3 / rate_hz)
        lines.append(
            f"| {name} | {len(late_ms)} | {1e3 / rate_hz:.1f} | {met:.1f} | {p50:.1f} | {p99:.1f} "
            f"| {late_ms.max():.1f} |"
        )
    lines += [
        "",
        "Time of each part, seed 0 (of `source.robot`: rendering):",
        "",
        "| part | calls | p50 [ms] | p99 [ms] | max [ms] | share of one processor [%] |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    first = paces["realtime"][0]
    for name, row in ((name, row) for name, row in first.stages.items() if not name.startswith("start.")):
        share = 100 * row["n"] * row["mean_ms"] / 1e3 / first.took_s
        lines.append(
            f"| {name} | {row['n']} | {row['p50_ms']:.2f} | {row['p99_ms']:.2f} | {row['max_ms']:.1f} | {share:.1f} |"
        )
    counted = sorted({key for one in paces["realtime"] for key in one.counters if _is_loss(key)})
    told = ", ".join(f"`{key}` {sum(one.counters.get(key, 0) for one in paces['realtime'])}" for key in counted)
    return "\n".join([*lines, "", f"Counted in real time, all seeds: {told or 'nothing lost'}.", ""])


def _is_loss(counter: str) -> bool:
    return counter.endswith((".given_up", ".dropped", ".disabled", ".overwritten", ".collisions"))


def main() -> None:
    """Teach, drive, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder) / "market.trail"
        way = taught(store)
        load = os.getloadavg()[0]
        paces = {
            pace: [driven(store, way, pace, seed) for seed in range(options.seeds)] for pace in ("step", "realtime")
        }
    text = page(paces, f"python benchmarks/real_time_loop.py --seeds {options.seeds}", load)
    print(text)
    if options.out:
        options.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
