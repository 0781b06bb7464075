"""Sec. IV-E: processing times and memory, measured in processes of their own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from typing import Any

from trailmark.errors import RunError
from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.kit import Table

__all__ = ["time_rows"]

_NAME = "E times, thread CPU time"
_N_FRAMES, _N_QUICK = 1000, 500


def time_rows(options: ExperimentOptions) -> list[Row]:
    """Return the rows of Sec. IV-E; the paper's are of a Core i5-2410M."""
    n_frames = _N_QUICK if options.quick else _N_FRAMES
    times = _measure_times("drive", n_frames, options.seed)
    options.report(f"times: {times['refined']['p50']:.2f} ms a picture, {times['exhaustive']['p50']:.2f} ms a search")
    return [
        *_step_rows("refined", times["refined"], 1.2, 2.0, 0.5),
        *_step_rows("paper", times["paper"], 0.5, 1.0, 0.25),
        *_search_rows("exhaustive", times["exhaustive"], 8.0),
        *_search_rows("pyramid", times["pyramid"], None),
        *_start_rows(options),
        Row("E memory", "peak of the process, simulator included", "MB", times["peak_mb"]),
    ]


def _step_rows(mode: str, found: dict[str, float], p50_ms: float, p99_ms: float, stretch_ms: float) -> Table:
    table = Table(_NAME, int(found["n"]))
    table.add(f"relative search, {mode}, mean", "ms", found["mean"], paper=3.5)
    table.add(f"relative search, {mode}, median", "ms", found["p50"], bar=p50_ms, stretch=stretch_ms)
    table.add(f"relative search, {mode}, p99", "ms", found["p99"], bar=p99_ms)
    table.add(f"relative search, {mode}, max", "ms", found["max"], paper=6.3)
    return table


def _search_rows(kind: str, found: dict[str, float], bar_ms: float | None) -> Table:
    table = Table(_NAME, int(found["n"]))
    table.add(f"absolute search, {kind}, mean", "ms", found["mean"], paper=196)
    table.add(f"absolute search, {kind}, median", "ms", found["p50"], bar=bar_ms, stretch=1.0)
    table.add(f"absolute search, {kind}, max", "ms", found["max"], paper=360)
    return table


def _start_rows(options: ExperimentOptions) -> list[Row]:
    """Return how long both localizers take to start: from the cache, and compiling everything."""
    with tempfile.TemporaryDirectory() as cache:
        again = None if options.quick else cache
        cold_s = None if options.quick else _measure_times("start", 0, options.seed, cache)["start_s"]
        cached_s = _measure_times("start", 0, options.seed, again)["start_s"]
    rows = [Row("E start", "compiled before, after import", "s", cached_s, None, 1.0, 0.5)]
    return rows if cold_s is None else [Row("E start", "compiling, after import", "s", cold_s, None, 10.0, 6.0), *rows]


def _measure_times(what: str, n_frames: int, seed: int, cache: str | None = None) -> dict[str, Any]:
    environment = dict(os.environ) | ({} if cache is None else {"NUMBA_CACHE_DIR": cache})
    command = [sys.executable, "-m", "trailmark_papers.nagai2015.stopwatch", what, str(n_frames), str(seed)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RunError(f"measuring times failed: {done.stderr.strip().splitlines()[-1:]}", "experiment")
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer
