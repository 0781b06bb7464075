"""Teach and replay of a simulated robot through ROS 2 topics, and without ROS: how far off its path does it run?

The robot is a program of its own (`trailmark ros2 robot`): a differential vehicle with a floor camera and wheels, which
sends /floor/image_raw and /wheels/odom and follows /cmd_vel. `ground_vo` and wheels localize, `path_tracking` drives.
What the offset is made of is told apart: how far beside its path the robot believed to be, which is what delays can
change, and how far teaching and replay turned away from the truth.

    python benchmarks/ros2_closed_loop.py [--runs 3] [--seconds 20] [--pace 1.0]
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML

import trailmark
from trailmark.geometry import Trajectory, read_tum

CAMERA: dict[str, Any] = {"width": 320, "height": 288, "field_mm": [125.0, 112.5]}
ROBOT: dict[str, Any] = {
    "plugin": "sim",
    "world": "ground_course",
    "route": "indoor",
    "sensors": ["wheels", "floor"],
    "rates_hz": {"wheels": 30, "floor": 30},
    "speed_mps": 0.2,
    "vehicle": {"kind": "differential", "length_m": 0.3, "width_m": 0.3},
    "options": {"camera": CAMERA},
}
LOCAL: dict[str, Any] = {
    "localizers": {"wheels": {"plugin": "odometry", "wheels": "wheels"}, "floor": {"plugin": "ground_vo"}},
    "estimator": {"plugin": "kalman"},
    # ground_vo and wheels give motion alone: no fix is waited for
    "controller": {"plugin": "path_tracking", "speed_mps": 0.2, "max_fix_age_m": None, "reverse": False},
    "control_hz": 20,
}
#: What no topic says: how the floor camera is mounted, and how large its pixels are.
SENSORS = {
    "floor": {
        "mounting": {"yaw_deg": 180.0},
        "calibration": {"metres_per_pixel": 125.0e-3 / CAMERA["width"]},
    }
}
REPLAY_S = 90.0
HEAD = """| run | way | mean [mm] | largest [mm] | off the end [mm] | beside its path as believed [mm] \
| turned too far, teaching [deg] | replay [deg] | end of the replay |
|--:|---|--:|--:|--:|--:|--:|--:|---|"""


def live(domain: int) -> dict[str, Any]:
    """Return the source that hears the robot."""
    return {
        "plugin": "ros2",
        "domain": domain,
        "topics": {"floor": "/floor/image_raw", "wheels": "/wheels/odom"},
        "command": "/cmd_vel",
        "end_when_silent_s": 3.0,
    }


@dataclass(frozen=True)
class Drive:
    """The way of a robot: where it was, and where it believed to be."""

    true: Trajectory
    believed: Trajectory
    reason: str

    @property
    def drift_deg(self) -> float:
        """How much more it believed to have turned than it had, from its first place to its last [deg]."""
        true, believed = (np.unwrap(way.headings) for way in (self.true, self.believed))
        return float(np.degrees((believed[-1] - believed[0]) - (true[-1] - true[0])))


def without_ros(folder: Path, seconds: float, seed: int) -> tuple[Drive, Drive]:
    """Return the drives of teaching and of replay."""
    config = {"sources": {"robot": ROBOT | {"duration_s": seconds}}, "sensors": SENSORS, **LOCAL, "seed": seed}
    config |= {"start": [0.0, 0.0, 0.0]}
    store = folder / "path.trail"
    taught = trailmark.run(config, folder / "teach", mode="teach", store=store, report=False)
    again = config | {"sources": {"robot": ROBOT | {"duration_s": REPLAY_S}}, "start": "first"}
    driven = trailmark.run(again, folder / "replay", mode="replay", store=store, report=False)
    assert taught.ground_truth is not None
    assert driven.ground_truth is not None
    return tuple(Drive(r.ground_truth, r.trajectories["fused"], r.reason or r.status) for r in (taught, driven))


def through_topics(folder: Path, seconds: float, seed: int, *, domain: int, pace: float = 1.0) -> tuple[Drive, Drive]:
    """Return the same of a robot behind topics."""
    store, drives = folder / "path.trail", []
    for mode, limit_s, start in (("teach", seconds, [0.0, 0.0, 0.0]), ("replay", REPLAY_S, "first")):
        robot = folder / f"robot_{mode}.yaml"
        with robot.open("w") as file:
            YAML().dump({"sources": {"robot": ROBOT | {"duration_s": limit_s}}, **LOCAL, "seed": seed}, file)
        line = [sys.executable, "-m", "trailmark.cli", "ros2", "robot", str(robot), "--mode", mode]
        line += ["--domain", str(domain), "--truth", str(folder / f"{mode}.tum"), "--pace", str(pace)]
        with subprocess.Popen(line, stdout=subprocess.DEVNULL) as node:
            config = {"sources": {"robot": live(domain)}, "sensors": SENSORS, **LOCAL, "start": start}
            result = trailmark.run(config, folder / mode, mode=mode, store=store, report=False)
            node.terminate() if mode == "replay" else None  # it writes where it was
            node.wait(60.0)
        believed, reason = result.trajectories["fused"], result.reason or result.status
        drives.append(Drive(read_tum(folder / f"{mode}.tum"), believed, reason))
    return drives[0], drives[1]


def off_mm(taught: Trajectory, driven: Trajectory) -> np.ndarray:
    """Return how far from the way of teaching each place of the replay was, (N,)."""
    way = taught.positions[np.append(True, np.linalg.norm(np.diff(taught.positions, axis=0), axis=1) > 1e-5)]
    a, b = way[:-1, None], way[1:, None]
    along = b - a
    share = np.clip(((driven.positions[None] - a) * along).sum(2) / (along**2).sum(2), 0.0, 1.0)
    return np.asarray(1e3 * np.linalg.norm(driven.positions[None] - a - share[..., None] * along, axis=2).min(0))


def cells(taught: Drive, driven: Drive) -> str:
    """Return one row of the table."""
    off, believed = off_mm(taught.true, driven.true), off_mm(taught.believed, driven.believed)
    end = 1e3 * np.linalg.norm(taught.true.positions[-1] - driven.true.positions[-1])
    drifts = f"{taught.drift_deg:+.2f} | {driven.drift_deg:+.2f}"
    return f"{off.mean():.1f} | {off.max():.1f} | {end:.0f} | {believed.mean():.1f} | {drifts} | {driven.reason}"


def comparison(without_mm: list[float], through_mm: list[float]) -> str:
    """Return how the mean offsets of the same seeds compare, with their spread."""
    pairs = np.array([without_mm, through_mm])
    drawn = np.random.default_rng(7).integers(pairs.shape[1], size=(5000, pairs.shape[1]))
    ratios = pairs[1][drawn].mean(axis=1) / pairs[0][drawn].mean(axis=1)
    low, high = np.quantile(ratios, [0.025, 0.975])
    means, spreads = pairs.mean(axis=1), pairs.std(axis=1, ddof=1)
    return (
        f"Means of {pairs.shape[1]} seeds: {means[0]:.1f} mm without ROS (standard deviation {spreads[0]:.1f}),"
        f" {means[1]:.1f} mm through topics ({spreads[1]:.1f}): {means[1] / means[0]:.2f} times, with seeds drawn anew"
        f" {low:.2f} to {high:.2f} times (95 %). Bar: 1.5 times."
    )


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--pace", type=float, default=1.0)
    given = parser.parse_args()
    git = ["git", "-C", str(Path(__file__).parent), "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip()
    line = f"`python benchmarks/ros2_closed_loop.py --runs {given.runs} --seconds {given.seconds:g}`"
    print(f"{line}, commit {commit or 'unknown'}; load {os.getloadavg()[0]:.1f} for {os.cpu_count()} cores.\n")
    means_mm: dict[str, list[float]] = {"without ROS": [], "through topics": []}
    print(HEAD)
    for seed in range(given.runs):
        for name in means_mm:
            with tempfile.TemporaryDirectory() as place:
                folder = Path(place)
                if name == "without ROS":
                    taught, driven = without_ros(folder, given.seconds, seed)
                else:
                    domain = 1 + (os.getpid() + seed) % 100
                    taught, driven = through_topics(folder, given.seconds, seed, domain=domain, pace=given.pace)
            means_mm[name].append(float(off_mm(taught.true, driven.true).mean()))
            print(f"| {seed} | {name} | {cells(taught, driven)} |", flush=True)
    if given.runs > 1:
        print("\n" + comparison(*means_mm.values()))


if __name__ == "__main__":
    main()
