"""Do localizers err as much as they say, by themselves and after the estimator has learned how wrong they are?

A simulated robot carries every sensor and runs every localizer of the repository, the peers too: it repeats 8 m of a
taught way, in places that differ. What each said is then told to a Kalman estimator, beside wheels, a camera over the
floor and the taught laser: their differences tell it by how much each errs more than it says.

Squared errors against the exact truth in units of the stated covariance, a degree of freedom (NEES): 1 is right, more
is too sure, less too humble. Motions are judged one by one and chained over a second: who follows key frames states
what those err by, of which single motions have but a share. Scales are learned upwards alone, so who is too humble
stays so.

    python benchmarks/noise_told.py DIR [--places 5] [--seeds 1]    what is recorded there is not recorded again
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
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
_PIECE_S = 1.0
TEACH_S, REPLAY_S, TEACH_SEED = 27.0, 20.0, 100


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
class Row:
    """One localizer in one run: NEES a degree of freedom, and by how much it errs more than it says."""

    localizer: str
    world: str
    place: int
    n: int
    nees: float
    nees_chained: float
    scale: float

    @property
    def nees_learned(self) -> float:
        """Of motions the chained ones, with the standard deviations that the estimator believed last."""
        return (self.nees if math.isnan(self.nees_chained) else self.nees_chained) / self.scale**2


def main() -> None:
    """Record what is missing, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--places", type=int, default=5, help="of each world")
    parser.add_argument("--seeds", type=int, default=1, help="drives in each place")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    drives = product(WORLDS, range(1, 1 + arguments.places), range(1, 1 + arguments.seeds))
    recorded = [recording(arguments.folder, *drive) for drive in drives]
    print("\n".join(table([row for folder in recorded for row in rows_of(folder)])))


def localizers_in(world: World) -> dict[str, dict[str, Any]]:
    """Return the localizers whose sensors a world has."""
    return {
        name: keys
        for name, keys in LOCALIZERS.items()
        if name not in world.without and not set(keys.values()) & {*EVERYTHING} - {*world.sensors}
    }


def config(name: str, place: int, seed: int, mode: str) -> dict[str, Any]:
    """Return the config of a run of everything."""
    world = WORLDS[name]
    localizers = localizers_in(world)
    return {
        "mode": mode,
        "sources": {
            "robot": {
                "plugin": "sim", "world": name, "world_seed": place, "driver": "route", **world.keys,
                "sensors": list(world.sensors), "duration_s": TEACH_S if mode == "teach" else REPLAY_S, "threads": 1,
                "rates_hz": {sensor: rate for sensor, rate in RATES_HZ.items() if sensor in world.sensors},
            }
        },
        "localizers": {name: {"plugin": name, **keys} for name, keys in localizers.items()},
        "estimator": {"plugin": "kalman", "use": [name for name in DRIVEN_BY if name in localizers]},
        "path_store": {"plugin": "sqlite", "spacing_m": 0.05},
        "start": "first" if mode == "replay" else list(world.start),
        "pace": "step",
        "seed": seed,
    }  # fmt: skip


def recording(folder: Path, world: str, place: int, seed: int) -> Path:
    """Return the run that drives a taught way again, taught and driven where that is not done yet."""
    store = folder / f"{world}_{place}.trail"
    if not store.with_suffix(".taught").exists():
        store.unlink(missing_ok=True)
        _drive(config(world, place, TEACH_SEED, "teach"), store, None)
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


def rows_of(folder: Path) -> Iterator[Row]:
    """Yield a row for each localizer of a run that has said something."""
    run, (world, place, _) = read_run(folder), folder.name.split("_")
    assert run.estimates is not None
    path = taught_path(folder.parent / f"{world}_{place}.trail")
    told, _ = what_was_told(folder)
    for name in LOCALIZERS:
        said = run.estimates.of(name)
        nees = source_statistics(said, run.truth, path=path).nees
        if nees is not None:
            session = Session(path=path, start_pose=path.waypoints[0].pose_map_base)
            scale = learned_scale(name, [one for one in told if one[1] in (name, *BESIDE)], session)
            yield Row(name, world, int(place), nees.n, nees.per_dof, chained_nees(said, run.truth), scale)


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
    return float(np.mean(np.einsum("ni,nij,nj->n", errors, np.linalg.inv(spreads), errors)[known]) / 3.0)


def learned_scale(name: str, told: Sequence[Told], session: Session) -> float:
    """Return by which factor a Kalman estimator multiplies what a localizer states, after it was told everything."""
    estimator = Kalman(KalmanConfig())
    estimator.start(session)
    for _, source, estimate in told:
        estimator.apply(source, estimate)
    return float(estimator.noise_scales().get(name, 1.0))


def table(rows: Sequence[Row]) -> list[str]:
    """Return a row for each localizer: medians over the runs with the least and the most, and how many are within."""
    heads = ("localizer", "runs", "NEES by itself", "least, most", f"within {ALONE[0]:g} to {ALONE[1]:g}",
             "over 1 s", "least, most", f"within {ALONE[0]:g} to {ALONE[1]:g}",
             "scale", "with it", f"within {LEARNED[0]:g} to {LEARNED[1]:g}")  # fmt: skip
    lines = [f"| {' | '.join(heads)} |", f"|---|{'---:|' * (len(heads) - 1)}"]
    for name in LOCALIZERS:
        some = [row for row in rows if row.localizer == name]
        if not some:
            continue
        single, chained, learned = (
            _spread([getattr(row, key) for row in some], bar)
            for key, bar in (("nees", ALONE), ("nees_chained", ALONE), ("nees_learned", LEARNED))
        )
        scales = [row.scale for row in some]
        scale = f"{min(scales):.2f} to {max(scales):.2f}" if max(scales) > min(scales) else f"{scales[0]:.2f}"
        cells = (f"`{name}`", f"{len(some)}", *single, *chained, scale, learned[0], learned[2])
        lines.append(f"| {' | '.join(cells)} |")
    places = {(row.world, row.place) for row in rows}
    worlds = ", ".join(f"{sum(world == name for world, _ in places)} x {name}" for name in WORLDS)
    return [f"{len(places)} places ({worlds}), {sum(row.localizer == 'odometry' for row in rows)} drives.", "", *lines]


def _spread(values: Sequence[float], bar: tuple[float, float]) -> tuple[str, str, str]:
    """Return median, range, and how many are within a bar; nothing where nothing was found."""
    found = np.array(values)[np.isfinite(values)]
    if not len(found):
        return "", "", ""
    n_within = int(np.sum((found >= bar[0]) & (found <= bar[1])))
    return f"{np.median(found):.2g}", f"{found.min():.2g}, {found.max():.2g}", f"{n_within} of {len(found)}"


if __name__ == "__main__":
    main()
