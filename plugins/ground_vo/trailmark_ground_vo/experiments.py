"""The paper's experiments (Sec. IV), in the simulator: ``trailmark reproduce nagai2015``.

Written in the words of a config, so that every part can be swapped there: nothing here imports another plugin.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from trailmark.experiments import ExperimentOptions, Row
from trailmark.geometry import Trajectory, wrap_angle
from trailmark.pipeline import RunResult

__all__ = ["nagai2015"]

_FLOORS = ("wood", "concrete", "asphalt", "pavers", "carpet", "terrazzo", "gravel", "soil")
_QUICK_FLOORS = ("wood", "asphalt")
_QUICK_S = 12.0  # of the 10 m: about 3 m


@dataclass(frozen=True, slots=True)
class _Straight:
    """Errors of visual odometry on a straight line, Sec. IV-B."""

    position_percent: float
    odometer_percent: float
    heading_deg_per_m: float


def nagai2015(options: ExperimentOptions) -> Sequence[Row]:
    """Repeat the experiments of Nagai & Watanabe 2015."""
    return [*_straight_rows(options)]


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
