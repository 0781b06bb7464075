"""Fig. 5: a straight way of 10 m is taught, and replayed from starts that are turned aside."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.perroni2014.drives import PEERS, STREAMS, Deviation, Place, Taught, deviation, replay, teach
from trailmark_papers.perroni2014.plots import draw_ways

__all__ = ["closed_loop_rows"]

_ANGLES_DEG = (2.0, -2.0, 5.0, -5.0, 10.0, -10.0)
_PAPER_ANGLES_DEG = (5.0, -5.0)
_AFTERNOON = {"time": "afternoon", "people": 3}
_WIDTH_PX = 160
#: The paper's closed loop is outdoors.
_N_SEEDS, _N_PEER_SEEDS = {"street": 20, "corridor": 3}, {"street": 1, "corridor": 1}
_SIZES = (("street", 640), ("corridor", 320))
_END_M, _END_DEG, _GROWTH_M = 0.30, 3.0, 0.10


@dataclass(frozen=True, slots=True)
class _Case:
    """Who steers, from a start turned by how much."""

    driver: str
    turned_deg: float


def closed_loop_rows(options: ExperimentOptions) -> list[Row]:
    """Return the rows of Fig. 5, and draw it."""
    if options.quick:
        return _rows_of(options, Place("street", 4.0, _WIDTH_PX), [5.0, -10.0], n_seeds=1, n_peer_seeds=0)
    rows = []
    for world, n_seeds in _N_SEEDS.items():
        rows += _rows_of(options, Place(world, 10.0, _WIDTH_PX), _ANGLES_DEG, n_seeds, _N_PEER_SEEDS[world])
    return rows + _size_rows(options)


def _rows_of(
    options: ExperimentOptions, place: Place, angles_deg: Sequence[float], n_seeds: int, n_peer_seeds: int
) -> list[Row]:
    folder = options.out / "runs" / f"closed-{place.world}"
    taught = teach(folder, place, {"streams": STREAMS, **PEERS}, options.seed)
    seeds = [options.seed + k for k in range(n_seeds)]
    cases = [_Case("streams", angle) for angle in angles_deg]
    with_peers = [*cases, *(_Case(peer, angle) for peer in PEERS for angle in _PAPER_ANGLES_DEG)]
    calls = [(taught, seed, with_peers if k < n_peer_seeds else cases) for k, seed in enumerate(seeds)]
    found = options.map(drives_of_seed, calls)
    ways: dict[_Case, list[Deviation]] = {}
    for drives in found:
        for case, drive in drives.items():
            ways.setdefault(case, []).append(drive)
    name = f"Fig. 5 {place.world}, {place.length_m:g} m"
    rows = []
    for angle in angles_deg:
        rows += _rows_of_angle(name, angle, ways[_Case("streams", angle)])
    for peer in PEERS:
        of_peer = [way for case, several in ways.items() if case.driver == peer for way in several]
        rows += [_share_row(name, f"{peer}, +-5 deg", of_peer, None)] if of_peer else []
    draw_ways(options.out / f"figure_5_{place.world}.svg", {case.turned_deg: ways[case] for case in cases})
    options.report(f"{name}: {len(seeds)} seeds at {len(angles_deg)} angles")
    return rows


def drives_of_seed(taught: Taught, seed: int, cases: Sequence[_Case]) -> Mapping[_Case, Deviation]:
    """Replay a way from every start with one seed: the same people, bumps and wheels."""
    return {case: _drive(taught, seed, case) for case in cases}


def _drive(taught: Taught, seed: int, case: _Case) -> Deviation:
    localizers: Mapping[str, Any] = (
        {"streams": STREAMS} if case.driver == "streams" else {case.driver: PEERS[case.driver]}
    )
    with tempfile.TemporaryDirectory() as folder:
        result = replay(Path(folder), taught, _AFTERNOON, localizers, seed, case.turned_deg)
    return deviation(taught, result)


def _rows_of_angle(name: str, angle_deg: float, ways: Sequence[Deviation]) -> list[Row]:
    said, n = f"{angle_deg:+g} deg", len(ways)
    common: dict[str, Any] = {"n": n, "seeds": n}
    return [
        _share_row(name, said, ways, 95.0),
        Row(name, f"{said}: offset at the end, max", "m", max(w.end_m for w in ways), None, _END_M, 0.15, **common),
        Row(name, f"{said}: heading at the end, max", "deg", max(w.end_deg for w in ways), None, _END_DEG, **common),
        Row(name, f"{said}: growth after 2 m, max", "m", max(w.growth_m for w in ways), None, _GROWTH_M, **common),
    ]


def _share_row(name: str, said: str, ways: Sequence[Deviation], bar: float | None) -> Row:
    held = [
        way.arrived and way.end_m <= _END_M and way.end_deg <= _END_DEG and way.growth_m <= _GROWTH_M for way in ways
    ]
    share = 100.0 * sum(held) / len(held)
    stretch = None if bar is None else 100.0
    return Row(
        name,
        f"{said}: came back to the path",
        "%",
        share,
        None,
        bar,
        stretch,
        better="higher",
        n=len(ways),
        seeds=len(ways),
    )


def _size_rows(options: ExperimentOptions) -> list[Row]:
    """Return the same drives with larger pictures, one seed: what the small ones leave out."""
    calls = [(options.out / "runs", world, width, options.seed) for world, width in _SIZES]
    rows = []
    for (_, world, width, _), drives in zip(calls, options.map(drives_of_size, calls), strict=True):
        name = f"Fig. 5 {world}, {width} px wide"
        rows.append(
            Row(name, "+-5 deg: offset at the end, max", "m", max(d.end_m for d in drives), None, _END_M, 0.15, n=2)
        )
    return rows


def drives_of_size(folder: Path, world: str, width_px: int, seed: int) -> list[Deviation]:
    """Teach and replay with pictures of a size, from both starts of the paper."""
    here = folder / f"size-{world}-{width_px}"
    taught = teach(here, Place(world, 10.0, width_px), {"streams": STREAMS}, seed)
    return [_drive(taught, seed, _Case("streams", angle)) for angle in _PAPER_ANGLES_DEG]
