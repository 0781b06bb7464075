"""The paper's reasons, in a supermarket that has them: shelves alike, bare walls, people, a short laser, polish.

In the supermarket of the other experiments every shelf holds goods of its own, posters hang on three walls, and the
laser sees across the room: neither the selection nor the camera has much to win there. In a polished one floor
and refrigerator show everything once more: points that are seen in a mirror are followed like others, and lie nowhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.kit import Table, largest_of, mean_of, path_of
from trailmark_papers.tasaki2010.goals import GoalDrive, drive_to_goal, random_starts
from trailmark_papers.tasaki2010.laser_alone import laser_rows
from trailmark_papers.tasaki2010.place import TaughtPlace, taught_place
from trailmark_papers.tasaki2010.signs import sign_rows
from trailmark_papers.tasaki2010.variants import Answers, drive

__all__ = ["POLISHED", "WORLD", "ambiguous_rows"]

#: The same goods on every shelf and nothing on the walls; the laser reaches as far as small ones of 2010 did.
WORLD = {"alike": True, "laser_m": 4.0}
#: The same, and the floor and the glass of the refrigerator are mirrors.
POLISHED = {**WORLD, "shiny": 1.0}
_NAME = "Alike shelves, bare walls, laser 4 m"
_N_PEOPLE = 4
_N_GOALS = 4  # drives in each place
_WHITE_WALL_M = (1.0, 1.5)  # x of the part in front of the white wall
_FAR_M = 0.5
_STORIES = {
    "developed": "selected by the shipped machine",
    "trained": "selected by one trained on 100 of another such place",
    "unselected": "all candidates",
    "random": "as many at random",
    "paper": "as printed, selected by the shipped machine",
    "paper, trained": "as printed, selected by one trained on 100 of another such place",
    "paper, unselected": "as printed, all candidates",
    "simple": "SURF only, our pose",
    "plain": "SURF only, least squares of all matches",
}


@dataclass(frozen=True, slots=True)
class _Market:
    """A supermarket: what its rows are called, where its drives are kept, and the options of its world."""

    name: str
    folder: str
    world: Mapping[str, Any]


_MARKETS = (_Market(_NAME, "alike", WORLD), _Market(f"{_NAME}, polished floor and glass", "polished", POLISHED))


def ambiguous_rows(options: ExperimentOptions) -> list[Row]:
    """Return what selection, camera, white wall and mirrors mean there; the quick version leaves this out."""
    if options.quick:
        return []
    return [row for market in _MARKETS for row in _rows_of_market(options, market)]


def _rows_of_market(options: ExperimentOptions, market: _Market) -> list[Row]:
    place = taught_place(replace(options, out=options.out / market.folder), market.world)
    source = place.source(route="wall", sensors=["wheels", "omni"], options={"people": _N_PEOPLE})
    (answers,) = options.map(drive, [([place.variants[name] for name in _STORIES], source, options.seed + 100)])
    return [
        *line_rows_of(answers, place, market.name),
        *laser_rows(options, place, f"{market.name}: laser alone, unknown start"),
        *_goal_rows(options, place, market),
        *(sign_rows(options, place) if market is _MARKETS[0] else []),
    ]


def line_rows_of(answers: Mapping[str, Answers], place: TaughtPlace, name: str = _NAME) -> list[Row]:
    """Return the rows of the line by the wall: each selection, the simple methods, and the part by the white wall."""
    rows: list[Row] = []
    for variant, story in _STORIES.items():
        rows += _rows_of(name, answers[variant], story, f"{place.sizes[variant]} landmarks")
    table, x = Table(f"{name}: white wall, x 1.0 to 1.5 m"), answers["developed"].truth[:, 0]
    is_before = (x >= _WHITE_WALL_M[0]) & (x <= _WHITE_WALL_M[1])
    for variant, story in (("developed", "developed"), ("paper", "as printed")):
        errors = answers[variant].errors_m
        for where, part in (("before it", errors[is_before]), ("elsewhere", errors[~is_before])):
            table.add(f"{story}, {where}: error, mean", "m", mean_of(part), n=len(part))
            table.add(f"{story}, {where}: error, largest", "m", largest_of(part), n=len(part))
    return [*rows, *table]


def _rows_of(name: str, answers: Answers, story: str, note: str) -> Table:
    errors: Floats = answers.errors_m
    table = Table(f"{name}, {_N_PEOPLE} people, 4 m along the wall", len(errors))
    table.add(f"{story}: error, mean", "m", mean_of(errors), note=note)
    table.add(f"{story}: error, largest", "m", largest_of(errors))
    table.add_share(f"{story}: pictures answered within {_FAR_M} m", np.nan_to_num(errors, nan=np.inf) <= _FAR_M)
    return table


def _goal_rows(options: ExperimentOptions, place: TaughtPlace, market: _Market) -> Table:
    """Return how drives from unknown starts end, the camera first and then the laser."""
    starts = random_starts(path_of(place.store), _N_GOALS, options.seed + 300)
    calls: list[tuple[Any, ...]] = [
        (
            place.store,
            place.source(start=list(start)),
            options.seed + 300 + k,
            options.out / market.folder / f"goal-{k}",
        )
        for k, start in enumerate(starts)
    ]
    drives: Sequence[GoalDrive] = options.map(drive_to_goal, calls)
    table = Table(f"{market.name}: to the goal, camera first", len(drives), len(drives))
    table.add_share("arrived (reported, and within 0.10 m)", [one.arrived for one in drives])
    distances_m = np.array([one.distance_m for one in drives if one.reported])
    table.add("true distance at reported arrival, mean", "m", mean_of(distances_m))
    table.add("drives that touched something", "", float(sum(one.collisions > 0 for one in drives)))
    return table
