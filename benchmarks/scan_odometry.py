"""`scan_odometry` on recorded logs and simulated floors, beside the wheels, small_gicp and kiss-icp.

- ``aces``: 1,279 relations laid by hand on matched scans (Kuemmerle et al. 2009): error of each relation, mean absolute
  and standard deviation, and the same of those that close no loop (stamps less than 30 s apart).
- ``intel``, ``freiburg``: relative error over 1 s (or to the next scan, where that is later), 1 m and 5 m of way
  against the log's corrected poses.
- ``floors``: the same on simulated floors, where the truth is exact.

`alone` gets no odometry: the belief that it is asked with stands still. NEES is of single motions, by degree of
freedom, mean. Corrected poses err themselves, often more than a match: `own error counted` adds their covariance, which
is told from three estimates of every step (three-cornered hat, Gray & Allan 1974): theirs, and those of the two halves
of the rays alone. Peers that are not installed are skipped with a reason (``pip install small_gicp kiss-icp``).

    TRAILMARK_DATA=/path/to/recordings python benchmarks/scan_odometry.py [aces intel freiburg floors] [--seconds 600]
"""

from __future__ import annotations

import argparse
import math
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from laser_floors import Instant, drive, log_instants, office, store_hall
from laser_maps import SENSORS, print_rows
from scan_odometry_peers import PEERS, why_missing

import trailmark
from trailmark.arrays import Floats
from trailmark.estimates import Belief, Lost, Motion
from trailmark.frames import Frame
from trailmark.geometry import Pose2
from trailmark.interfaces import Session

LOGS = {
    "aces": "laser/aces.clf.bz2",
    "intel": "omni/laser2d_carmen/intel-corrected.log.gz",
    "freiburg": "omni/laser2d_carmen/freiburg-079-corrected.log.gz",
}


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """A motion that was told: from which instant on, how far, and its information (3, 3)."""

    since: int
    pose: Pose2
    information: Floats


def steps_of(instants: Sequence[Instant], with_wheels: bool) -> tuple[dict[int, Step], dict[str, float]]:
    """Return the motion to each instant that `scan_odometry` tells, and how often it is lost and how long it takes."""
    localizer = trailmark.create("localizer", "scan_odometry", laser="laser")
    localizer.start(Session(sensors=SENSORS))
    index_at = {one.stamp_s: index for index, one in enumerate(instants)}
    steps, cpu_ms, n_lost = dict[int, Step](), [], 0
    for index, one in enumerate(instants):
        belief = Belief(one.stamp_s, pose_odom_base=one.odometry if with_wheels else Pose2())
        before = time.thread_time()
        said = localizer.observe(Frame("laser", one.stamp_s, one.scan), belief)
        cpu_ms.append(1e3 * (time.thread_time() - before))
        for estimate in said:
            n_lost += isinstance(estimate, Lost)
            if isinstance(estimate, Motion):
                steps[index] = Step(index_at[estimate.since_s], estimate.pose_since_now, estimate.information)
    return steps, {"lost": n_lost, "ms": float(np.median(cpu_ms))}


def chained(
    instants: Sequence[Instant], with_wheels: bool, truth_sigmas: Floats | None = None
) -> tuple[list[Pose2], dict[str, float]]:
    """Return the poses of `scan_odometry`, gaps filled by the wheels, and what else there is to say."""
    steps, numbers = steps_of(instants, with_wheels)
    poses = [Pose2()]
    for index in range(1, len(instants)):
        wheels = instants[index - 1].odometry.between(instants[index].odometry)
        step = steps.get(index)
        poses.append(poses[-1] @ wheels if step is None else poses[step.since] @ step.pose)
    numbers["nees"] = mean_nees(instants, steps, np.zeros(3))
    if truth_sigmas is not None:
        numbers["nees counted"] = mean_nees(instants, steps, truth_sigmas)
    return poses, numbers


