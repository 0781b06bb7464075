"""One simulated robot with four localizers, of which one is switched off or lies for a while: is fusion worth it?

The robot carries a floor camera (`ground_vo`, `ground_map`), an omnidirectional camera and a laser (`omni_surf`,
`laser_icp`), a depth camera (`kinect_landmarks`), a front camera (`divs`) and wheel odometry, and repeats 8 m of a
taught way through a supermarket, seeds in turn in five of them. Each is driven and rendered once (``record``); what the
localizers said is then told again to the estimator alone (``replay``), with one of the four switched off, or lying by 1
m to the left with the covariance that it always states, for 20 % of the time. The motion of a lying floor camera jumps
by 1 m and back.

    python benchmarks/fusion_four.py record DIR [--seeds 1 21]     30 s of processor time a seed; seed 0: the noise;
                                                                   what is recorded is not recorded again
    python benchmarks/fusion_four.py replay DIR [--json]           5 s a seed

Beside the fused belief each of the four alone, in the same fault: `dead_reckoning` on what it says, with wheel odometry
where it says no motion. ATE is the root mean square distance from the truth at 20 Hz, without alignment, from the
belief at the time (what comes later does not mend it). Covariances: as stated, but not below what
`trailmark evaluate --noise` measures on seed 0, which is none of the others and in a place of its own.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trailmark import Pipeline
from trailmark.estimates import Estimate, Fix, Lost, Motion, PathOffset
from trailmark.estimation.dead_reckoning import DeadReckoning
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.evaluation.estimates_table import EstimateTable
from trailmark.evaluation.measured_noise import measured_noise
from trailmark.evaluation.run_folder import read_run
from trailmark.geometry import Pose2, Trajectory
from trailmark.interfaces import Estimator, Session
from trailmark.paths import Path as TaughtPath
from trailmark.stores.sqlite import SqlitePathStore
from trailmark.stores.sqlite_config import SqliteStoreConfig

#: The four, and the names of what they say.
GROUPS = {"ground": ("floor", "floor_map"), "omni": ("omni", "laser"), "kinect": ("kinect",), "streams": ("streams",)}
#: Who says motion of its own; the others stand on the wheels.
MOVES = ("ground",)
FAULTS = ("off", "lies")
SHARE = 0.2
LIE_M = 1.0
RATES_HZ = {"floor": 30.0, "omni": 4.0, "rgbd": 4.0, "front": 8.0, "laser": 4.0, "wheels": 40.0}
TEACH_S, REPLAY_S = 27.0, 20.0
TEACH_SEED, NOISE_SEED = 100, 0
N_PLACES = 5
_SAMPLES_HZ = 20.0

Told = tuple[float, str, Estimate]


@dataclass(frozen=True, slots=True)
class Row:
    """One run with one fault: ATE of the fused belief, of the four alone, and of the one that failed [m]."""

    seed: int
    failed: str
    fault: str
    fused_m: float
    alone_m: dict[str, float]

    @property
    def best_m(self) -> float:
        """ATE of the best single localizer, chosen afterwards [m]."""
        return min(self.alone_m.values())


def main() -> None:
    """Record, or replay and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("record", "replay"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, nargs=2, default=(1, 21), metavar=("FIRST", "END"))
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    if arguments.what == "record":
        for seed in (NOISE_SEED, *range(*arguments.seeds)):
            if not (arguments.folder / f"seed_{seed:02d}" / "recorded").exists():
                record(arguments.folder, seed)
                print(f"seed {seed} recorded", file=sys.stderr, flush=True)
        return
    rows = list(replayed(arguments.folder, range(*arguments.seeds)))
    print(json.dumps([asdict(row) for row in rows]) if arguments.json else "\n".join(summary(rows)))


def place_of(seed: int) -> int:
    """Return the ``world_seed`` of a drive: the seeds take turns in five places, that of the noise has its own."""
    return N_PLACES + 1 if seed == NOISE_SEED else 1 + (seed - 1) % N_PLACES


def config(seed: int, place: int, mode: str, duration_s: float) -> dict[str, Any]:
    """Return the config of a run with all sensors."""
    sensors = ["wheels", "floor", "laser", "front", "rgbd", "omni"]
    world = {"plugin": "sim", "world": "supermarket", "world_seed": place, "route": "round", "driver": "route"}
    drive = {"sensors": sensors, "rates_hz": RATES_HZ, "duration_s": duration_s, "threads": 1}
    return {
        "mode": mode,
        "sources": {"robot": {**world, **drive}},
        "localizers": {
            "wheels": {"plugin": "odometry"},
            "floor": {"plugin": "ground_vo", "camera": "floor"},
            "floor_map": {"plugin": "ground_map", "camera": "floor"},
            "omni": {"plugin": "omni_surf", "camera": "omni"},
            "laser": {"plugin": "laser_icp", "laser": "laser"},
            "kinect": {"plugin": "kinect_landmarks", "camera": "rgbd", "solve": "plane"},
            "streams": {"plugin": "divs", "camera": "front"},
        },
        "estimator": {"plugin": "kalman", **({"use": ["wheels", "floor"]} if mode == "teach" else {})},
        "path_store": {"plugin": "sqlite", "spacing_m": 0.05},
        "start": "first" if mode == "replay" else [1.0, 2.0, 0.0],
        "pace": "step",
        "seed": seed,
    }


