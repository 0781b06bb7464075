"""`grid_mcl` on maps of simulated floors and of recorded logs.

- ``start``: nothing known, 15 s of driving. Found: the last answer is a fix within 0.5 m and 15 deg. Wrong: any fix
  that is not.
- ``kidnap``: followed for 10 s, then elsewhere on the same floor while the odometry goes on.
- ``track``: errors of all fixes of drives of a minute from a known start, against the truth; CPU time a scan.

Floors that are ``changed`` have doors shut and furniture moved since they were mapped. `--seeds choose` are those on
which parameters were chosen, `--seeds report` are others. Times are CPU time of the calling thread.

    TRAILMARK_DATA=/path/to/recordings python benchmarks/laser_maps.py [start kidnap track] [--starts 20] [--markdown]
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from laser_floors import (
    Floor,
    Instant,
    drive,
    log_instants,
    map_of,
    office,
    store_hall,
    symmetric_corridor,
)

import trailmark
from trailmark.estimates import Belief, Fix
from trailmark.frames import Frame, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark_laser_maps.carving import PlacedScan, carve_grid
from trailmark_laser_maps.grid import OccupancyGrid
from trailmark_laser_maps.map_yaml import write_map

RIGHT_M, RIGHT_RAD = 0.5, math.radians(15.0)
WITHIN_S = 15.0
SENSORS = {"laser": SensorInfo("laser", "scan")}


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What was said at one instant; None where the localizer was lost."""

    stamp_s: float
    error: tuple[float, float] | None
    cpu_ms: float
    quality: float = math.nan
    nees: float = math.nan

    @property
    def is_right(self) -> bool:
        return self.error is not None and self.error[0] <= RIGHT_M and self.error[1] <= RIGHT_RAD

    @property
    def is_wrong(self) -> bool:
        return self.error is not None and not self.is_right


def answers(instants: Iterable[Instant], map_file: Path, seed: int, start: Pose2 | None = None) -> list[Answer]:
    """Return what `grid_mcl` says over a drive."""
    localizer = trailmark.create("localizer", "grid_mcl", laser="laser", map=map_file)
    rng = np.random.default_rng(seed)
    localizer.start(Session(sensors=SENSORS, rng=rng, start_pose=start))
    said = []
    for instant in instants:
        belief = Belief(instant.stamp_s, pose_odom_base=instant.odometry)
        before = time.thread_time()
        estimates = localizer.observe(Frame("laser", instant.stamp_s, instant.scan), belief)
        cpu_ms = 1e3 * (time.thread_time() - before)
        for estimate in estimates:
            if not isinstance(estimate, Fix):
                said.append(Answer(instant.stamp_s, None, cpu_ms))
                continue
            off = instant.truth.between(estimate.pose_map_base)
            error = estimate.pose_map_base.array() - instant.truth.array()
            error[2] = math.remainder(error[2], 2.0 * math.pi)
            nees = float(error @ estimate.information @ error) / 3.0
            told = (math.hypot(off.x, off.y), abs(off.theta))
            said.append(Answer(instant.stamp_s, told, cpu_ms, estimate.details["quality"], nees))
    return said


@dataclass(frozen=True, slots=True)
class Building:
    """A map, and drives in it by seed."""

    name: str
    map_file: Path
    drives: Any
    is_ambiguous: bool = False


def buildings(seeds: str, folder: Path, data: Path) -> Iterator[Building]:
    """Yield the floors of one set of seeds, and the logs (the halves of a log are one set each)."""
    chosen = seeds == "choose"
    a, b = (1, 2) if chosen else (11, 12)
    floors = [
        office(a),
        office(b, n_people=5),
        office(a + 2, changed=True, n_people=3),
        store_hall(a, n_people=3),
        symmetric_corridor(4 if chosen else 5),
    ]
    for floor in floors:
        path = folder / f"{floor.name.replace(' ', '_')}.yaml"
        write_map(path, map_of(floor))
        yield Building(floor.name, path, _drives_on(floor, 0 if chosen else 1000), "symmetric" in floor.name)
    logs = {"intel": "omni/laser2d_carmen/intel-corrected.log.gz"} if chosen else LOGS
    for name, where in logs.items():
        instants = log_instants(data / where)
        path = folder / f"{name}.yaml"
        write_map(path, _map_of_log(instants[::2]))
        yield Building(name, path, _drives_in(instants[1::2]))


LOGS = {
    "freiburg 079": "omni/laser2d_carmen/freiburg-079-corrected.log.gz",
}


def _map_of_log(instants: Sequence[Instant]) -> OccupancyGrid:
    return carve_grid(PlacedScan.at(one.truth, one.scan.points(), (0.0, 0.0)) for one in instants)


def _drives_on(floor: Floor, first_seed: int) -> Any:
    return lambda seed, duration_s: list(drive(floor, first_seed + seed, duration_s))


def _drives_in(instants: Sequence[Instant]) -> Any:
    def part(seed: int, duration_s: float) -> list[Instant]:
        """Return a part of the log in which the robot drives: time at rest does not count."""
        rng = np.random.default_rng([seed, 4])
        at = int(rng.integers(len(instants) - 60))
        chosen: list[Instant] = []
        gone_s = 0.0
        for before, now in zip(instants[at:], instants[at + 1 :]):
            step = before.odometry.between(now.odometry)
            dt_s = now.stamp_s - before.stamp_s
            gone_s += min(dt_s, 1.0) if math.hypot(step.x, step.y) > 0.01 or abs(step.theta) > 0.01 else 0.0
            chosen.append(replace(now, stamp_s=gone_s))
            if gone_s > duration_s:
                break
        return chosen

    return part


