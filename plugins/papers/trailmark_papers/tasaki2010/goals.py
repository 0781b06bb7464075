"""Table 2 and Fig. 7: to a goal from unknown starts, the camera first and then the laser."""

from __future__ import annotations

import csv
import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import ConfigError
from trailmark.experiments import ExperimentOptions, Row
from trailmark.geometry import Pose2, Trajectory, wrap_angle
from trailmark.paths import Path as TaughtPath
from trailmark.pipeline import RunResult
from trailmark_papers.kit import (
    Table,
    beside_faithful,
    collisions_of,
    largest_of,
    mean_of,
    path_of,
    run_config,
    started_source,
    truth_of,
)
from trailmark_papers.tasaki2010.place import TaughtPlace, localized_by, supermarket
from trailmark_papers.tasaki2010.plots import draw_routes

__all__ = ["GoalDrive", "drive_to_goal", "goal_rows", "random_starts"]

GOAL = (5.55, 3.11)
_ARRIVED_M, _BESIDE_M = 0.10, 0.5
#: Four trials, as in the paper, which does not say from where; at most 0.5 m beside the taught drive, as the random
#: starts: x, y [m], heading [deg].
_TRIALS = ((1.2, 7.6, -90.0), (8.8, 6.6, 90.0), (2.4, 2.2, 180.0), (5.2, 7.4, 20.0))
_PAPER_M = (0.01, 0.04, 0.06, 0.01)
_QUICK_START = (3.2, 2.3, 140.0)
_N_RANDOM = 20  # in each place
_LOOK_S, _LIMIT_S = 5.0, 120.0
_SPEED_MPS = 0.8  # the paper's robot: 1.0 m/s at most

Start = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class GoalDrive:
    """How one drive to the goal ended.

    Attributes
    ----------
    reported : bool
        The robot said that it had arrived.
    distance_m : float
        True distance from the goal where it stood at the end [m].
    way, believed : (N, 2) float64
        Where it was, and where it believed to be [m].
    n_bad : int
        Accepted fixes that were more than 0.5 m off with NEES > 16.
    worst_m : float
        Largest error of an accepted fix [m].
    collisions : int
        How often it touched something: the first time ends the drive.
    """

    reported: bool
    distance_m: float
    way: Floats
    believed: Floats
    n_bad: int
    worst_m: float
    collisions: int

    @property
    def arrived(self) -> bool:
        """It said so, it is within 0.10 m, and it touched nothing on the way."""
        return self.reported and self.distance_m <= _ARRIVED_M and not self.collisions


def goal_rows(options: ExperimentOptions, place: TaughtPlace) -> list[Row]:
    """Return the rows of Table 2 and of the random starts, and draw Fig. 7."""
    trials: Sequence[Start] = (_QUICK_START,) if options.quick else _TRIALS
    starts = [] if options.quick else random_starts(path_of(place.store), _N_RANDOM, options.seed + 300)
    calls = [
        (place.store, place.source(start=list(start)), options.seed + 300 + k, options.out / "runs" / f"goal-{k}")
        for k, start in enumerate([*trials, *starts])
    ]
    printed = [] if options.quick else [(*call[:3], call[3].with_suffix(".faithful"), "faithful") for call in calls[:4]]
    drives = options.map(drive_to_goal, [*calls, *printed])
    named, random, faithful = (
        drives[: len(trials)], drives[len(trials) : len(calls)], drives[len(calls) :],
    )  # fmt: skip
    draw_routes(options.out / "tasaki2010_fig7_routes.svg", named, GOAL)
    for k, found in enumerate(named):
        options.report(f"trial {k + 1}: {1e3 * found.distance_m:.0f} mm from the goal")
    rows = beside_faithful(
        _trial_rows(named, is_quick=options.quick), _trial_rows(faithful, is_quick=False) if faithful else []
    )
    return [*rows, *_summary(f"{len(random)} random starts", random, 98.0)] if random else rows


def _trial_rows(drives: Sequence[GoalDrive], is_quick: bool) -> list[Row]:
    """Return the rows of Table 2; the paper's figures belong to four trials."""
    table = Table("Table 2")
    for k, found in enumerate(drives):
        where = f"ended at ({found.way[-1][0]:.2f}, {found.way[-1][1]:.2f}) m"
        paper = None if is_quick else _PAPER_M[k]
        table.add(f"trial {k + 1}, distance from the goal", "m", found.distance_m, paper=paper, note=where)
    mean: dict[str, Any] = {} if is_quick else {"paper": 0.03, "bar": 0.03}
    return [*table, *_summary("Table 2", drives, 100.0, **mean)]


