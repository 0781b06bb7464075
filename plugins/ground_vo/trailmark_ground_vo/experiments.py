"""The paper's experiments (Sec. IV), in the simulator: ``trailmark reproduce nagai2015``.

Written in the words of a config, so that every part can be swapped there: nothing here imports another plugin.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.experiments import ExperimentOptions, Row
from trailmark.geometry import Pose2, Trajectory, wrap_angle
from trailmark.interfaces import Session
from trailmark.paths import Keyframe
from trailmark.pipeline import RunResult

__all__ = ["nagai2015"]

_FLOORS = ("wood", "concrete", "asphalt", "pavers", "carpet", "terrazzo", "gravel", "soil")
_QUICK_FLOORS = ("wood", "asphalt")
_PIXEL_M = 0.2 / 512
_QUICK_S = 12.0  # of the 10 m: about 3 m


@dataclass(frozen=True, slots=True)
class _Straight:
    """Errors of visual odometry on a straight line, Sec. IV-B."""

    position_percent: float
    odometer_percent: float
    heading_deg_per_m: float


def nagai2015(options: ExperimentOptions) -> Sequence[Row]:
    """Repeat the experiments of Nagai & Watanabe 2015."""
    return [*_straight_rows(options), *_indoor_rows(options)]


def _straight_rows(options: ExperimentOptions) -> list[Row]:
    """Return the rows of Sec. IV-B: 10 m straight; the worst floor, root mean square over the seeds."""
    seeds = [options.seed] if options.quick else [options.seed + i for i in range(5)]
    floors = _QUICK_FLOORS if options.quick else _FLOORS
    rows: list[Row] = []
    for mode in ("refined", "paper"):
        worst: dict[str, list[float]] = {"position": [], "odometer": [], "heading": []}
        for floor in floors:
            found = [_straight(options, floor, mode, seed) for seed in seeds]
            options.report(f"10 m straight, {floor}, {mode}: {found[0].odometer_percent:+.4f} % odometer")
            worst["position"].append(_rms([one.position_percent for one in found]))
            worst["odometer"].append(_rms([one.odometer_percent for one in found]))
            worst["heading"].append(_rms([one.heading_deg_per_m for one in found]))
        rows += _rows_of_mode(mode, worst, len(floors), len(seeds), options.quick)
    return rows


def _rows_of_mode(mode: str, worst: dict[str, list[float]], n_floors: int, n_seeds: int, is_quick: bool) -> list[Row]:
    name = f"B {'3 m' if is_quick else '10 m'} straight"
    refined = mode == "refined"
    common: dict[str, Any] = {"n": n_floors * n_seeds, "seeds": n_seeds}
    return [
        Row(name, f"end position, {mode}, worst of {n_floors} floors", "%", max(worst["position"]), None,
            0.15 if refined else None, 0.05 if refined else None, **common),
        Row(name, f"odometer, {mode}", "%", max(worst["odometer"]), 0.99,
            0.02 if refined else 0.99, 0.005 if refined else None, **common),
        Row(name, f"heading, {mode}", "deg/m", max(worst["heading"]), 0.44,
            0.03 if refined else 0.44, 0.01 if refined else None, **common),
    ]  # fmt: skip


def _indoor_rows(options: ExperimentOptions) -> list[Row]:
    """Return the rows of Sec. IV-C: the indoor course, taught once and driven there and back."""
    trips = 0.5 if options.quick else 10.5
    taught, replayed, store = _teach_and_replay(options, trips)
    keyframes = _keyframes(store)
    detected_m, true_m = _search_errors(taught, replayed, keyframes)
    truth = replayed.metrics["trajectories"]["groundtruth"]["metrics"]
    options.report(f"13.4 m indoors, {trips:g} round trips: {len(detected_m)} corrections, {replayed.reason}")
    touched = sum(count for counter, count in replayed.counters.items() if counter.endswith("collisions"))
    n_bytes = max(sum(array.nbytes for array in keyframe.arrays.values()) for keyframe in keyframes) + 3 * 8
    name, n = f"C 13.4 m, {trips:g} trips", len(detected_m)

    def metric(prefix: str) -> float:
        return float(next(value for key, value in truth.items() if key.startswith(f"{prefix}[")))

    return [
        Row(name, "registrations", "", len(keyframes), 268, 270, better="lower"),
        Row(name, "bytes of a registration", "B", n_bytes, 1960, 1960),
        Row(name, "offset from the path, mean", "mm", 1e3 * metric("lateral_mean_m"), 4.4, 4.4, 2.0, n=n),
        Row(name, "offset from the path, max", "mm", 1e3 * metric("lateral_max_m"), 20.3, 20.3, 10.0, n=n),
        Row(name, "angular offset, mean", "deg", metric("path_heading_mean_deg"), 0.69, 0.69, 0.3, n=n),
        Row(name, "angular offset, max", "deg", metric("path_heading_max_deg"), 3.1, 3.1, 1.5, n=n),
        Row(name, "poles touched", "", touched, 0, 0),
        Row(name, "error detected by the search, mean", "mm", 1e3 * float(detected_m.mean()), 0.63, 0.63, 0.2, n=n),
        Row(name, "error detected by the search, max", "mm", 1e3 * float(detected_m.max()), 4.6, 4.6, 1.5, n=n),
        Row(name, "true error after correction, mean", "mm", 1e3 * float(true_m.mean()), None, 0.25, 0.1, n=n),
        Row(
            name, "true error after correction, p99", "mm", 1e3 * float(np.quantile(true_m, 0.99)), None, 1.0, 0.5, n=n
        ),
    ]


def _teach_and_replay(options: ExperimentOptions, trips: float) -> tuple[RunResult, RunResult, Path]:
    source = {"plugin": "sim", "world": "ground_course", "route": "indoor", "sensors": ["floor"]}
    config: dict[str, Any] = {
        "sources": {"floor": source},
        "localizers": {"floor": {"plugin": "ground_vo"}, "floor_map": {"plugin": "ground_map"}},
        "controller": {"plugin": "path_tracking_4ws", "repeat": trips},
        "seed": options.seed,
    }
    store = options.out / "indoor.trail"
    taught = _run(config, options, "indoor-teach", mode="teach", store=store, access="overwrite")
    return taught, _run(config, options, "indoor-replay", mode="replay", store=store), store


def _keyframes(store: Path) -> Sequence[Keyframe]:
    """Return what the absolute search registered while teaching."""
    from trailmark.api import create

    opened = create("path_store", "sqlite", path=str(store), access="read")
    opened.start(Session(mode="replay"))
    try:
        return list(opened.drawer("floor_map").keyframes())
    finally:
        opened.close()


def _search_errors(
    taught: RunResult, replayed: RunResult, keyframes: Sequence[Keyframe]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return what each search says it corrected (Fig. 13), and what is wrong afterwards, (N,) each [m].

    Right is the true pose relative to where the patch was truly registered: errors of teaching remain, as the
    paper says.
    """
    assert taught.ground_truth is not None
    assert replayed.ground_truth is not None
    assert replayed.folder is not None
    fixes = [row for row in _estimates(replayed.folder) if row["source"] == "floor_map" and row["kind"] == "fix"]
    detected, wrong = np.empty(len(fixes)), np.empty(len(fixes))
    for i, row in enumerate(fixes):
        details = json.loads(row["details"])
        keyframe = keyframes[int(details["place"])]
        said = keyframe.pose_map_base.between(Pose2(float(row["x"]), float(row["y"]), float(row["theta"])))
        registered, found = (
            _at(taught.ground_truth, keyframe.stamp_s),
            _at(replayed.ground_truth, float(row["stamp_s"])),
        )
        true = registered.between(found)
        detected[i] = details["shift_px"] * _PIXEL_M
        wrong[i] = math.hypot(said.x - true.x, said.y - true.y)
    return detected, wrong