def record(folder: Path, seed: int) -> None:
    """Teach its place, unless that is done, and drive the way again; what the localizers say is kept."""
    folder.mkdir(parents=True, exist_ok=True)
    place, store = place_of(seed), store_of(folder, seed)
    is_taught = store.with_suffix(".taught")
    if not is_taught.exists():
        store.unlink(missing_ok=True)
        with Pipeline(config(TEACH_SEED, place, "teach", TEACH_S), store=store, mode="teach") as pipeline:
            for _ in pipeline:
                pass
        is_taught.touch()
    out = folder / f"seed_{seed:02d}"
    asked = config(seed, place, "replay", REPLAY_S)
    with Pipeline(asked, store=store, mode="replay", out=out, overwrite=True) as pipeline:
        for _ in pipeline:
            pass
    (out / "recorded").touch()


def store_of(folder: Path, seed: int) -> Path:
    """Return where the way is kept that is taught in the place of a seed."""
    return folder / f"place_{place_of(seed)}.trail"


def replayed(folder: Path, seeds: Sequence[int]) -> Iterator[Row]:
    """Yield a row for each seed, each of the four, and each fault; and one without a fault."""
    treatments = noise_figures(folder, taught_path(store_of(folder, NOISE_SEED)))
    for seed in seeds:
        path = taught_path(store_of(folder, seed))
        told, truth = what_was_told(folder / f"seed_{seed:02d}")
        begin_s, end_s = _failing(seed, truth)
        cases = [("nobody", "none"), *((failed, fault) for failed in GROUPS for fault in FAULTS)]
        plain = {group: ate(_alone(), _of(told, group), truth, path) for group in GROUPS}
        for failed, fault in cases:
            faulty = list(with_fault(told, GROUPS.get(failed, ()), fault, begin_s, end_s))
            fused_m = ate(Kalman(KalmanConfig.model_validate({"sources": treatments})), faulty, truth, path)
            alone = dict(plain)
            if failed in GROUPS:
                alone[failed] = ate(_alone(), _of(faulty, failed), truth, path)
            yield Row(seed, failed, fault, fused_m, alone)


def taught_path(store: Path) -> TaughtPath:
    """Return the path in a store."""
    opened = SqlitePathStore(SqliteStoreConfig(path=str(store.resolve())))
    opened.start(Session(mode="replay"))
    path = opened.path()
    opened.close()
    assert path is not None
    return path


def noise_figures(folder: Path, path: TaughtPath) -> dict[str, dict[str, float]]:
    """Return the treatment of each localizer, as measured on a seed of its own."""
    run = read_run(folder / f"seed_{NOISE_SEED:02d}")
    assert run.estimates is not None
    assert run.truth is not None
    figures: dict[str, dict[str, float]] = {}
    for source, noise in measured_noise(run.estimates, run.truth, path).items():
        if noise.kind == "motion":
            figures[source] = {"sigma_scale": max(1.0, noise.sigma_scale)}
        else:
            floor_m, floor_rad = float(np.nanmax(noise.rms[:2])), noise.rms[2]
            figures[source] = {"floor_m": floor_m, "floor_deg": math.degrees(floor_rad)}
    return figures


def what_was_told(folder: Path) -> tuple[list[Told], Trajectory]:
    """Return the estimates of a run in the order of their arrival, and the truth."""
    run = read_run(folder)
    assert run.estimates is not None
    assert run.truth is not None
    return list(_estimates(run.estimates)), run.truth


def with_fault(told: Sequence[Told], names: Sequence[str], fault: str, begin_s: float, end_s: float) -> Iterator[Told]:
    """Yield what is told when some localizers are switched off, or say that base is 1 m further left."""
    for arrived_s, source, estimate in told:
        if source not in names or fault == "none":
            yield arrived_s, source, estimate
        elif fault == "lies":
            yield arrived_s, source, _lying(estimate, begin_s, end_s)
        elif not begin_s <= estimate.stamp_s < end_s:
            yield arrived_s, source, estimate


def ate(estimator: Estimator, told: Sequence[Told], truth: Trajectory, path: TaughtPath) -> float:
    """Return the root mean square distance of the belief at the time from the truth [m]."""
    estimator.start(Session(path=path, start_pose=path.waypoints[0].pose_map_base))
    asked_s = np.arange(truth.stamps_s[0] + 0.5, truth.stamps_s[-1], 1.0 / _SAMPLES_HZ)
    true = truth.at(asked_s).positions
    errors, next_up = [], 0
    for at_s, (x, y) in zip(asked_s.tolist(), true.tolist()):
        while next_up < len(told) and told[next_up][0] <= at_s:
            estimator.apply(told[next_up][1], told[next_up][2])
            next_up += 1
        pose = estimator.belief(at_s).pose_map_base
        assert pose is not None
        errors.append(math.hypot(pose.x - x, pose.y - y))
    return float(np.sqrt(np.mean(np.square(errors))))


