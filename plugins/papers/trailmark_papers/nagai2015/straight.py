"""Sec. IV-B: visual odometry along 10 m straight, on many floors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np

from trailmark.evaluation import read_run
from trailmark.experiments import ExperimentOptions, Row
from trailmark.geometry import Pose2, Trajectory, wrap_angle
from trailmark_papers.kit import Table, Trial, beside_faithful, group_by, sweep
from trailmark_papers.nagai2015.runs import course, drive, keys_of, photographs

__all__ = ["straight_rows"]

_MODES = ("refined", "paper")
_FLOORS = ("wood", "concrete", "asphalt", "pavers", "carpet", "terrazzo", "gravel", "soil")
_QUICK_FLOORS = ("wood", "asphalt")
_SEEDS = 5  # each another place
_QUICK_S = 6.0  # of the 10 m: about 1.5 m

#: Bars of position, odometer and heading, and what would be better still; of the floors of hardly any contrast the
#: bar of the position alone is another one.
_BARS: Mapping[str, Sequence[float | None]] = {"refined": (0.15, 0.02, 0.03), "paper": (None, 0.99, 0.44)}
_STRETCH = (0.05, 0.005, 0.01)
_HARD: Mapping[str, float] = {"wood_dark": 0.3, "artificial_turf": 0.5}


@dataclass(frozen=True, slots=True)
class StraightErrors:
    """Errors of visual odometry over a straight way.

    Attributes
    ----------
    position_percent : float
        Distance of the last pose from the true one, over the way [%].
    odometer_percent : float
        Error of the way's length [%].
    heading_deg_per_m : float
        Error of the heading over the way [deg/m].
    """

    position_percent: float
    odometer_percent: float
    heading_deg_per_m: float


@dataclass(frozen=True, slots=True)
class _OverPlaces:
    """Errors on one floor over places: root mean square, and standard deviation."""

    rms: StraightErrors
    spread: StraightErrors

    @classmethod
    def of(cls, drifts: Sequence[StraightErrors]) -> _OverPlaces:
        errors = np.array([astuple(one) for one in drifts])
        rms = np.sqrt(np.mean(np.square(errors), axis=0))
        return cls(StraightErrors(*rms.tolist()), StraightErrors(*np.std(np.abs(errors), axis=0).tolist()))


@dataclass(frozen=True, slots=True)
class _Floors:
    """The floors of an experiment: how each is named in a config, and how it is judged.

    Attributes
    ----------
    grounds : mapping
        Options of the world by the name of the floor.
    simulated, photographs, hard : sequence of str
        Names: floors of the simulator; photographs; photographs of hardly any contrast.
    """

    grounds: Mapping[str, Mapping[str, Any]]
    simulated: Sequence[str]
    photographs: Sequence[str]
    hard: Sequence[str]

    @classmethod
    def of(cls, options: ExperimentOptions) -> _Floors:
        """Return the floors of the quick or of the full version."""
        simulated = _QUICK_FLOORS if options.quick else _FLOORS
        photos = {f"photograph {name}": {"texture": str(path)} for name, path in photographs(options).items()}
        hard = [name for name in (f"photograph {name}" for name in _HARD) if name in photos]
        grounds = {floor: {"floor": floor} for floor in simulated} | photos
        return cls(grounds, simulated, [name for name in photos if name not in hard], hard)


def straight_rows(options: ExperimentOptions) -> list[Row]:
    """Return the rows of Sec. IV-B: the worst floor, root mean square over the places; `n` counts places.

    Every place is another stretch of the floor, with other noise.
    """
    floors, n_seeds = _Floors.of(options), options.n_places(_SEEDS)
    found = _measure_floors(options, floors, n_seeds)
    length = f"B {'1.5 m' if options.quick else '10 m'} straight"
    tables: dict[str, Table] = {}
    for mode in _MODES:
        table = Table(f"{length}, {mode}", n_seeds, n_seeds)
        for kind, names in (("floors", floors.simulated), ("photographs", floors.photographs)):
            _add_worst(table, kind, mode, {name: found[name][mode] for name in names}, is_papers=not options.quick)
        for name in floors.hard:
            _add_hard(table, name, mode, found[name][mode])
        tables[mode] = table
    return [*beside_faithful(tables["refined"], tables["paper"]), *tables["paper"]]


def _measure_floors(options: ExperimentOptions, floors: _Floors, n_seeds: int) -> dict[str, dict[str, _OverPlaces]]:
    """Return the errors on every floor in both modes."""
    cells = {
        (name, seed): (Trial(options.out, seed, options.place_of(seed)), name, ground, options.quick)
        for seed in range(options.seed, options.seed + n_seeds)
        for name, ground in floors.grounds.items()
    }
    drifts = group_by(sweep(options, _drifts, cells), lambda cell: cell[0])
    found = {
        name: {mode: _OverPlaces.of([one[mode] for one in of_seeds]) for mode in _MODES}
        for name, of_seeds in drifts.items()
    }
    for name, by_mode in found.items():
        said = ", ".join(f"{mode} {by_mode[mode].rms.position_percent:.3f} %" for mode in _MODES)
        options.report(f"straight, {name}: {said}")
    return found


def _drifts(trial: Trial, name: str, ground: Mapping[str, Any], is_quick: bool) -> dict[str, StraightErrors]:
    """Drive once and return the errors of both modes, which see the same pictures."""
    limits: dict[str, Any] = {"duration_s": _QUICK_S} if is_quick else {}
    config = {
        "sources": {"floor": course("straight", trial.place, options=dict(ground), **limits)},
        "localizers": {mode: {"plugin": "ground_vo", **keys_of(mode)} for mode in _MODES},
        "estimator": {"plugin": "dead_reckoning", "use": [_MODES[0]]},
        "seed": trial.seed,
    }
    run = read_run(drive(trial.out / f"straight-{name.replace(' ', '-')}-{trial.seed}", config))
    assert run.truth is not None
    return {mode: drift(run.trajectories[mode], run.truth) for mode in _MODES}


def drift(estimate: Trajectory, truth: Trajectory) -> StraightErrors:
    """Compare the end of a way with the truth, from a common start."""
    stamps = np.clip(estimate.stamps_s, truth.stamps_s[0], truth.stamps_s[-1])
    at_truth = truth.at(stamps)
    moved, should = _displacement(estimate), _displacement(at_truth)
    way_m = at_truth.length_m()
    miss_m = math.hypot(moved.x - should.x, moved.y - should.y)
    odometer = math.hypot(moved.x, moved.y) / math.hypot(should.x, should.y) - 1.0
    turn_rad = wrap_angle(moved.theta - should.theta)
    return StraightErrors(100.0 * miss_m / way_m, 100.0 * odometer, math.degrees(turn_rad) / way_m)


def _displacement(trajectory: Trajectory) -> Pose2:
    """Return the last pose as seen from the first."""
    return trajectory[0][1].between(trajectory[len(trajectory) - 1][1])


def _add_worst(table: Table, kind: str, mode: str, found: Mapping[str, _OverPlaces], *, is_papers: bool) -> None:
    """Add the worst of several floors, and all of them as a note; the paper's figures are those of 10 m."""
    units = (("end position", "%", None), ("odometer", "%", 0.99), ("heading", "deg/m", 0.44))
    for i, (item, unit, paper) in enumerate(units if found else ()):
        by_floor = {name: astuple(one.rms)[i] for name, one in found.items()}
        worst = max(by_floor, key=lambda name: by_floor[name])
        spread = astuple(found[worst].spread)[i] if table.n > 1 else None
        note = ", ".join(f"{name.removeprefix('photograph ')} {value:.2g}" for name, value in by_floor.items())
        bars = {"bar": _BARS[mode][i], "stretch": _STRETCH[i] if mode == "refined" else None}
        fields = {"paper": paper if is_papers else None, "spread": spread, "note": note, **bars}
        table.add(f"{item}, worst of {len(found)} {kind}", unit, by_floor[worst], **fields)


def _add_hard(table: Table, name: str, mode: str, found: _OverPlaces) -> None:
    bars = {"bar": _HARD[name.removeprefix("photograph ")], "stretch": 0.1} if mode == "refined" else {}
    note = f"odometer {found.rms.odometer_percent:.2g} %, heading {found.rms.heading_deg_per_m:.2g} deg/m"
    spread = found.spread.position_percent if table.n > 1 else None
    table.add(f"end position, {name}", "%", found.rms.position_percent, spread=spread, note=note, **bars)