def _at(trajectory: Trajectory, stamp_s: float) -> Pose2:
    return trajectory.at([stamp_s])[0][1]


def _estimates(folder: Path) -> list[dict[str, str]]:
    with (folder / "estimates.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _straight(options: ExperimentOptions, floor: str, mode: str, seed: int) -> _Straight:
    source: dict[str, Any] = {
        "plugin": "sim",
        "world": "ground_course",
        "route": "straight",
        "sensors": ["floor"],
        "options": {"floor": floor},
    }
    if options.quick:
        source["duration_s"] = _QUICK_S
    config = {
        "sources": {"floor": source},
        "localizers": {"floor": {"plugin": "ground_vo", "mode": mode}},
        "seed": seed,
    }
    return _errors(_run(config, options, f"straight-{floor}-{mode}-{seed}"))


def _run(config: dict[str, Any], options: ExperimentOptions, name: str, **how: Any) -> RunResult:
    from trailmark.api import run

    return run(config, options.out / name, overwrite=True, report=not options.quick, **how)


def _errors(result: RunResult) -> _Straight:
    """Compare the end of the run with the truth, from a common start."""
    estimate, truth = result.trajectories["floor"], result.ground_truth
    assert truth is not None
    at_truth = truth.at(estimate.stamps_s)
    moved, should = _displacement(estimate), _displacement(at_truth)
    way_m = at_truth.length_m()
    miss_m = math.hypot(moved[0] - should[0], moved[1] - should[1])
    odometer = math.hypot(*moved[:2]) / math.hypot(*should[:2]) - 1.0
    turn_rad = abs(wrap_angle(moved[2] - should[2]))
    return _Straight(100 * miss_m / way_m, 100 * odometer, math.degrees(turn_rad) / way_m)


def _displacement(trajectory: Trajectory) -> tuple[float, float, float]:
    """Return the last pose as seen from the first."""
    pose = trajectory[0][1].between(trajectory[len(trajectory) - 1][1])
    return pose.x, pose.y, pose.theta


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
