"""Fig. 5: a straight way of 10 m is taught, and replayed from starts that are turned aside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trailmark.experiments import ExperimentOptions, Row
from trailmark_papers.kit import Table, beside_faithful
from trailmark_papers.perroni2014.drives import AFTERNOON, FAITHFUL, PEERS, STREAMS, Deviation, Place, Replay, Taught
from trailmark_papers.perroni2014.plots import draw_ways

__all__ = ["closed_loop_rows"]

_ANGLES_DEG = (2.0, -2.0, 5.0, -5.0, 10.0, -10.0)
_PAPER_ANGLES_DEG = (5.0, -5.0)
_WIDTH_PX = 160
#: The paper's closed loop is outdoors.
#: In each place.
_N_SEEDS, _N_PEER_SEEDS = {"street": 4, "corridor": 2}, {"street": 1, "corridor": 1}
_SIZES = (("street", 640), ("corridor", 320))
#: A gain that learns (Sec. VI), and what it is for: a field of view told as 30 deg, half of the 63 that the camera has.
_LEARNED, _NARROW = {"gain": "learned"}, {"field_of_view_deg": 30.0}
_GAINS: Mapping[str, Mapping[str, Any]] = {
    "learned gain": {**STREAMS, **_LEARNED},
    "half the view told": {**STREAMS, **_NARROW},
    "half the view told, learned gain": {**STREAMS, **_NARROW, **_LEARNED},
}
#: Who steers by the streams: as it is, as printed with the paper's own steering, and by other gains.
_STREAMS: Mapping[str, Mapping[str, Any]] = {"streams": STREAMS, "faithful": FAITHFUL, **_GAINS}
_STEERING: Mapping[str, Mapping[str, Any]] = {"faithful": {"preset": "paper"}}
_END_M, _END_DEG, _GROWTH_M = 0.30, 3.0, 0.10


@dataclass(frozen=True, slots=True)
class _Case:
    """Who steers, from a start turned by how much."""

    driver: str
    turned_deg: float


def closed_loop_rows(options: ExperimentOptions) -> list[Row]:
    """Return the rows of Fig. 5, and draw it."""
    if options.quick:
        return _rows_of(
            options,
            Place("street", 4.0, _WIDTH_PX, world_seed=options.world_seed),
            [5.0, -10.0],
            n_seeds=1,
            n_peer_seeds=0,
        )
    rows = []
    for world, n_seeds in _N_SEEDS.items():
        place = Place(world, 10.0, _WIDTH_PX, world_seed=options.world_seed)
        rows += _rows_of(options, place, _ANGLES_DEG, n_seeds=n_seeds, n_peer_seeds=_N_PEER_SEEDS[world])
    return rows + _size_rows(options)


def _rows_of(
    options: ExperimentOptions, place: Place, angles_deg: Sequence[float], *, n_seeds: int, n_peer_seeds: int
) -> list[Row]:
    folder = options.out / "runs" / f"closed-{place.world}"
    taught = place.teach(folder, {"streams": STREAMS, "faithful": FAITHFUL, **PEERS}, options.seed)
    cases = [_Case("streams", angle) for angle in angles_deg]
    paper_angles = [angle for angle in _PAPER_ANGLES_DEG if angle in angles_deg]
    faithful = [_Case("faithful", angle) for angle in (angles_deg if n_peer_seeds else paper_angles)]
    peers = [_Case(peer, angle) for peer in (*_GAINS, *PEERS) for angle in paper_angles] if n_peer_seeds else []
    first = [*cases, *faithful, *peers]
    calls = [(taught, options.seed + k, first if k < max(1, n_peer_seeds) else cases) for k in range(n_seeds)]
    ways: dict[_Case, list[Deviation]] = {}
    for drives in options.map(drives_of_seed, calls):
        for case, drive in drives.items():
            ways.setdefault(case, []).append(drive)
    name = f"Fig. 5 {place.world}, {place.length_m:g} m"
    draw_ways(options.out / f"figure_5_{place.world}.svg", {case.turned_deg: ways[case] for case in cases})
    options.report(f"{name}: {n_seeds} seeds at {len(angles_deg)} angles")
    rows = []
    for case in cases:
        printed = ways.get(_Case("faithful", case.turned_deg))
        as_printed = _rows_of_angle(name, case.turned_deg, printed) if printed else []
        rows += beside_faithful(_rows_of_angle(name, case.turned_deg, ways[case]), as_printed)
    for peer in (*_GAINS, *PEERS):
        of_peer = [way for case, several in ways.items() if case.driver == peer for way in several]
        rows += _rows_of_peer(name, f"{peer}, +-5 deg", of_peer) if of_peer else []
    return rows


def drives_of_seed(taught: Taught, seed: int, cases: Sequence[_Case]) -> Mapping[_Case, Deviation]:
    """Replay a way from every start with one seed: the same people, bumps and wheels."""
    return {case: _drive(taught, seed, case) for case in cases}


def _drive(taught: Taught, seed: int, case: _Case) -> Deviation:
    # Whatever its gain, it looks at the map of the streams.
    name = "streams" if case.driver in _GAINS else case.driver
    localizers = {name: {**PEERS, **_STREAMS}[case.driver]}
    return taught.follow(
        Replay(localizers, seed, AFTERNOON, case.turned_deg, controller=_STEERING.get(case.driver, {}))
    )


def _rows_of_angle(name: str, angle_deg: float, ways: Sequence[Deviation]) -> list[Row]:
    said, table = f"{angle_deg:+g} deg", Table(name, len(ways), len(ways))
    table.add(f"{said}: offset at the end, max", "m", max(w.end_m for w in ways), bar=_END_M, stretch=0.15)
    table.add(f"{said}: heading at the end, max", "deg", max(w.end_deg for w in ways), bar=_END_DEG)
    table.add(f"{said}: growth after 2 m, max", "m", max(w.growth_m for w in ways), bar=_GROWTH_M)
    return [_share_row(name, said, ways, 95.0), *table]


def _rows_of_peer(name: str, said: str, ways: Sequence[Deviation]) -> list[Row]:
    """Return how often another one came back, and how far it stayed off: who comes back each time differs in that."""
    table = Table(name, len(ways), len(ways))
    table.add(f"{said}: offset at the end, max", "m", max(way.end_m for way in ways))
    return [_share_row(name, said, ways, None), *table]


def _share_row(name: str, said: str, ways: Sequence[Deviation], bar: float | None) -> Row:
    held = [
        way.arrived and way.end_m <= _END_M and way.end_deg <= _END_DEG and way.growth_m <= _GROWTH_M for way in ways
    ]
    table = Table(name, len(ways), len(ways))
    table.add_share(f"{said}: came back to the path", held, bar=bar, stretch=None if bar is None else 100.0)
    return table.rows[0]


def _size_rows(options: ExperimentOptions) -> list[Row]:
    """Return the same drives with larger pictures, one seed: what the small ones leave out."""
    place = options.world_seed
    calls = [
        (options.out / "runs", Place(world, 10.0, width, world_seed=place), options.seed) for world, width in _SIZES
    ]
    bars: dict[str, Any] = {"bar": _END_M, "stretch": 0.15, "n": 2}
    return [
        Row(f"Fig. 5 {world}, {width} px wide", "+-5 deg: offset at the end, max", "m", largest_m, **bars)
        for (world, width), largest_m in zip(_SIZES, options.map(largest_offset_of_size, calls), strict=True)
    ]


def largest_offset_of_size(folder: Path, place: Place, seed: int) -> float:
    """Teach and replay with pictures of a size, from both starts of the paper; return the larger final offset [m]."""
    taught = place.teach(folder / f"size-{place.world}-{place.width_px}", {"streams": STREAMS}, seed)
    return max(_drive(taught, seed, _Case("streams", angle)).end_m for angle in _PAPER_ANGLES_DEG)
