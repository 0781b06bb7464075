"""Do localizers err as much as they say, by themselves and after the estimator has learned how wrong they are?

A simulated robot runs every localizer of the repository that its sensors suit, the peers too, and repeats a taught way
in places that differ. What each said is then told to a Kalman estimator, beside those that are always told: their
differences tell it by how much each errs more than it says.

Squared errors against the exact truth in units of the stated covariance, a degree of freedom (NEES): 1 is right, more
is too sure, less too humble. Motions are judged one by one and chained over a second: who follows key frames states
what those err by, of which single motions have but a share. Scales are learned upwards alone, so who is too humble
stays so; of path offsets none is learned. Each drive and each teaching has noise of its own.

    python benchmarks/noise_told.py DIR [--places 5] [--seeds 1] [--jobs 2]    what is recorded there is not again
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from fusion_four import RATES_HZ, Told, taught_path, what_was_told

from trailmark import Pipeline
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.evaluation.chaining import chain_windows, covariances_of, windows
from trailmark.evaluation.estimate_errors import true_poses
from trailmark.evaluation.estimates_table import EstimateTable
from trailmark.evaluation.relative import between
from trailmark.evaluation.run_folder import read_run
from trailmark.evaluation.source_statistics import source_statistics
from trailmark.geometry import Trajectory, wrap_angles
from trailmark.interfaces import Session

#: Each localizer and its keys; the sensor that one of them names must be there.
LOCALIZERS: dict[str, dict[str, Any]] = {
    "odometry": {},
    "imu": {"imu": "imu"},
    **{name: {"camera": "floor"} for name in ("ground_vo", "ground_map", "klt", "orb", "phase_correlation")},
    "omni_surf": {"camera": "omni"},
    **{name: {"laser": "laser"} for name in ("laser_icp", "grid_mcl", "scan_odometry")},
    "kinect_landmarks": {"camera": "rgbd", "solve": "plane"},
    **{name: {"camera": "rgbd"} for name in ("kinect_motion", "kinect_flow", "orb_rgbd")},
    **{name: {"camera": "front"} for name in ("divs", "column_ncc", "patch_ncc", "phase_shift")},
}
#: Who moves the belief that places are taught with.
DRIVEN_BY = ("odometry", "imu", "ground_vo", "laser_icp")
#: Who is always told: another localizer is judged beside these.
BESIDE = ("odometry", "ground_vo", "laser_icp")
#: What NEES a degree of freedom should be by itself, and after its scale is learned.
ALONE, LEARNED = (0.2, 5.0), (0.5, 2.0)
#: Motions are joined to pieces of this length [s].
_PIECE_S = 1.0
#: What no motion of a piece has measured is told with a larger variance; what one has, with a smaller one.
_UNMEASURED = 1e5
#: A scale that changes so short a time before the end has not settled [s].
_SETTLED_S = 5.0
TEACH_S, REPLAY_S = 47.0, 40.0
#: Seeds of a place begin at a multiple of it: the teaching, then the drives.
_SEEDS_OF_PLACE = 1000


@dataclass(frozen=True, slots=True)
class World:
    """Where it drives: the keys of the simulator, where the route begins [m, m, deg], and who lacks what it needs."""

    keys: Mapping[str, Any]
    start: tuple[float, float, float]
    sensors: tuple[str, ...]
    without: tuple[str, ...] = ()


EVERYTHING = ("wheels", "imu", "floor", "laser", "front", "rgbd", "omni")
WORLDS = {
    # Depth that is registered to colour, which `orb_rgbd` needs, is had in the laboratory alone.
    "supermarket": World({"route": "round"}, (1.0, 2.0, 0.0), EVERYTHING, without=("orb_rgbd",)),
    "street": World({"route": "straight"}, (0.0, 0.0, 0.0), EVERYTHING, without=("orb_rgbd",)),
    "lab": World(
        {"route": "loop", "options": {"registered": True}}, (3.3, 1.7, 0.158), ("wheels", "imu", "laser", "rgbd")
    ),
}


@dataclass(frozen=True, slots=True)
class Scale:
    """By which factor the estimator multiplies what a localizer states, and whether that did not change at the end."""

    factor: float
    is_settled: bool


@dataclass(frozen=True, slots=True)
class Row:
    """One localizer in one drive: NEES a degree of freedom, NaN where nothing was told; no scale of path offsets."""

    localizer: str
    world: str
    place: int
    seed: int
    nees: float
    nees_chained: float
    scale: Scale | None

    @property
    def nees_learned(self) -> float:
        """Of motions the chained ones, with the standard deviations that the estimator believed last."""
        if self.scale is None:
            return math.nan
        return (self.nees if math.isnan(self.nees_chained) else self.nees_chained) / self.scale.factor**2


def main() -> None:
    """Record what is missing, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--places", type=int, default=5, help="of each world")
    parser.add_argument("--seeds", type=int, default=1, help="drives in each place")
    parser.add_argument("--jobs", type=int, default=1, help="places at a time")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    places = product(WORLDS, range(1, 1 + arguments.places))
    with ProcessPoolExecutor(arguments.jobs) as pool:
        found = pool.map(partial(rows_of_place, arguments.folder, arguments.seeds), places)
        rows = [row for several in found for row in several]
    print("\n".join(table(rows)))