def mean_nees(instants: Sequence[Instant], steps: dict[int, Step], truth_sigmas: Floats) -> float:
    """Return the mean of the squared errors in units of what is told, a degree of freedom."""
    found = []
    for index, step in steps.items():
        error = _difference(step.pose, instants[step.since].truth.between(instants[index].truth))
        told = step.information
        both = told @ np.linalg.inv(np.eye(3) + np.diag(np.square(truth_sigmas)) @ told)
        found.append(float(error @ both @ error) / max(int(np.linalg.matrix_rank(told)), 1))
    return float(np.mean(found)) if found else math.nan


def sigmas_of_truth(instants: Sequence[Instant]) -> Floats:
    """Return how far single steps of corrected poses are off, (3,) [m, m, rad], by a three-cornered hat.

    The other two are `scan_odometry` with every other three rays, and with those between. What all rays have wrong in
    common counts as the poses' error. Scales are by the median, so that single failures say nothing.
    """
    halves = [steps_of([_with_rays(one, half) for one in instants], True)[0] for half in (0, 1)]
    both = [n for n in sorted(set(halves[0]) & set(halves[1])) if halves[0][n].since == halves[1][n].since == n - 1]
    first, second = ([half[index].pose for index in both] for half in halves)
    true = [instants[index - 1].truth.between(instants[index].truth) for index in both]
    variances = [_robust_variance(a, b) for a, b in ((first, true), (second, true), (first, second))]
    return np.sqrt(np.maximum(variances[0] + variances[1] - variances[2], 0.0) / 2.0)


