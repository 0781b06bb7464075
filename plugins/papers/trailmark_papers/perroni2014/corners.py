"""Past the paper: a taught way of 50 m with two right angles, which straight streams cannot see through."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.perroni2014.drives import PEERS, STREAMS, Deviation, Place, Taught, deviation, replay, teach
from trailmark_papers.perroni2014.plots import draw_corners

__all__ = ["corner_rows"]

_AFTERNOON = {"time": "afternoon", "people": 3}
_WIDTH_PX = 160
_LENGTH_M = 50.0
_N_SEEDS = {"corridor": 10, "street": 3}
_N_OTHERS = {"corridor": 1, "street": 0}  # what is not judged: variants and peers
_NEAR_M = 0.3
#: How the place along the path is found; the first is what is judged.
_WAYS: Mapping[str, Mapping[str, Any]] = {
    "streams": {},
    "streams, landmarks": {"landmark_spacing_m": 3.0},
    "streams, silent in turns": {"when_blind": "silent"},
}


def corner_rows(options: ExperimentOptions) -> list[Row]:
    """Return the rows of both worlds; the quick version turns no corner."""
    if options.quick:
        return []
    return [row for world in _N_SEEDS for row in _rows_of(options, world)]


def _rows_of(options: ExperimentOptions, world: str) -> list[Row]:
    place = Place(world, _LENGTH_M, _WIDTH_PX, route="bends")
    taught = teach(options.out / "runs" / f"corners-{world}", place, {"streams": STREAMS, **PEERS}, options.seed)
    n_seeds = {name: _N_SEEDS[world] if name == "streams" else _N_OTHERS[world] for name in (*_WAYS, *PEERS)}
    calls = [(taught, options.seed + k, driver) for driver, n in n_seeds.items() for k in range(n)]
    ways: dict[str, list[Deviation]] = {driver: [] for driver in n_seeds}
    for (_, _, driver), way in zip(calls, options.map(corner_drive, calls), strict=True):
        ways[driver].append(way)
    draw_corners(options.out / f"corners_{world}.svg", taught.truth, ways["streams"])
    options.report(f"two corners, {world}: {max(way.largest_m for way in ways['streams']):.3f} m at most")
    return [row for driver, several in ways.items() if several for row in _rows_of_driver(world, driver, several)]


def corner_drive(taught: Taught, seed: int, driver: str) -> Deviation:
    """Replay the way around both corners."""
    told = PEERS[driver] if driver in PEERS else {**STREAMS, **_WAYS[driver]}
    name = driver if driver in PEERS else "streams"
    with tempfile.TemporaryDirectory() as folder:
        result = replay(Path(folder), taught, _AFTERNOON, {name: told}, seed)
    return deviation(taught, result)


def _rows_of_driver(world: str, driver: str, ways: Sequence[Deviation]) -> list[Row]:
    name, n = f"two corners, {world}, 50 m", len(ways)
    is_judged = driver == "streams"
    held = 100.0 * sum(way.arrived and way.largest_m <= _NEAR_M for way in ways) / n
    largest_m = max(way.largest_m for way in ways)
    bar, stretch = (_NEAR_M, 0.15) if is_judged else (None, None)
    full = 100.0 if is_judged else None
    common: dict[str, Any] = {"n": n, "seeds": n}
    return [
        Row(name, f"{driver}: followed within 0.3 m", "%", held, None, full, full, better="higher", **common),
        Row(name, f"{driver}: offset from the path, max", "m", largest_m, None, bar, stretch, **common),
    ]