def rows_of_place(folder: Path, n_seeds: int, place: tuple[str, int]) -> list[Row]:
    """Return the rows of all drives in a place, of which those that are missing are recorded."""
    seeds = range(1, 1 + n_seeds)
    return [row for seed in seeds for row in rows_of(recording(folder, *place, seed), *place, seed)]


def localizers_in(world: World) -> dict[str, dict[str, Any]]:
    """Return the localizers whose sensors a world has."""
    return {
        name: keys
        for name, keys in LOCALIZERS.items()
        if name not in world.without and not set(keys.values()) & {*EVERYTHING} - {*world.sensors}
    }


def config(world_name: str, place: int, seed: int, mode: str) -> dict[str, Any]:
    """Return the config of a run of everything."""
    world = WORLDS[world_name]
    localizers = localizers_in(world)
    return {
        "mode": mode,
        "sources": {
            "robot": {
                "plugin": "sim", "world": world_name, "world_seed": place, "driver": "route", **world.keys,
                "sensors": list(world.sensors), "duration_s": TEACH_S if mode == "teach" else REPLAY_S, "threads": 1,
                "rates_hz": {sensor: rate for sensor, rate in RATES_HZ.items() if sensor in world.sensors},
            }
        },
        "localizers": {name: {"plugin": name, **keys} for name, keys in localizers.items()},
        "estimator": {"plugin": "kalman", "use": [name for name in DRIVEN_BY if name in localizers]},
        "path_store": {"plugin": "sqlite", "spacing_m": 0.05},
        "start": "first" if mode == "replay" else list(world.start),
        "pace": "step",
        "seed": _SEEDS_OF_PLACE * place + seed,
    }  # fmt: skip


def recording(folder: Path, world: str, place: int, seed: int) -> Path:
    """Return the run that drives a taught way again, taught and driven where that is not done yet."""
    store = folder / f"{world}_{place}.trail"
    if not store.with_suffix(".taught").exists():
        store.unlink(missing_ok=True)
        _drive(config(world, place, 0, "teach"), store, None)
        store.with_suffix(".taught").touch()
    out = folder / f"{world}_{place}_{seed}"
    if not (out / "recorded").exists():
        _drive(config(world, place, seed, "replay"), store, out)
        (out / "recorded").touch()
        print(f"{world} {place}, seed {seed} recorded", file=sys.stderr, flush=True)
    return out


def _drive(config: dict[str, Any], store: Path, out: Path | None) -> None:
    with Pipeline(config, store=store, mode=config["mode"], out=out, overwrite=True) as pipeline:
        for _ in pipeline:
            pass


def rows_of(folder: Path, world: str, place: int, seed: int) -> Iterator[Row]:
    """Yield a row for each localizer of a drive."""
    run = read_run(folder)
    estimates, truth = run.estimates, run.truth
    assert estimates is not None
    path = taught_path(folder.parent / f"{world}_{place}.trail")
    session = Session(path=path, start_pose=path.waypoints[0].pose_map_base)
    told, _ = what_was_told(folder)
    for name in localizers_in(WORLDS[world]):
        said = estimates.of(name)
        nees = source_statistics(said, truth, path=path).nees
        heard = [one for one in told if one[1] in (name, *BESIDE)]
        scale = learned_scale(name, heard, session) if np.isin(said.kind, ("motion", "fix")).any() else None
        yield Row(name, world, place, seed, nees.per_dof if nees else math.nan, chained_nees(said, truth), scale)


