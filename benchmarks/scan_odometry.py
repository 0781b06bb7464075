"""`scan_odometry` on three recorded logs, beside the wheels of the log.

- ``aces``: 1,279 relations laid by hand on matched scans (Kuemmerle et al. 2009): error of each relation, mean absolute
  and standard deviation, and the same of those that close no loop (stamps less than 30 s apart).
- ``intel``, ``freiburg 079``: relative error over 1 m and 5 m of way against the log's corrected poses.

`alone` gets no odometry: the belief that it is asked with stands still. NEES is of single motions, by degree of
freedom.

    TRAILMARK_DATA=/path/to/recordings python benchmarks/scan_odometry.py [aces intel freiburg] [--seconds 600]
"""

from __future__ import annotations

import argparse
import math
import os
import time
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from laser_floors import Instant, log_instants
from laser_maps import SENSORS, print_rows

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


def chained(instants: Sequence[Instant], with_wheels: bool) -> tuple[list[Pose2], dict[str, float]]:
    """Return the poses of `scan_odometry`, gaps filled by the wheels, and what else there is to say."""
    localizer = trailmark.create("localizer", "scan_odometry", laser="laser")
    localizer.start(Session(sensors=SENSORS))
    pose, poses, cpu_ms, nees, n_lost = Pose2(), [Pose2()], [], [], 0
    for index, one in enumerate(instants):
        belief = Belief(one.stamp_s, pose_odom_base=one.odometry if with_wheels else Pose2())
        before = time.thread_time()
        said = localizer.observe(Frame("laser", one.stamp_s, one.scan), belief)
        cpu_ms.append(1e3 * (time.thread_time() - before))
        if index == 0:
            continue
        last = instants[index - 1]
        step = last.odometry.between(one.odometry)
        for estimate in said:
            n_lost += isinstance(estimate, Lost)
            if isinstance(estimate, Motion):
                step = estimate.pose_since_now
                error = last.truth.between(one.truth).between(step).array()
                nees.append(float(error @ estimate.information @ error) / 3.0)
        pose = pose @ step
        poses.append(pose)
    numbers = {"lost": n_lost, "ms": float(np.median(cpu_ms)), "nees": float(np.median(nees)) if nees else math.nan}
    return poses, numbers


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


def rows_of(name: str, data: Path, seconds: float) -> Iterator[dict[str, Any]]:
    """Yield a row for each way to get a motion."""
    options = {"scan_poses": "odometry"} if name == "aces" else {}
    instants = log_instants(data / LOGS[name], **options)
    instants = [one for one in instants if one.stamp_s <= instants[0].stamp_s + seconds]
    wheels = [instants[0].odometry.between(one.odometry) for one in instants]
    methods: dict[str, tuple[list[Pose2], dict[str, float]]] = {"wheels": (wheels, {})}
    methods["scan_odometry"] = chained(instants, True)
    methods["scan_odometry alone"] = chained(instants, False)
    stamps = np.array([one.stamp_s for one in instants])
    for method, (poses, numbers) in methods.items():
        row: dict[str, Any] = {"log": name, "method": method, "scans": len(instants)}
        if name == "aces":
            relations = np.loadtxt(data / "laser" / "aces.relations")
            near = relations[np.abs(relations[:, 1] - relations[:, 0]) < 30.0]
            groups = {"all": relation_errors(poses, stamps, relations), "near": relation_errors(poses, stamps, near)}
        else:
            truth = [one.truth for one in instants]
            groups = {f"{way_m} m": relative_errors(poses, truth, way_m) for way_m in (1, 5)}
        for group, errors in groups.items():
            row |= {
                f"{group} n": len(errors),
                f"{group} [m]": f"{errors[:, 0].mean():.3f} +- {errors[:, 0].std():.3f}",
                f"{group} [deg]": f"{np.degrees(errors[:, 1].mean()):.2f} +- {np.degrees(errors[:, 1].std()):.2f}",
            }
        row |= {"lost": int(numbers.get("lost", 0)), "median NEES": f"{numbers.get('nees', math.nan):.2f}"}
        yield row | {"median ms": f"{numbers.get('ms', math.nan):.1f}"}


def main() -> None:
    """Print a table for each log."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", default=[])
    parser.add_argument("--seconds", type=float, default=math.inf, help="So much of each log.")
    parser.add_argument("--markdown", action="store_true")
    arguments = parser.parse_args()
    data = Path(os.environ.get("TRAILMARK_DATA", ""))
    for name in arguments.logs or list(LOGS):
        print_rows(rows_of(name, data, arguments.seconds), arguments.markdown)


if __name__ == "__main__":
    main()
