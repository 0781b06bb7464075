"""laser_icp from an unknown start: within a taught place, on recordings, how often it answers and is right.

    python benchmarks/laser_start.py [--starts 80]

Map: every other scan of a log at its corrected pose, as teaching keeps them. The others are the robot: put down at
starts all over the log, it drives on for at most 15 scans at least 0.15 m or 10 deg apart, with the log's motion, 1 %
too long and 1 deg a metre askew. The recordings are not shipped (``TRAILMARK_DATA``, or ``../shared/data``).
"""

from __future__ import annotations

import argparse
import gzip
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from trailmark.estimates import Belief, Fix
from trailmark.frames import Frame, Scan, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import LocalizerMap, Session
from trailmark.testing import MemoryMap
from trailmark_omni_surf.laser.config import LaserIcpConfig
from trailmark_omni_surf.laser.localizer import LaserIcp

LOGS = ("freiburg-079", "intel")
_MOST_SCANS, _MOVED_M, _MOVED_RAD = 15, 0.15, math.radians(10.0)
_RIGHT_M, _RIGHT_DEG = 0.3, 5.0


def read_log(file: Path) -> list[tuple[Scan, Pose2]]:
    """Return the scans of a CARMEN log and their corrected poses."""
    found = []
    with gzip.open(file, "rt", errors="ignore") as lines:
        for fields in map(str.split, lines):
            if fields and fields[0] == "FLASER":
                n = int(fields[1])
                ranges = np.array(fields[2 : 2 + n], dtype=np.float64)
                step_rad = math.radians(180.0 / (180 if n <= 181 else 360))
                pose = Pose2(*map(float, fields[2 + n : 5 + n]))
                found.append((Scan(ranges, -math.pi / 2.0, step_rad, 0.05, 80.0), pose))
    return found


def teach(scans: list[tuple[Scan, Pose2]]) -> LocalizerMap:
    """Remember scans at poses that are known."""
    localizer_map = MemoryMap()
    localizer = started("teach", localizer_map)
    way_m, last = 0.0, scans[0][1]
    for k, (scan, pose) in enumerate(scans):
        way_m, last = way_m + last.distance_to(pose), pose
        localizer.observe(Frame("laser", float(k), scan), Belief(float(k), pose, travelled_m=way_m))
    localizer.finish()
    return localizer_map


def started(mode: str, localizer_map: LocalizerMap) -> LaserIcp:
    """Return a localizer that believes the poses it is told."""
    localizer = LaserIcp(LaserIcpConfig(laser="laser", correct_while_teaching=False))
    sensors = {"laser": SensorInfo("laser", "scan")}
    localizer.start(Session(name="laser", mode=mode, sensors=sensors, map=localizer_map))  # type: ignore[arg-type]
    return localizer


class Answer(NamedTuple):
    """What a robot was told first: after how many scans and which way, and how far off that is."""

    n_scans: float
    way_m: float
    off_m: float
    off_deg: float
    nees: float
    """Of one degree of freedom."""


def answer_from(localizer: LaserIcp, scans: list[tuple[Scan, Pose2]]) -> Answer | None:
    """Drive on from a start until an answer."""
    odom, way_m, before, n_seen = Pose2(), 0.0, scans[0][1], 0
    for k, (scan, pose) in enumerate(scans):
        moved = before.between(pose)
        if k and math.hypot(moved.x, moved.y) < _MOVED_M and abs(moved.theta) < _MOVED_RAD:
            continue
        step_m = math.hypot(moved.x, moved.y)
        odom = odom @ Pose2(1.01 * moved.x, 1.01 * moved.y, moved.theta + math.radians(1.0) * step_m)
        way_m, before, n_seen = way_m + step_m, pose, n_seen + 1
        if n_seen > _MOST_SCANS:
            return None
        (answer,) = localizer.observe(Frame("laser", float(k), scan), Belief(float(k), pose_odom_base=odom))
        if isinstance(answer, Fix):
            told = answer.pose_map_base
            error = np.array([told.x - pose.x, told.y - pose.y, pose.between(told).theta])
            nees = float(error @ answer.information @ error) / 3.0
            return Answer(n_seen, way_m, math.hypot(*error[:2]), abs(math.degrees(error[2])), nees)
    return None


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--starts", type=int, default=80, help="starts in each log")
    options = parser.parse_args()
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("TRAILMARK_DATA", beside)) / "omni" / "laser2d_carmen"
    print("| log | starts | answered | wrong | scans until then, median / 90 % | way [m], median / 90 % ", end="")
    print("| off, median / most [m] | [deg] | NEES, mean | NEES, median |")
    print("|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|")
    for name in LOGS:
        scans = read_log(folder / f"{name}-corrected.log.gz")
        localizer_map, driven = teach(scans[0::2]), scans[1::2]
        firsts = np.linspace(0, len(driven) - 30, options.starts).astype(int).tolist()
        told = [answer_from(started("replay", localizer_map), driven[first:]) for first in firsts]
        print(_row(name, len(told), [one for one in told if one is not None]), flush=True)


def _row(name: str, n_starts: int, told: Sequence[Answer]) -> str:
    if not told:
        return f"| {name} | {n_starts} | 0 % | 0 |" + " - |" * 6
    n_scans, way_m, off_m, off_deg, nees = np.array(told).T
    n_wrong = int(((off_m > _RIGHT_M) | (off_deg > _RIGHT_DEG)).sum())
    cells = (
        f"{100.0 * len(told) / n_starts:.0f} %",
        f"{n_wrong}",
        f"{np.median(n_scans):.0f} / {np.quantile(n_scans, 0.9):.0f}",
        f"{np.median(way_m):.2f} / {np.quantile(way_m, 0.9):.2f}",
        f"{np.median(off_m):.3f} / {off_m.max():.3f}",
        f"{np.median(off_deg):.2f} / {off_deg.max():.2f}",
        f"{nees.mean():.2f}",
        f"{np.median(nees):.2f}",
    )
    return f"| {name} | {n_starts} | {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
