"""Straight maps: what teaching with a laser makes of an odometry, on simulated floors and recorded logs.

Everything goes through a whole run: `odometry`, `laser_icp` and the estimator `kalman`, as ``trailmark teach`` does.

- ``corridor``: 60 m of corridor without doors, there and back; ``rooms``: an office, driven for two minutes. With exact
  odometry, and with a poor one (2 % scale, half a degree a metre of drift). Error: against the truth, the path laid on
  it at its start.
- ``alike``: ten drives in and out of six rooms that are all the same, 3 m apart, none of which is seen twice but from
  its own door, with three times that odometry's errors. A loop that takes one room for another looks right.
- ``intel``, ``freiburg``: relative error over 1 m and 5 m of way, and root mean square error laid on the log's
  corrected poses. ``aces``: relations laid by hand (Kuemmerle et al. 2009).

``fused`` is the belief while teaching, ``taught`` where it lies after loops were closed. A loop is ``wrong`` that is
more than 0.5 m or 10 degrees off the truth, or off the corrected poses.

    TRAILMARK_DATA=/path/to/recordings python benchmarks/taught_maps.py [corridor rooms aces ...] [--seconds 200]
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
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


@dataclass(frozen=True, slots=True)
class Loop:
    """A relation that closed a loop: from which stamp to which, and the second place as seen from the first."""

    first_s: float
    second_s: float
    measured: Pose2


@dataclass(frozen=True, slots=True, eq=False)
class Taught:
    """What a teaching leaves: the beliefs at the scans, where they lie in the end, and what closed the loops."""

    beliefs: list[Pose2]
    poses: list[Pose2]
    loops: list[Loop]


def teach(instants: Sequence[Instant], store: Path, laser: bool = True) -> Taught:
    """Teach with what a robot saw."""
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
    found: list[tuple[Straightened, list[Loop]]] = []
    with patch.object(closing, "LoopSearch", _kept(found)), Pipeline(config, sensors=SENSORS) as pipeline:
        first = instants[0].odometry
        for one in instants:
            pipeline.feed(Frame("wheels", one.stamp_s, Odometry(pose_start_base=first.between(one.odometry))))
            step = pipeline.feed(Frame("laser", one.stamp_s, one.scan))
            pose = step.belief.pose_map_base if step is not None else None
            beliefs.append(beliefs[-1] if pose is None else pose)
    if not found:
        return Taught(beliefs, beliefs, [])
    straightened, loops = found[0]
    moved = [straightened.at_stamp(one.stamp_s, pose) for one, pose in zip(instants, beliefs)]
    return Taught(beliefs, moved, loops)


def _kept(found: list[tuple[Straightened, list[Loop]]]) -> type[LoopSearch]:
    """Return the search for loops, which also tells what it found."""

    class KeptSearch(LoopSearch):
        def straighten(self) -> Straightened | None:
            straightened = super().straighten()
            if straightened is not None:
                edges, at_s = self._graph.loops, [node.stamp_s for node in self._nodes]
                ends = zip(edges.first, edges.second, edges.measured, strict=True)
                loops = [Loop(at_s[first], at_s[second], Pose2.from_array(row)) for first, second, row in ends]
                found.append((straightened, loops))
            return straightened

    return KeptSearch


def count_wrong(loops: Sequence[Loop], instants: Sequence[Instant]) -> int:
    """Return how many loops are more than 0.5 m or 10 degrees off the truth."""
    stamps = np.array([one.stamp_s for one in instants])
    n_wrong = 0
    for loop in loops:
        ends = [int(np.argmin(np.abs(stamps - at_s))) for at_s in (loop.first_s, loop.second_s)]
        off = instants[ends[0]].truth.between(instants[ends[1]].truth).between(loop.measured)
        n_wrong += math.hypot(off.x, off.y) > 0.5 or abs(off.theta) > math.radians(10.0)
    return n_wrong


def corridor(seed: int, length_m: float = 60.0) -> list[Instant]:
    """Return a drive down a corridor without doors, and back."""
    rng = np.random.default_rng([seed, 5])
    walls = np.array(box(-3.0, -1.0, length_m + 6.0, 2.0))
    ways = [*np.arange(0.0, length_m, 0.1), *([length_m] * 20), *np.arange(length_m, 0.0, -0.1)]
    turns = [*([0.0] * len(np.arange(0.0, length_m, 0.1))), *np.linspace(0.0, math.pi, 20)]
    turns += [math.pi] * (len(ways) - len(turns))
    poses = [Pose2(x, 0.0, turn) for x, turn in zip(ways, turns)]
    return [Instant(0.2 * k, pose, pose, scan_at(walls, pose, rng)) for k, pose in enumerate(poses)]


def rooms_alike(seed: int, n_rooms: int = 6) -> list[Instant]:
    """Return a drive along a corridor, into each of the rooms on it and out again; all rooms are the same."""
    rng = np.random.default_rng([seed, 9])
    width_m = 3.0
    length_m = n_rooms * width_m
    walls = [(0.0, 0.0, length_m, 0.0), (0.0, 0.0, 0.0, 2.0), (length_m, 0.0, length_m, 5.0)]
    ways = [(0.5, 1.0)]
    for x in np.arange(0.0, length_m, width_m).tolist():
        walls += [(x, 2.0, x + 1.0, 2.0), (x + 2.0, 2.0, x + 3.0, 2.0), (x, 2.0, x, 5.0), (x, 5.0, x + 3.0, 5.0)]
        walls += [(x + 0.3, 4.4, x + 0.8, 4.4), (x + 0.8, 4.4, x + 0.8, 5.0)]
        ways += [(x + 1.5, 1.0), (x + 1.5, 3.4), (x + 2.0, 3.9), (x + 1.5, 3.4), (x + 1.5, 1.0)]
    poses = _along([*ways, (length_m - 0.7, 1.0)])
    return [Instant(0.2 * k, pose, pose, scan_at(np.array(walls), pose, rng)) for k, pose in enumerate(poses)]


def _along(ways: Sequence[tuple[float, float]]) -> list[Pose2]:
    """Return poses on straight lines from place to place, 0.1 m apart, turns on the spot by 8 degrees."""
    poses = [Pose2(*ways[0], 0.0)]
    for (from_x, from_y), (x, y) in pairwise(ways):
        heading = math.atan2(y - from_y, x - from_x)
        before = poses[-1].theta
        turn = math.remainder(heading - before, 2.0 * math.pi)
        n_turns = math.ceil(abs(turn) / math.radians(8.0))
        n_steps = math.ceil(10.0 * math.hypot(x - from_x, y - from_y))
        poses += [Pose2(from_x, from_y, before + turn * k / n_turns) for k in range(1, n_turns + 1)]
        shares = [k / n_steps for k in range(1, n_steps + 1)]
        poses += [Pose2(from_x + share * (x - from_x), from_y + share * (y - from_y), heading) for share in shares]
    return poses


def worsened(instants: Sequence[Instant], seed: int, times: float = 1.0) -> list[Instant]:
    """Return the same with a poor odometry, or one whose errors are so many times as large."""
    rng = np.random.default_rng([seed, 6])
    scale, drift = 1.0 + 0.02 * times * rng.standard_normal(), math.radians(0.5) * times * rng.standard_normal()
    pose, found = Pose2(), []
    for before, now in zip([instants[0], *instants], instants):
        step = before.truth.between(now.truth)
        way_m = math.hypot(step.x, step.y)
        turn = step.theta * (1.0 + 0.03 * times * rng.standard_normal()) + way_m * drift
        turn += math.radians(1.0) * times * math.sqrt(way_m) * rng.standard_normal()
        pose = pose @ Pose2(step.x * scale + 0.02 * times * way_m * rng.standard_normal(), step.y * scale, turn)
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
    if name == "alike":
        yield from ((f"rooms alike {seed}", worsened(rooms_alike(seed), seed, 3.0)) for seed in range(10))
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
            wheels = teach(instants, store, laser=False).beliefs
            began = time.process_time()
            taught = teach(instants, store)
            cpu_s = time.process_time() - began
        n_wrong = "-" if name == "aces" else count_wrong(taught.loops, instants)
        for method, poses in {"wheels": wheels, "fused": taught.beliefs, "taught": taught.poses}.items():
            row: dict[str, Any] = {"drive": drive_name, "what": method, "scans": len(instants)}
            row |= {"loops": len(taught.loops), "wrong": n_wrong, "cpu s": f"{cpu_s:.0f}"}
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
    for name in arguments.drives or ["corridor", "rooms", "alike", *LOGS]:
        print_rows(rows_of(name, data, arguments.seconds), arguments.markdown)


if __name__ == "__main__":
    main()
