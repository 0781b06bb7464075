"""Folders of runs that never were: everything that a run may leave, with pieces left out on request."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from trailmark.geometry import Pose2, Trajectory, write_tum

RATE_HZ = 20.0
COLUMNS = (
    "arrived_s,source,kind,since_s,stamp_s,x,y,theta,info_xx,info_xy,info_xt,info_yy,info_yt,info_tt,"
    "status,nis,dof,reason,details"
)
CONFIG = """\
mode: track
sources:
  robot: {plugin: sim, world: ground_course}
localizers:
  floor: {plugin: ground_vo, camera: robot}            # <b>every</b> frame & more
  floor_map: {plugin: ground_map, camera: robot, async: true, latency_ms: 200}
  klt: {plugin: klt, camera: robot}
estimator: {plugin: kalman, use: [floor, floor_map]}
seed: 0
"""
RUN = {
    "trailmark": "0.1.0",
    "status": "done",
    "reason": "",
    "mode": "track",
    "pace": "step",
    "seed": 0,
    "command": "trailmark run course.yaml --set seed=0",
    "started": "2026-11-20T09:41:07+00:00",
    "duration_s": 8.42,
    "python": "3.11.9",
    "platform": "Linux-6.1.0-x86_64-with-glibc2.36",
    "cpu": "AMD EPYC 7763 64-Core Processor",
    "packages": {"numpy": "2.4.6", "opencv-contrib-python-headless": "5.0.0.93", "filterpy": "2.0.0"},
    "plugins": {"ground_vo": "trailmark 0.1.0", "kalman": "trailmark 0.1.0", "sim": "trailmark 0.1.0"},
    "git": {"commit": "36c2c22f0a5b", "dirty": False},
    "sensors": {
        "robot": {
            "name": "robot",
            "kind": "image",
            "size": [512, 480],
            "rate_hz": 70.0,
            "calibration": {
                "metres_per_pixel": [3.9e-4, 3.9e-4],
                "flat_field": {"shape": [480, 512], "dtype": "float32", "base64": "A" * 900},
            },
        }
    },
    "counters": {
        "frames.robot": 1200,
        "dropped.robot": 0,
        "mailbox.floor_map.overwritten": 17,
        "late.floor_map": 3,
        "gated.floor_map": 6,
        "lost.floor": 60,
    },
    "files": {},
}
STAGES = {
    "source.robot": (1200, 2.31, 2.2, 3.1, 4.8, 9.7),
    "localizer.floor": (1200, 1.72, 1.65, 2.2, 2.9, 6.1),
    "localizer.floor_map": (120, 41.0, 38.0, 72.0, 88.0, 95.0),
    "localizer.klt": (1200, 3.9, 3.7, 5.9, 7.7, 12.0),
    "estimator": (2460, 0.061, 0.05, 0.11, 0.62, 1.4),
    "sink.jsonl": (1200, 0.012, 0.011, 0.019, 0.03, 0.2),
}
WORDS = ("n", "mean_ms", "p50_ms", "p95_ms", "p99_ms", "max_ms")
TIMING = {
    "stages": {name: dict(zip(WORDS, numbers, strict=True)) for name, numbers in STAGES.items()},
    "peak_rss_mb": 214.6,
    "frames": 1200,
    "wall_s": 8.42,
}


@dataclass
class Pieces:
    """What a made-up run leaves."""

    shape: str = "loop"
    has_truth: bool = True
    has_estimates: bool = True
    has_timing: bool = True
    has_run_json: bool = True
    seconds: float = 60.0
    status: str = "done"
    reason: str = ""
    localizers: tuple[str, ...] = ("floor", "floor_map", "klt")
    config: str = CONFIG
    seed: int = 7


def true_way(shape: str, seconds: float) -> Trajectory:
    """Return a loop of 8 m by 5 m, a corridor of 40 m, or a place."""
    stamps = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    turn = stamps / seconds * 2.0 * np.pi
    if shape == "static":
        return Trajectory(stamps, np.tile([1.0, 2.0, 0.3], (len(stamps), 1)))
    if shape == "corridor":
        x, y = 40.0 * stamps / seconds, 0.3 * np.sin(3.0 * turn)
    else:
        x, y = 4.0 * np.sin(turn), 2.5 * (1.0 - np.cos(turn)) + 0.5 * np.sin(2.0 * turn)
    return Trajectory(stamps, np.column_stack([x, y, np.arctan2(np.gradient(y), np.gradient(x))]))


def drifting(truth: Trajectory, sigma_m: float, sigma_rad: float, rng: np.random.Generator) -> Trajectory:
    """Return what a dead reckoning of noisy motions makes of a way, from the same start."""
    poses = [truth[0][1]]
    for k in range(1, len(truth)):
        motion = truth[k - 1][1].between(truth[k][1]).array()
        noise = rng.normal(size=3) * [sigma_m, sigma_m, sigma_rad]
        poses.append(poses[-1] @ Pose2.from_array(motion + noise))
    return Trajectory(truth.stamps_s, np.array([pose.array() for pose in poses]))


def estimates_of(truth: Trajectory, pieces: Pieces, rng: np.random.Generator) -> list[str]:
    """Return the rows of ``estimates.csv``: motions each frame, late and gated fixes twice a second."""
    rows: list[tuple[float, str]] = []
    for k in range(1, len(truth)):
        since, stamp = truth.stamps_s[k - 1], truth.stamps_s[k]
        if pieces.seconds / 2 < stamp < pieces.seconds / 2 + 3.0:
            rows.append((stamp, f'{stamp},floor,lost,,{stamp},,,,,,,,,,unused,,,"too dark, blurred",'))
        else:
            x, y, theta = (truth[k - 1][1].between(truth[k][1]).array() + rng.normal(size=3) * 1e-3).tolist()
            numbers = f"{x!r},{y!r},{theta!r},1e6,0,0,1e6,0,1e6"
            nis = float(rng.chisquare(3))
            rows.append((stamp, f"{stamp},floor,motion,{since},{stamp},{numbers},accepted,{nis!r},3,,"))
            rows.append((stamp, f"{stamp},klt,motion,{since},{stamp},{numbers},unused,,,not in use,"))
        if k % 10 == 0:
            x, y, theta = (truth.poses[k] + rng.normal(size=3) * [0.01, 0.01, 0.01]).tolist()
            status = "gated" if k % 170 == 0 else "late" if k % 330 == 0 else "accepted"
            numbers = f"{x!r},{y!r},{theta!r},1e4,0,0,1e4,0,1e4"
            arrived = stamp + 0.2 + float(rng.exponential(0.05))
            rows.append(
                (arrived, f"{arrived},floor_map,fix,,{stamp},{numbers},{status},{2.0 * rng.chisquare(3)!r},3,,")
            )
    return [row for _, row in sorted(rows, key=lambda item: item[0])]


def write_fake_run(folder: Path, pieces: Pieces) -> Path:
    """Write the folder of a made-up run."""
    rng = np.random.default_rng(pieces.seed)
    (folder / "trajectories").mkdir(parents=True)
    truth = true_way(pieces.shape, pieces.seconds)
    made = {
        "floor": drifting(truth, 0.002, 0.002, rng),
        "floor_map": Trajectory(
            truth.stamps_s[::10], truth.poses[::10] + rng.normal(size=(len(truth.poses[::10]), 3)) * 0.01
        ),
        "klt": drifting(truth, 0.006, 0.008, rng),
    }
    lost = (truth.stamps_s > pieces.seconds / 2) & (truth.stamps_s < pieces.seconds / 2 + 3.0)
    made["floor"] = Trajectory(truth.stamps_s[~lost], made["floor"].poses[~lost])
    fused = Trajectory(truth.stamps_s, truth.poses + np.cumsum(rng.normal(size=(len(truth), 3)), axis=0) * 4e-4)
    for index in range(len(pieces.localizers)):
        name = pieces.localizers[index]
        write_tum(folder / "trajectories" / f"{name}.tum", made.get(name, made[list(made)[index % 3]]))
    write_tum(folder / "trajectories" / "fused.tum", fused)
    if pieces.has_truth:
        write_tum(folder / "trajectories" / "groundtruth.tum", truth)
    if pieces.has_estimates:
        (folder / "estimates.csv").write_text("\n".join([COLUMNS, *estimates_of(truth, pieces, rng)]) + "\n")
    if pieces.has_timing:
        (folder / "timing.json").write_text(json.dumps(TIMING))
    if pieces.has_run_json:
        (folder / "run.json").write_text(json.dumps({**RUN, "status": pieces.status, "reason": pieces.reason}))
    (folder / "config.yaml").write_text(pieces.config)
    return folder


@pytest.fixture
def fake_run(tmp_path: Path) -> Callable[..., Path]:
    """Write the folder of a made-up run; keywords are those of `Pieces`."""

    def write(name: str = "20261120-094107-course", **pieces: object) -> Path:
        return write_fake_run(tmp_path / name, Pieces(**pieces))  # type: ignore[arg-type]

    return write
