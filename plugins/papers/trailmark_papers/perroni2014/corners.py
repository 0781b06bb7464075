"""Past the paper: a taught way of 50 m with two right angles, which straight streams cannot see through."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.kit import Table, group_by, sweep
from trailmark_papers.perroni2014.drives import AFTERNOON, PEERS, STREAMS, Deviation, Place, Replay, Taught
from trailmark_papers.perroni2014.plots import draw_corners

__all__ = ["corner_rows"]

_WIDTH_PX = 160
_LENGTH_M = 50.0
_N_SEEDS = {"corridor": 2, "street": 1}  # in each place
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
    place = Place(world, _LENGTH_M, _WIDTH_PX, route="bends", world_seed=options.world_seed)
    taught = place.teach(options.out / "runs" / f"corners-{world}", {"streams": STREAMS, **PEERS}, options.seed)
    n_seeds = {name: _N_SEEDS[world] if name == "streams" else _N_OTHERS[world] for name in (*_WAYS, *PEERS)}
    cells = {(driver, k): (taught, options.seed + k, driver) for driver, n in n_seeds.items() for k in range(n)}
    ways = group_by(sweep(options, corner_drive, cells), lambda cell: cell[0])
    draw_corners(options.out / f"corners_{world}.svg", taught.truth, ways["streams"])
    options.report(f"two corners, {world}: {max(way.largest_m for way in ways['streams']):.3f} m at most")
    return [row for driver, several in ways.items() for row in _rows_of_driver(world, driver, several)]


def corner_drive(taught: Taught, seed: int, driver: str) -> Deviation:
    """Replay the way around both corners."""
    localizers = {driver: PEERS[driver]} if driver in PEERS else {"streams": {**STREAMS, **_WAYS[driver]}}
    return taught.follow(Replay(localizers, seed, AFTERNOON))


def _rows_of_driver(world: str, driver: str, ways: Sequence[Deviation]) -> Table:
    table = Table(f"two corners, {world}, 50 m", len(ways), len(ways))
    is_judged = driver == "streams"
    full = 100.0 if is_judged else None
    held = [way.arrived and way.largest_m <= _NEAR_M for way in ways]
    bars = {"bar": _NEAR_M, "stretch": 0.15} if is_judged else {}
    table.add_share(f"{driver}: followed within 0.3 m", held, bar=full, stretch=full)
    table.add(f"{driver}: offset from the path, max", "m", max(way.largest_m for way in ways), **bars)
    return table
