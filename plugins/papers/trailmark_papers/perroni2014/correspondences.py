"""Sec. III: correspondence by index, time and distance makes no difference over 10 to 20 m, says the paper."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.estimates import PathOffset
from trailmark.experiments import ExperimentOptions, Row
from trailmark.pipeline import Pipeline, Step
from trailmark_papers.perroni2014.drives import STREAMS, Deviation, Place, Taught, deviation, replay, teach, way_of
from trailmark_papers.perroni2014.offline import Answers, DepthKeeper, compare, with_depth
from trailmark_papers.perroni2014.true_shift import Surroundings

__all__ = ["correspondence_rows"]

_WIDTH_PX, _LENGTH_M, _TURNED_DEG = 160, 20.0, 5.0
_N_SEEDS = 1
_STARTS_M = (3.0, 9.0, 15.0)
#: How far it may drive while it does not know where it is; by itself `drift_steering` stops after 1 m.
_SEARCH = {"search_m": 5.0}
_AFTERNOON = {"time": "afternoon", "people": 3}
_HOWS: Mapping[str, Mapping[str, Any]] = {
    "distance": {},
    "time": {"correspondence": "time", "select": "time"},
    "index": {"correspondence": "index", "select": "every"},
    "appearance": {"correspondence": "appearance"},
    "distance_and_landmarks": {"landmark_spacing_m": 3.0},
}


def correspondence_rows(options: ExperimentOptions) -> list[Row]:
    """Return the rows of both worlds: what each says on the same pictures, and where each leads a robot."""
    if options.quick:
        return []
    return [row for world in ("street", "corridor") for row in _rows_of(options, world)]


def _rows_of(options: ExperimentOptions, world: str) -> list[Row]:
    localizers = {name: {**STREAMS, **how} for name, how in _HOWS.items()}
    keeper = DepthKeeper()
    place = Place(world, _LENGTH_M, _WIDTH_PX)
    folder = options.out / "runs" / f"correspondence-{world}"
    taught = teach(folder, place, localizers, options.seed, keeper, **with_depth())
    around = keeper.surroundings(taught.truth)
    seeds = [options.seed + k for k in range(_N_SEEDS)]
    calls = [(taught, around, localizers, name, seed) for name in localizers for seed in seeds]
    found = options.map(corresponding_drive, calls)
    rows = []
    for k, name in enumerate(localizers):
        own = found[k * _N_SEEDS : (k + 1) * _N_SEEDS]
        watched = [answers[name] for answers, _ in found[:_N_SEEDS]]  # distance drives, all others look on
        rows += _rows_of_how(f"correspondence, {world}, 20 m", name.replace("_", " "), watched, [way for _, way in own])
    found_at = options.map(unknown_start, [(taught, start_m, options.seed) for start_m in _STARTS_M])
    options.report(f"correspondences, {world}")
    return rows + _rows_of_starts(f"put down anywhere, {world}", found_at)


def corresponding_drive(
    taught: Taught, around: Surroundings, localizers: Mapping[str, Mapping[str, Any]], driver: str, seed: int
) -> tuple[dict[str, Answers], Deviation]:
    """Let one correspondence lead the robot, and all others look on when distance does."""
    told: list[tuple[str, float, PathOffset | None]] = []

    def keep(_: Pipeline, step: Step) -> None:
        for one in step.estimates:
            if one.source in localizers:
                offset = one.estimate if isinstance(one.estimate, PathOffset) else None
                told.append((one.source, one.estimate.stamp_s, offset))

    shown = localizers if driver == "distance" else {driver: localizers[driver]}
    with tempfile.TemporaryDirectory() as folder:
        result = replay(Path(folder), taught, _AFTERNOON, shown, seed, _TURNED_DEG, use=[driver], on_step=keep)
    assert result.ground_truth is not None
    return compare(told, taught, around, result.ground_truth), deviation(taught, result)


def unknown_start(taught: Taught, start_m: float, seed: int) -> tuple[float, float]:
    """Put the robot down without telling it where; return how far it drove until it knew, and how wrong it was [m].

    Infinite where it never knew.
    """
    first: list[tuple[float, float]] = []

    def keep(_: Pipeline, step: Step) -> None:
        if step.belief.on_path is not None and not first:
            first.append((step.stamp_s, step.belief.on_path.station_m))

    streams = {"appearance": {**STREAMS, "correspondence": "appearance"}}  # under the name that it was taught by
    with tempfile.TemporaryDirectory() as folder:
        result = replay(
            Path(folder), taught, _AFTERNOON, streams, seed, controller=_SEARCH, put_down_m=start_m, on_step=keep
        )
    if not first or result.ground_truth is None:
        return math.inf, math.inf
    stamp_s, station_m = first[0]
    true = result.ground_truth.at([min(stamp_s, result.ground_truth.stamps_s[-1])])[0][1]
    return true.x - start_m, abs(station_m - way_of(taught.truth).locate(true).station_m)


def _rows_of_starts(name: str, found_at: Sequence[tuple[float, float]]) -> list[Row]:
    n = len(found_at)
    driven_m, wrong_m = (max(values) for values in zip(*found_at, strict=True))
    note = f"at half speed; drift_steering was let search for {_SEARCH['search_m']:g} m"
    return [
        Row(name, "appearance: way until it knew, max", "m", driven_m, n=n, note=note),
        Row(name, "appearance: station then wrong by, max", "m", wrong_m, n=n),
    ]


def _rows_of_how(name: str, how: str, watched: list[Answers], ways: list[Deviation]) -> list[Row]:
    said, true = (np.concatenate([getattr(one, what) for one in watched]) for what in ("said", "true"))
    misses_m = np.concatenate([one.misses_m for one in watched])
    n, seeds = len(said), len(ways)
    return [
        Row(
            name, f"{how}: shift less the true one, MAE", "columns", float(np.abs(said - true).mean()), n=n, seeds=seeds
        ),
        Row(name, f"{how}: station less the true one, median", "m", float(np.median(misses_m)), n=n, seeds=seeds),
        Row(
            name,
            f"{how}: offset at the end when it steers, max",
            "m",
            max(way.end_m for way in ways),
            n=seeds,
            seeds=seeds,
        ),
    ]