def summary(rows: Sequence[Row]) -> list[str]:
    """Return a table: medians over the seeds, and how the fused belief compares, row by row."""
    lines = [
        "| failed | how | fused ATE | best alone | failed one | fused / best: median, worst | fused / failed: worst |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, fault in dict.fromkeys((row.failed, row.fault) for row in rows):
        some = [row for row in rows if (row.failed, row.fault) == (name, fault)]
        ratios = [row.fused_m / row.best_m for row in some]
        broken = [row.alone_m[name] for row in some] if name in GROUPS else []
        worst = max((row.fused_m / row.alone_m[name] for row in some), default=0.0) if broken else math.nan
        fused_mm, best_mm = (
            1e3 * float(np.median([getattr(row, key) for row in some])) for key in ("fused_m", "best_m")
        )
        failed = f"{1e3 * float(np.median(broken)):.1f} mm" if broken else "-"
        against = f"{worst:.2f}" if broken else "-"
        lines.append(
            f"| {name} | {fault} | {fused_mm:.1f} mm | {best_mm:.1f} mm | {failed}"
            f" | {float(np.median(ratios)):.2f}, {max(ratios):.2f} | {against} |"
        )
    return [*lines, "", *verdicts(rows)]


def verdicts(rows: Sequence[Row]) -> list[str]:
    """Return what the bars ask of all rows with a fault, and what was found."""
    faulty = [row for row in rows if row.failed in GROUPS]
    ratios = np.array([row.fused_m / row.best_m for row in faulty])
    failed = np.array([row.fused_m / row.alone_m[row.failed] for row in faulty])
    seeds, near, far, half = {row.seed for row in rows}, ratios <= 1.1, ratios > 1.5, failed <= 0.5
    return [
        f"{len(faulty)} runs with a fault: {len(seeds)} seeds in {len({place_of(seed) for seed in seeds})} places.",
        f"fused <= 1.1 x the best single one: {near.mean():.1%} of runs (bar 95 %{_missed(near.mean() < 0.95)})",
        f"fused > 1.5 x the best single one: {far.sum()} runs (bar 0{_missed(far.any())}); worst {ratios.max():.2f}",
        f"fused <= 0.5 x the failed one: {half.mean():.1%} of runs (bar 100 %{_missed(not half.all())});"
        f" worst {failed.max():.2f}",
    ]


def _missed(is_missed: bool | np.bool_) -> str:
    return ": **missed**" if is_missed else ""


def _failing(seed: int, truth: Trajectory) -> tuple[float, float]:
    """Return when the fault begins and ends [s]."""
    begin_s, end_s = float(truth.stamps_s[0]), float(truth.stamps_s[-1])
    at = np.random.default_rng(seed).uniform(0.1, 0.9 - SHARE)
    return begin_s + at * (end_s - begin_s), begin_s + (at + SHARE) * (end_s - begin_s)


def _alone() -> Estimator:
    return DeadReckoning(DeadReckoningConfig())


def _of(told: Sequence[Told], group: str) -> list[Told]:
    names = GROUPS[group] if group in MOVES else (*GROUPS[group], "wheels")
    return [item for item in told if item[1] in names]


def _estimates(table: EstimateTable) -> Iterator[Told]:
    for k in range(len(table)):
        stamp_s, kind, information = float(table.stamp_s[k]), table.kind[k], table.information[k]
        a, b, turn = table.numbers[k].tolist()
        estimate: Estimate
        if kind == "motion":
            estimate = Motion(float(table.since_s[k]), stamp_s, Pose2(a, b, turn), information)
        elif kind == "fix":
            estimate = Fix(stamp_s, Pose2(a, b, turn), information)
        elif kind == "pathoffset":
            estimate = PathOffset(stamp_s, a, b, turn, information)
        else:
            estimate = Lost(stamp_s, str(table.reason[k]))
        yield float(table.arrived_s[k]), str(table.source[k]), estimate


def _lying(estimate: Estimate, begin_s: float, end_s: float) -> Estimate:
    is_lying = begin_s <= estimate.stamp_s < end_s
    if isinstance(estimate, Motion):
        was_lying = begin_s <= estimate.since_s < end_s
        aside_m = LIE_M * (is_lying - was_lying)
        pose = estimate.pose_since_now @ Pose2(0.0, aside_m, 0.0)
        return Motion(estimate.since_s, estimate.stamp_s, pose, estimate.information)
    if not is_lying:
        return estimate
    if isinstance(estimate, Fix):
        return Fix(estimate.stamp_s, estimate.pose_map_base @ Pose2(0.0, LIE_M, 0.0), estimate.information)
    if isinstance(estimate, PathOffset):
        lateral_m = estimate.lateral_m + LIE_M
        return PathOffset(estimate.stamp_s, estimate.station_m, lateral_m, estimate.heading_rad, estimate.information)
    return estimate


if __name__ == "__main__":
    main()