def _with_rays(instant: Instant, half: int) -> Instant:
    ranges = np.array(instant.scan.ranges_m)
    ranges[(np.arange(len(ranges)) // 3) % 2 != half] = math.nan
    return replace(instant, scan=replace(instant.scan, ranges_m=ranges))


def _robust_variance(ones: Sequence[Pose2], others: Sequence[Pose2]) -> Floats:
    differences = np.array([_difference(a, b) for a, b in zip(ones, others)])
    return np.square(1.4826 * np.median(np.abs(differences), axis=0))


def _difference(said: Pose2, true: Pose2) -> Floats:
    error = said.array() - true.array()
    error[2] = math.remainder(error[2], 2.0 * math.pi)
    return error


def relation_errors(poses: Sequence[Pose2], stamps: Floats, relations: Floats) -> Floats:
    """Return the errors of relations (R, 8), in translation and rotation, (R, 2) [m, rad]."""
    found = []
    for start_s, stop_s, x, y, _, _, _, yaw in relations:
        a, b = (int(np.argmin(np.abs(stamps - stamp))) for stamp in (start_s, stop_s))
        if abs(stamps[a] - start_s) > 1e-3 or abs(stamps[b] - stop_s) > 1e-3:
            continue
        off = Pose2(x, y, yaw).inverse() @ poses[a].between(poses[b])
        found.append((math.hypot(off.x, off.y), abs(off.theta)))
    return np.array(found)


def relative_errors(poses: Sequence[Pose2], truth: Sequence[Pose2], way_m: float) -> Floats:
    """Return the errors over every stretch of so much way, (R, 2) [m, rad]."""
    steps = [a.distance_to(b) for a, b in pairwise(truth)]
    stations = np.concatenate([[0.0], np.cumsum(steps)])
    found = []
    for start in range(len(truth)):
        stop = int(np.searchsorted(stations, stations[start] + way_m))
        if stop >= len(truth):
            break
        off = truth[start].between(truth[stop]).between(poses[start].between(poses[stop]))
        found.append((math.hypot(off.x, off.y), abs(off.theta)))
    return np.array(found)


def errors_after(poses: Sequence[Pose2], truth: Sequence[Pose2], stamps: Floats, after_s: float) -> Floats:
    """Return the errors from each scan to the first that comes so much later, (R, 2) [m, rad]."""
    stops = np.searchsorted(stamps, stamps + after_s - 1e-3)
    found = []
    for start, stop in enumerate(stops):
        if stop < len(truth):
            off = truth[start].between(truth[stop]).between(poses[start].between(poses[stop]))
            found.append((math.hypot(off.x, off.y), abs(off.theta)))
    return np.array(found)


def drives(name: str, data: Path, seconds: float) -> Iterator[tuple[str, list[Instant]]]:
    """Yield the drives of a name."""
    if name == "floors":
        for floor in (office(11), office(12, n_people=5), store_hall(11, n_people=3)):
            yield floor.name, list(drive(floor, 1, min(seconds, 120.0)))
        return
    instants = log_instants(data / LOGS[name], **({"scan_poses": "odometry"} if name == "aces" else {}))
    yield name, [one for one in instants if one.stamp_s <= instants[0].stamp_s + seconds]


Told = tuple[list[Pose2], dict[str, float]]


def methods_of(name: str, instants: Sequence[Instant]) -> Iterator[tuple[str, Told | str]]:
    """Yield each way to get a motion with its poses and numbers, or why it is left out."""
    yield "wheels", ([instants[0].odometry.between(one.odometry) for one in instants], {})
    sigmas = sigmas_of_truth(instants) if name in ("intel", "freiburg") else None
    yield "scan_odometry", chained(instants, True, sigmas)
    yield "scan_odometry alone", chained(instants, False, sigmas)
    for peer, module, run in PEERS:
        reason = why_missing(module)
        yield peer, reason or run(instants)


def rows_of(name: str, data: Path, seconds: float) -> Iterator[dict[str, Any]]:
    """Yield a row for each way to get a motion."""
    for drive_name, instants in drives(name, data, seconds):
        stamps = np.array([one.stamp_s for one in instants])
        truth = [one.truth for one in instants]
        for method, told in methods_of(name, instants):
            row: dict[str, Any] = {"log": drive_name, "method": method, "scans": len(instants)}
            if isinstance(told, str):
                yield row | {"skipped": told}
                continue
            poses, numbers = told
            if name == "aces":
                relations = np.loadtxt(data / "laser" / "aces.relations")
                near = relations[np.abs(relations[:, 1] - relations[:, 0]) < 30.0]
                groups = {
                    "all": relation_errors(poses, stamps, relations),
                    "near": relation_errors(poses, stamps, near),
                }
            else:
                groups = {"1 s": errors_after(poses, truth, stamps, 1.0)}
                groups |= {f"{way_m} m": relative_errors(poses, truth, way_m) for way_m in (1, 5)}
            for group, errors in groups.items():
                row |= {
                    f"{group} n": len(errors),
                    f"{group} [m]": f"{errors[:, 0].mean():.3f} +- {errors[:, 0].std():.3f}",
                    f"{group} [deg]": f"{np.degrees(errors[:, 1].mean()):.2f} +- {np.degrees(errors[:, 1].std()):.2f}",
                }
            row["lost"] = numbers.get("lost", "-")
            if name != "aces":
                row |= {"NEES": _two_digits(numbers, "nees"), "own error counted": _two_digits(numbers, "nees counted")}
            yield row | {"median ms": _two_digits(numbers, "ms")}


def _two_digits(numbers: dict[str, float], key: str) -> str:
    return f"{numbers[key]:.2f}" if key in numbers else "-"


def main() -> None:
    """Print a table for each log."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", default=[])
    parser.add_argument("--seconds", type=float, default=math.inf, help="So much of each log.")
    parser.add_argument("--markdown", action="store_true")
    arguments = parser.parse_args()
    data = Path(os.environ.get("TRAILMARK_DATA", ""))
    for name in arguments.logs or [*LOGS, "floors"]:
        print_rows(rows_of(name, data, arguments.seconds), arguments.markdown)


if __name__ == "__main__":
    main()