def _summary(name: str, drives: Sequence[GoalDrive], share: float, **mean: Any) -> Table:
    """Return the rows of some drives: `share` is the bar of those that arrived, `mean` those of the mean distance."""
    at_goal = np.array([found.distance_m for found in drives if found.reported])
    table = Table(name, len(drives), len(drives))
    table.add("true distance at reported arrival, mean", "m", mean_of(at_goal), stretch=0.01, **mean)
    table.add("true distance at reported arrival, largest", "m", largest_of(at_goal))
    arrived = [drive.arrived for drive in drives]
    table.add_share("arrived (reported, and within 0.10 m)", arrived, bar=share, stretch=100.0)
    n_bad = float(sum(drive.n_bad for drive in drives))
    table.add("accepted fixes more than 0.5 m off with NEES > 16", "", n_bad, bar=0.0)
    table.add("largest error of an accepted fix", "m", max(drive.worst_m for drive in drives))
    n_touched = float(sum(drive.collisions > 0 for drive in drives))
    table.add("drives that touched something", "", n_touched, bar=0.0)
    return table


def drive_to_goal(store: Path, source: Mapping[str, Any], seed: int, folder: Path, camera: str = "omni") -> GoalDrive:
    """Put the robot down at a place that it does not know, and let it drive."""
    drive = {"route": "round", "driver": "commands", "duration_s": _LIMIT_S}
    config = {
        "sources": {"robot": {**source, **drive}},
        **localized_by(camera),
        "controller": {
            "plugin": "goal_seeking",
            "goal": list(GOAL),
            "drive": "holonomic",
            "speed_mps": _SPEED_MPS,
            # It looks before it turns: to an omnidirectional camera most headings are alike, and beside a shelf there
            # may be no room for the corners of the base.
            "search_wait_s": _LOOK_S,
            "search_dps": 20.0,
        },
        "start": "unknown",
        "control_hz": 20,
        "seed": seed,
    }
    found = _judge_drive(run_config(config, folder, "replay", store=store))
    shutil.rmtree(folder)
    return found


def _judge_drive(result: RunResult) -> GoalDrive:
    assert result.folder is not None
    truth = truth_of(result)
    end = truth[len(truth) - 1][1]
    errors_m, nees = _accepted_fixes(result.folder / "estimates.csv", truth)
    return GoalDrive(
        reported=result.reason == "the goal is reached",
        distance_m=math.hypot(end.x - GOAL[0], end.y - GOAL[1]),
        way=truth.poses[::10, :2],
        believed=result.trajectories["fused"].poses[::10, :2],
        n_bad=int(((errors_m > 0.5) & (nees > 16.0)).sum()),
        worst_m=float(errors_m.max(initial=0.0)),
        collisions=collisions_of(result.counters),
    )


def _accepted_fixes(path: Path, truth: Trajectory) -> tuple[Floats, Floats]:
    """Return the error and the NEES of every fix that the estimator took, (N,) each."""
    errors, nees = [], []
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if row["kind"] != "fix" or row["status"] != "accepted":
                continue
            true = truth.at([float(row["stamp_s"])])[0][1]
            off = np.array([float(row["x"]) - true.x, float(row["y"]) - true.y, 0.0])
            off[2] = wrap_angle(float(row["theta"]) - true.theta)
            xx, xy, xt, yy, yt, tt = (float(row[f"info_{k}"]) for k in ("xx", "xy", "xt", "yy", "yt", "tt"))
            nees.append(float(off @ np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]]) @ off))
            errors.append(math.hypot(off[0], off[1]))
    return np.array(errors), np.array(nees)


def random_starts(path: TaughtPath, n: int, seed: int) -> list[Start]:
    """Return places at most 0.5 m beside the taught path where the robot can stand, headings all around."""
    rng = np.random.default_rng(seed)
    low, high = path.positions.min(axis=0) - _BESIDE_M, path.positions.max(axis=0) + _BESIDE_M
    starts: list[Start] = []
    while len(starts) < n:
        x, y = rng.uniform(low, high).tolist()
        heading_deg = float(rng.uniform(-180.0, 180.0))
        is_beside = np.hypot(*(path.positions - (x, y)).T).min() <= _BESIDE_M
        if is_beside and can_stand((x, y, heading_deg)):
            starts.append((x, y, heading_deg))
    return starts


def can_stand(start: Start) -> bool:
    """Return whether the robot touches nothing there."""
    try:
        with started_source(supermarket(sensors=["wheels"], start=list(start))):
            return True
    except ConfigError:
        return False


def start_pose(start: Start) -> Pose2:
    """Return a start as a pose."""
    return Pose2(start[0], start[1], math.radians(start[2]))