def chained_nees(said: EstimateTable, truth: Trajectory | None) -> float:
    """Return NEES a degree of freedom of motions joined to pieces of a second; NaN where there is none."""
    motions = said.where(said.kind == "motion")
    assert truth is not None
    pieces = list(windows(motions.since_s, motions.stamp_s, motions.stamp_s - motions.since_s, _PIECE_S))
    if not pieces:
        return math.nan
    chained, spreads, first, last = chain_windows(motions.numbers, covariances_of(motions.information), pieces)
    true = between(true_poses(truth, motions.since_s[first]), true_poses(truth, motions.stamp_s[last]))
    errors = chained - np.asarray(true)
    errors[:, 2] = wrap_angles(errors[:, 2])
    known = np.isfinite(errors).all(axis=1)
    squares = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(spreads), errors)
    dof = (np.linalg.eigvalsh(spreads) < _UNMEASURED).sum(axis=1)
    return float(squares[known].sum() / dof[known].sum()) if dof[known].any() else math.nan


def learned_scale(name: str, told: Sequence[Told], session: Session) -> Scale:
    """Return by which factor a Kalman estimator multiplies what a localizer states, after it was told everything."""
    estimator, earlier = Kalman(KalmanConfig()), 1.0
    estimator.start(session)
    for arrived_s, source, estimate in told:
        estimator.apply(source, estimate)
        if arrived_s <= told[-1][0] - _SETTLED_S:
            earlier = estimator.noise_scales().get(name, 1.0)
    last = float(estimator.noise_scales().get(name, 1.0))
    return Scale(last, last == earlier)


def table(rows: Sequence[Row]) -> list[str]:
    """Return a row for each localizer in each world: medians of the drives, their range, and how many are within."""
    alone, learned = (f"within {low:g} to {high:g}" for low, high in (ALONE, LEARNED))
    heads = ("localizer", "world", "drives", "NEES by itself", "least, most", alone, "over 1 s", "least, most", alone,
             "scale", "with it", learned)  # fmt: skip
    lines = [f"| {' | '.join(heads)} |", f"|---|---|{'---:|' * (len(heads) - 2)}"]
    for name, world in product(LOCALIZERS, WORLDS):
        some = [row for row in rows if (row.localizer, row.world) == (name, world)]
        if some:
            single, chained = (_spread([getattr(row, key) for row in some], ALONE) for key in ("nees", "nees_chained"))
            median, _, n_within = _spread([row.nees_learned for row in some], LEARNED)
            scales = _scales_text([row.scale for row in some if row.scale is not None])
            cells = (f"`{name}`", world, f"{len(some)}", *single, *chained, scales, median, n_within)
            lines.append(f"| {' | '.join(cells)} |")
    places, drives = {(row.world, row.place) for row in rows}, {(row.world, row.place, row.seed) for row in rows}
    worlds = ", ".join(f"{sum(world == name for world, _ in places)} x {name}" for name in WORLDS)
    legend = f"Empty: `Lost` all the time, or nothing of the kind. *: a scale changed in the last {_SETTLED_S:g} s."
    return [f"{len(places)} places ({worlds}), {len(drives)} drives.", "", *lines, "", legend]


def _spread(values: Sequence[float], bar: tuple[float, float]) -> tuple[str, str, str]:
    """Return median, range, and how many are within a bar; nothing where nothing was found."""
    found = np.array(values)[np.isfinite(values)]
    if not len(found):
        return "", "", ""
    n_within = int(np.sum((found >= bar[0]) & (found <= bar[1])))
    return f"{np.median(found):.2g}", f"{found.min():.2g}, {found.max():.2g}", f"{n_within} of {len(found)}"


def _scales_text(scales: Sequence[Scale]) -> str:
    """Return the range of scales, with a star where one has not settled."""
    if not scales:
        return ""
    least, most = (f"{function(scale.factor for scale in scales):.2f}" for function in (min, max))
    star = "" if all(scale.is_settled for scale in scales) else " *"
    return f"{least}{star}" if least == most else f"{least} to {most}{star}"


if __name__ == "__main__":
    main()