def start_rows(building: Building, n_starts: int) -> dict[str, Any]:
    """Return how often a place is found from nothing."""
    found, wrong, after_s, first_ms, later_ms, n_lost = 0, 0, [], [], [], 0
    for seed in range(n_starts):
        said = answers(building.drives(seed, WITHIN_S), building.map_file, seed)
        found += bool(said) and said[-1].is_right
        wrong += any(answer.is_wrong for answer in said)
        n_lost += all(answer.error is None for answer in said)
        after_s += [next((answer.stamp_s for answer in said if answer.is_right), math.nan)]
        first_ms.append(said[0].cpu_ms)
        later_ms += [answer.cpu_ms for answer in said[1:]]
    return {
        "what": "start",
        "where": building.name,
        "n": n_starts,
        "found": f"{found / n_starts:.0%}",
        "wrong": wrong,
        "always lost": n_lost,
        "median s": f"{np.nanmedian(after_s):.1f}" if np.isfinite(after_s).any() else "-",
        "first ms": f"{np.median(first_ms):.0f}",
        "later ms": f"{np.median(later_ms):.1f}",
    }


def kidnap_rows(building: Building, n_starts: int) -> dict[str, Any]:
    """Return how often a robot that is carried away knows it, and finds itself again."""
    lost, found, wrong_s, n_wrong = 0, 0, [], 0
    for seed in range(n_starts):
        before, after = building.drives(seed, 10.0), building.drives(seed + 500, WITHIN_S)
        shift = before[-1].odometry @ after[0].odometry.inverse()
        carried_s = before[-1].stamp_s + 0.2
        after = [
            replace(one, stamp_s=one.stamp_s - after[0].stamp_s + carried_s, odometry=shift @ one.odometry)
            for one in after
        ]
        said = [
            answer
            for answer in answers([*before, *after], building.map_file, seed, before[0].truth)
            if answer.stamp_s >= carried_s
        ]
        lost += any(answer.error is None for answer in said)
        wrong = [answer.stamp_s - carried_s for answer in said if answer.is_wrong]
        n_wrong += bool(wrong)
        wrong_s.append(max(wrong, default=0.0))
        found += bool(said) and said[-1].is_right
    return {
        "what": "kidnap",
        "where": building.name,
        "n": n_starts,
        "found": f"{found / n_starts:.0%}",
        "lost in between": f"{lost / n_starts:.0%}",
        "wrong": n_wrong,
        "last wrong after s": f"{max(wrong_s):.1f}",
    }


def track_rows(building: Building, n_starts: int) -> dict[str, Any]:
    """Return the errors over drives of a minute from a known start."""
    said = []
    for seed in range(max(1, n_starts // 5)):
        instants = building.drives(seed + 200, 60.0)
        said += answers(instants, building.map_file, seed, instants[0].truth)[5:]
    errors = np.array([answer.error for answer in said if answer.error is not None])
    rms = np.sqrt(np.square(errors).mean(axis=0)) if len(errors) else (math.nan, math.nan)
    return {
        "what": "track",
        "where": building.name,
        "n": len(said),
        "fixes": f"{len(errors) / max(len(said), 1):.0%}",
        "rms mm": f"{1e3 * rms[0]:.1f}",
        "rms deg": f"{math.degrees(rms[1]):.2f}",
        "max m": f"{errors[:, 0].max():.3f}" if len(errors) else "-",
        "nees": f"{np.nanmean([answer.nees for answer in said]):.2f}",
        "quality": f"{np.nanmean([answer.quality for answer in said]):.2f}",
        "median ms": f"{np.median([answer.cpu_ms for answer in said]):.1f}",
        "p99 ms": f"{np.percentile([answer.cpu_ms for answer in said], 99):.1f}",
    }


EXPERIMENTS = {"start": start_rows, "kidnap": kidnap_rows, "track": track_rows}


def main() -> None:
    """Print tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("experiments", nargs="*", default=[])
    parser.add_argument("--seeds", choices=("choose", "report"), default="report")
    parser.add_argument("--starts", type=int, default=20)
    parser.add_argument("--only", default="", help="Buildings whose name contains this.")
    parser.add_argument("--markdown", action="store_true")
    arguments = parser.parse_args()
    data = Path(os.environ.get("TRAILMARK_DATA", ""))
    chosen = arguments.experiments or list(EXPERIMENTS)
    with tempfile.TemporaryDirectory() as folder:
        places = [place for place in buildings(arguments.seeds, Path(folder), data) if arguments.only in place.name]
        for name in chosen:
            rows = (EXPERIMENTS[name](place, arguments.starts) for place in places)
            print_rows(rows, arguments.markdown)


def print_rows(rows: Iterable[dict[str, Any]], is_markdown: bool) -> None:
    """Print rows as they come, with the first one's keys above; a row that has less (what was not run) ends early."""
    mark, keys = ("| " if is_markdown else ""), None
    for row in rows:
        if keys is None:
            keys = list(row)
            print(f"{mark}{' | '.join(keys)}{mark and ' |'}")
            if mark:
                print("|" + "---|" * len(keys))
        print(f"{mark}{' | '.join(str(row.get(key, '')) for key in keys)}{mark and ' |'}", flush=True)
    print()


if __name__ == "__main__":
    main()
