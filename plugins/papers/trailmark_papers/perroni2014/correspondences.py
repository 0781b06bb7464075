"""Sec. III: correspondence by index, time and distance makes no difference over 10 to 20 m, says the paper."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from trailmark.experiments import ExperimentOptions, Row
from trailmark.pipeline import Pipeline, Step
from trailmark_papers.kit import AnswerKeeper, Table, group_by, sweep, truth_of
from trailmark_papers.perroni2014.drives import AFTERNOON, STREAMS, Deviation, Localizers, Place, Replay, Taught
from trailmark_papers.perroni2014.offline import DepthKeeper, DriveAnswers, compare, with_depth
from trailmark_papers.perroni2014.true_shift import Surroundings

__all__ = ["correspondence_rows"]

_WIDTH_PX, _LENGTH_M, _TURNED_DEG = 160, 20.0, 5.0
_N_SEEDS = 1
_STARTS_M = (3.0, 9.0, 15.0)
#: How far it may drive while it does not know where it is; by itself `drift_steering` stops after 1 m.
_SEARCH = {"search_m": 5.0}
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
    folder = options.out / "runs" / f"correspondence-{world}"
    place = Place(world, _LENGTH_M, _WIDTH_PX, world_seed=options.world_seed)
    taught = place.teach(folder, localizers, options.seed, on_step=keeper, sensors=with_depth())
    around = keeper.surroundings(taught.truth)
    cells = {
        (name, k): (taught, around, localizers, name, options.seed + k) for name in localizers for k in range(_N_SEEDS)
    }
    found = group_by(sweep(options, corresponding_drive, cells), lambda cell: cell[0])
    rows: list[Row] = []
    for name, driven in found.items():
        watched = [answers[name] for answers, _ in found["distance"]]  # all others look on when distance drives
        how = name.replace("_", " ")
        rows += _rows_of_how(f"correspondence, {world}, 20 m", how, watched, [way for _, way in driven])
    found_at = options.map(unknown_start, [(taught, start_m, options.seed) for start_m in _STARTS_M])
    options.report(f"correspondences, {world}")
    return [*rows, *_rows_of_starts(f"put down anywhere, {world}", found_at)]


def corresponding_drive(
    taught: Taught, around: Surroundings, localizers: Localizers, driver: str, seed: int
) -> tuple[dict[str, DriveAnswers], Deviation]:
    """Drive with one correspondence in control; with the one by distance, all others watch."""
    keeper = AnswerKeeper(localizers)
    shown = localizers if driver == "distance" else {driver: localizers[driver]}
    result = taught.replay(Replay(shown, seed, AFTERNOON, _TURNED_DEG, use=[driver]), keeper)
    return compare(keeper.answers, taught, around, truth_of(result)), taught.deviation(result)


def unknown_start(taught: Taught, start_m: float, seed: int) -> tuple[float, float]:
    """Put the robot down without telling it where; return how far it drove until it knew, and how wrong it was [m].

    Infinite where it never knew.
    """
    first: list[tuple[float, float]] = []

    def keep(_: Pipeline, step: Step) -> None:
        if step.belief.on_path is not None and not first:
            first.append((step.stamp_s, step.belief.on_path.station_m))

    streams = {"appearance": {**STREAMS, "correspondence": "appearance"}}  # under the name that it was taught by
    result = taught.replay(Replay(streams, seed, AFTERNOON, controller=_SEARCH, put_down_m=start_m), keep)
    if not first or result.ground_truth is None:
        return math.inf, math.inf
    stamp_s, station_m = first[0]
    true = result.ground_truth.at([min(stamp_s, result.ground_truth.stamps_s[-1])])[0][1]
    return true.x - start_m, abs(station_m - taught.path().locate(true).station_m)


def _rows_of_starts(name: str, found_at: Sequence[tuple[float, float]]) -> Table:
    driven_m, wrong_m = (max(values) for values in zip(*found_at, strict=True))
    note = f"at half speed; drift_steering was let search for {_SEARCH['search_m']:g} m"
    table = Table(name, len(found_at))
    table.add("appearance: way until it knew, max", "m", driven_m, note=note)
    table.add("appearance: station then wrong by, max", "m", wrong_m)
    return table


def _rows_of_how(name: str, how: str, watched: list[DriveAnswers], ways: list[Deviation]) -> Table:
    said, true = (np.concatenate([getattr(one, what) for one in watched]) for what in ("said", "true"))
    misses_m = np.concatenate([one.misses_m for one in watched])
    table = Table(name, len(said), len(ways))
    table.add(f"{how}: shift less the true one, MAE", "columns", float(np.abs(said - true).mean()))
    table.add(f"{how}: station less the true one, median", "m", float(np.median(misses_m)))
    table.add(f"{how}: offset at the end when it steers, max", "m", max(way.end_m for way in ways), n=len(ways))
    return table
