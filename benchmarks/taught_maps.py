"""Straight maps: what teaching with a laser makes of an odometry, on simulated floors and recorded logs.

Everything goes through a whole run: `odometry`, `laser_icp` and the estimator `kalman`, as ``trailmark teach`` does.

- ``corridor``: 60 m of corridor without doors, there and back; ``rooms``: an office, driven for two minutes. With exact
  odometry, and with a poor one (2 % scale, half a degree a metre of drift). Error: against the truth, the path laid on
  it at its start.
- ``intel``, ``freiburg``: relative error over 1 m and 5 m of way, and root mean square error laid on the log's
  corrected poses. ``aces``: relations laid by hand (Kuemmerle et al. 2009).

``fused`` is the belief while teaching, ``taught`` where it lies after loops were closed.

    TRAILMARK_DATA=/path/to/recordings python benchmarks/taught_maps.py [corridor rooms aces ...] [--seconds 200]
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from laser_floors import Instant, box, drive, log_instants, office, scan_at
from laser_maps import print_rows
from scan_odometry import LOGS, relation_errors, relative_errors

from trailmark.arrays import Floats
from trailmark.frames import Frame, Odometry, SensorInfo
from trailmark.geometry import Pose2
from trailmark.pipeline import Pipeline
from trailmark.pipeline.teaching import closing
from trailmark.pipeline.teaching.loops import LoopSearch
from trailmark.pipeline.teaching.way_graph import Straightened

SENSORS = (SensorInfo("wheels", "odometry"), SensorInfo("laser", "scan"))


def teach(instants: Sequence[Instant], store: Path, laser: bool = True) -> tuple[list[Pose2], list[Pose2], int]:
    """Teach with what a robot saw; return the beliefs at the scans, where they lie in the end, and how many loops."""
    localizers: dict[str, Any] = {"odometry": {"plugin": "odometry", "wheels": "wheels"}}
    if laser:
        localizers["laser_icp"] = {"plugin": "laser_icp", "laser": "laser"}
    config = {
        "mode": "teach",
        "start": [0.0, 0.0, 0.0],
        "localizers": localizers,
        "estimator": {"plugin": "kalman"},
        "path_store": {"plugin": "sqlite", "path": str(store), "access": "overwrite"},
    }
    beliefs: list[Pose2] = []
    found: list[Straightened] = []
    with patch.object(closing, "LoopSearch", _kept(found)), Pipeline(config, sensors=SENSORS) as pipeline:
        first = instants[0].odometry
        for one in instants:
            pipeline.feed(Frame("wheels", one.stamp_s, Odometry(pose_start_base=first.between(one.odometry))))
            step = pipeline.feed(Frame("laser", one.stamp_s, one.scan))
            pose = step.belief.pose_map_base if step is not None else None
            beliefs.append(beliefs[-1] if pose is None else pose)
    if not found:
        return beliefs, beliefs, 0
    moved = [found[0].at_stamp(one.stamp_s, pose) for one, pose in zip(instants, beliefs)]
    return beliefs, moved, found[0].n_loops


def _kept(found: list[Straightened]) -> type[LoopSearch]:
    """Return the search for loops, which also tells what it found."""

    class KeptSearch(LoopSearch):
        def straighten(self) -> Straightened | None:
            straightened = super().straighten()
            if straightened is not None:
                found.append(straightened)
            return straightened

    return KeptSearch


def corridor(seed: int, length_m: float = 60.0) -> list[Instant]:
    """Return a drive down a corridor without doors, and back."""
    rng = np.random.default_rng([seed, 5])
    walls = np.array(box(-3.0, -1.0, length_m + 6.0, 2.0))
    ways = [*np.arange(0.0, length_m, 0.1), *([length_m] * 20), *np.arange(length_m, 0.0, -0.1)]
    turns = [*([0.0] * len(np.arange(0.0, length_m, 0.1))), *np.linspace(0.0, math.pi, 20)]
    turns += [math.pi] * (len(ways) - len(turns))
    poses = [Pose2(x, 0.0, turn) for x, turn in zip(ways, turns)]
    return [Instant(0.2 * k, pose, pose, scan_at(walls, pose, rng)) for k, pose in enumerate(poses)]


def worsened(instants: Sequence[Instant], seed: int) -> list[Instant]:
    """Return the same with a poor odometry."""
    rng = np.random.default_rng([seed, 6])
    scale, drift = 1.0 + 0.02 * rng.standard_normal(), math.radians(0.5) * rng.standard_normal()
    pose, found = Pose2(), []
    for before, now in zip([instants[0], *instants], instants):
        step = before.truth.between(now.truth)
        way_m = math.hypot(step.x, step.y)
        turn = step.theta * (1.0 + 0.03 * rng.standard_normal()) + way_m * drift
        turn += math.radians(1.0) * math.sqrt(way_m) * rng.standard_normal()
        pose = pose @ Pose2(step.x * scale + 0.02 * way_m * rng.standard_normal(), step.y * scale, turn)
        found.append(replace(now, odometry=pose))
    return found


def errors_from_start(poses: Sequence[Pose2], truth: Sequence[Pose2]) -> Floats:
    """Return the errors in position and heading, laid on the truth at its start, (N, 2) [m, rad]."""
    laid = [truth[0] @ poses[0].between(pose) for pose in poses]
    return np.array([(a.distance_to(b), abs(a.between(b).theta)) for a, b in zip(laid, truth)])


def aligned_rms(poses: Sequence[Pose2], truth: Sequence[Pose2]) -> float:
    """Return the root mean square distance to the truth, laid on it as fits best [m]."""
    at, to = (np.array([pose.array()[:2] for pose in one]) for one in (poses, truth))
    a, b = at - at.mean(axis=0), to - to.mean(axis=0)
    turn = math.atan2(float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()), float((a * b).sum()))
    cos, sin = math.cos(turn), math.sin(turn)
    return float(np.sqrt(((a @ np.array([[cos, sin], [-sin, cos]]) - b) ** 2).sum(axis=1).mean()))


def drives(name: str, data: Path, seconds: float) -> Iterator[tuple[str, list[Instant]]]:
    """Yield the drives of a name."""
    if name in LOGS:
        instants = log_instants(data / LOGS[name], **({"scan_poses": "odometry"} if name == "aces" else {}))
        yield name, [one for one in instants if one.stamp_s <= instants[0].stamp_s + seconds]
        return
    instants = corridor(1) if name == "corridor" else list(drive(office(21), 1, min(seconds, 120.0)))
    exact = [replace(one, odometry=one.truth) for one in instants]
    yield f"{name}, exact", exact
    yield f"{name}, poor", worsened(exact, 1)


def rows_of(name: str, data: Path, seconds: float) -> Iterator[dict[str, Any]]:
    """Yield a row for the wheels, the belief and the taught map of each drive."""
    for drive_name, instants in drives(name, data, seconds):
        stamps = np.array([one.stamp_s for one in instants])
        truth = [one.truth for one in instants]
        with tempfile.TemporaryDirectory() as folder:
            store = Path(folder) / "taught.trail"
            wheels, _, _ = teach(instants, store, laser=False)
            began = time.process_time()
            fused, taught, n_loops = teach(instants, store)
            cpu_s = time.process_time() - began
        for method, poses in {"wheels": wheels, "fused": fused, "taught": taught}.items():
            row: dict[str, Any] = {"drive": drive_name, "what": method, "scans": len(instants)}
            row |= {"loops": n_loops, "cpu s": f"{cpu_s:.0f}"}
            if name == "aces":
                errors = relation_errors(poses, stamps, np.loadtxt(data / "laser" / "aces.relations"))
                groups = {"relations": errors}
            else:
                groups = {f"{way_m} m": relative_errors(poses, truth, way_m) for way_m in (1, 5)}
                groups["from start"] = errors_from_start(poses, truth)
            for group, errors in groups.items():
                row[f"{group} [m]"] = f"{errors[:, 0].mean():.3f} max {errors[:, 0].max():.3f}"
                row[f"{group} [deg]"] = f"{np.degrees(errors[:, 1].mean()):.2f}"
            if name != "aces":
                row["aligned rms"] = f"{aligned_rms(poses, truth):.3f}"
            yield row


def main() -> None:
    """Print a table for each drive."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("drives", nargs="*", default=[])
    parser.add_argument("--seconds", type=float, default=200.0, help="So much of each log.")
    parser.add_argument("--markdown", action="store_true")
    arguments = parser.parse_args()
    data = Path(os.environ.get("TRAILMARK_DATA", "../shared/data"))
    for name in arguments.drives or ["corridor", "rooms", *LOGS]:
        print_rows(rows_of(name, data, arguments.seconds), arguments.markdown)


if __name__ == "__main__":
    main()
