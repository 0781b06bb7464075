"""Measures times in a process of its own: ``python -m trailmark_papers.nagai2015.stopwatch WHAT N SEED``.

``start``: how long both localizers take to start. ``drive``: N pictures of the outdoor course are taught and driven
once more, each call timed in CPU time of its thread. Prints JSON.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.api import create
from trailmark.estimates import Estimate
from trailmark.frames import GroundPlane, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Estimator, FrameSource, Localizer, LocalizerMap, Mode, Session
from trailmark.pipeline.instruments import peak_rss_mb
from trailmark_papers.kit import observe_timed, started_source
from trailmark_papers.nagai2015.runs import course, keys_of

__all__ = ["main"]

_SENSOR = SensorInfo("floor", "image", (512, 480), 70.0, calibration=GroundPlane((3.9e-4, 3.9e-4)))


def main(what: str, n_frames: int, seed: int) -> dict[str, Any]:
    """Return what was measured."""
    import cv2
    import numba

    assert cv2.__version__
    assert numba.__version__
    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder) / "path.trail"
        return _start(store) if what == "start" else _drive(store, n_frames, seed)


def _start(store: Path) -> dict[str, Any]:
    opened = _store(store, "create")
    began_s = time.process_time()
    _localizer("ground_vo", "teach", _SENSOR)
    _localizer("ground_map", "teach", _SENSOR, localizer_map=opened.localizer_map("patches"))
    took_s = time.process_time() - began_s
    opened.close()
    return {"start_s": took_s}


def _drive(store: Path, n_frames: int, seed: int) -> dict[str, Any]:
    course_config = course("outdoor", duration_s=n_frames / 70.0)
    with started_source(course_config, seed, "floor") as source:
        opened = _store(store, "create")
        times = _teach_way(source, opened.localizer_map("patches"))
        opened.commit()
        opened.close()
    with started_source(course_config, seed + 1, "floor") as source:
        opened = _store(store, "read")
        times |= _driven_again(source, opened.localizer_map("patches"))
        opened.close()
    return {name: _summary(values) for name, values in times.items()} | {"peak_mb": peak_rss_mb()}


def _teach_way(source: FrameSource, localizer_map: LocalizerMap) -> dict[str, list[float]]:
    """Register the way; both modes of the relative search see every picture."""
    sensor = source.sensors["floor"]
    motion, paper = (_localizer("ground_vo", "teach", sensor, keys_of(mode)) for mode in ("refined", "paper"))
    patches, estimator = _localizer("ground_map", "teach", sensor, localizer_map=localizer_map), _estimator()
    times: dict[str, list[float]] = {"refined": [], "paper": []}
    for frame in source.frames():
        belief = estimator.belief(frame.stamp_s)
        times["paper"].append(observe_timed(paper, frame, belief)[1])
        said, took_ms = observe_timed(motion, frame, belief)
        times["refined"].append(took_ms)
        _apply(estimator, said)
        patches.observe(frame, estimator.belief(frame.stamp_s))
    return times


def _driven_again(source: FrameSource, localizer_map: LocalizerMap) -> dict[str, list[float]]:
    """Search for what was registered, in two ways; only calls that found something count."""
    sensor = source.sensors["floor"]
    motion, estimator = _localizer("ground_vo", "track", sensor), _estimator()
    searches = ("exhaustive", "pyramid")
    ways = {way: _localizer("ground_map", "track", sensor, {"search": way}, localizer_map) for way in searches}
    times: dict[str, list[float]] = {way: [] for way in ways}
    for frame in source.frames():
        _apply(estimator, motion.observe(frame, estimator.belief(frame.stamp_s)))
        belief = estimator.belief(frame.stamp_s)
        for way, patches in ways.items():
            said, took_ms = observe_timed(patches, frame, belief)
            if said:
                times[way].append(took_ms)
    return times


def _apply(estimator: Estimator, estimates: Sequence[Estimate]) -> None:
    for estimate in estimates:
        estimator.apply("floor", estimate)


def _summary(values: Sequence[float]) -> dict[str, float]:
    ms = np.array(values[1:])  # the first picture has nothing to be compared with
    p50, p99 = np.percentile(ms, [50, 99]).tolist()
    return {"n": len(ms), "mean": float(ms.mean()), "p50": p50, "p99": p99, "max": float(ms.max())}


def _store(path: Path, access: str) -> Any:
    store = create("path_store", "sqlite", path=str(path), access=access)
    store.start(Session(mode="teach" if access == "create" else "replay"))
    return store


def _localizer(
    plugin: str,
    mode: Mode,
    sensor: SensorInfo,
    keys: Mapping[str, Any] | None = None,
    localizer_map: LocalizerMap | None = None,
) -> Localizer:
    localizer: Localizer = create("localizer", plugin, camera="floor", **(keys or {}))
    localizer.start(Session(name=plugin, mode=mode, sensors={"floor": sensor}, map=localizer_map))
    return localizer


def _estimator() -> Estimator:
    estimator: Estimator = create("estimator", "dead_reckoning")
    estimator.start(Session(start_pose=Pose2()))
    return estimator


if __name__ == "__main__":
    sys.stdout.write(json.dumps(main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))) + "\n")
