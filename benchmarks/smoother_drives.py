"""Drives for `smoother.py`: recordings as configs, and simulated robots as estimates in the order of their arrival."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import mrclam
import numpy as np
from landmarks import ODOMETRY, RANGE_SCALE, _driven
from scipy.io import loadmat

from trailmark.arrays import Floats
from trailmark.estimates import Estimate, Fix, Motion, information_along, information_from_sigmas
from trailmark.geometry import Pose2, Trajectory

__all__ = ["Arrival", "mrclam_config", "plaza_config", "simulated"]

_DT_S, _DURATION_S, _FIX_EVERY, _LATE_S = 0.02, 300.0, 10, 1.0


class Arrival(NamedTuple):
    """What a localizer says, and when it is heard."""

    at_s: float
    source: str
    estimate: Estimate


def mrclam_config(folder: Path, robot: int) -> dict[str, Any]:
    """Return the config of a robot of MRCLAM: wheels, and barcodes at range and bearing."""
    return {
        "sources": {"wheels": mrclam.wheels(folder, robot), "landmarks": mrclam.barcodes(folder, robot)},
        "localizers": {"wheels": ODOMETRY, "landmarks": {"plugin": "known_landmarks"}},
        "start": mrclam.start(folder, robot),
    }


def plaza_config(folder: Path, number: int, scratch: Path) -> dict[str, Any]:
    """Return the config of a mowing drive: wheels, and ranges to radios; the tables are written to a folder."""
    tables = loadmat(folder / f"Plaza{number}_.mat")
    truth = tables["GT"].copy()
    truth[:, 3] += math.pi if number == 2 else 0.0  # its heading points backwards
    written = {
        "truth": truth,
        "odometry": _driven(tables["DR"]),
        "ranges": tables["TD"][np.argsort(tables["TD"][:, 0], kind="stable")],
        "landmarks": tables["TL"],
    }
    for name, table in written.items():
        np.savetxt(scratch / f"{name}.txt", table)
    wheels = {
        "plugin": "csv_odometry",
        "path": str(scratch / "odometry.txt"),
        "header": ["t", "x", "y", "theta"],
        "poses": str(scratch / "truth.txt"),
        "poses_header": ["t", "x", "y", "theta"],
    }
    radios = {
        "plugin": "csv_records",
        "path": str(scratch / "ranges.txt"),
        "header": ["t", "_", "id", "range"],
        "metres_per_unit": RANGE_SCALE,
        "landmarks": str(scratch / "landmarks.txt"),
        "landmarks_header": ["id", "x", "y"],
    }
    return {
        "sources": {"wheels": wheels, "radios": radios},
        "localizers": {"wheels": {"plugin": "odometry"}, "radios": {"plugin": "known_landmarks"}},
        "start": [float(truth[0, 1]), float(truth[0, 2]), math.degrees(truth[0, 3])],
    }


def simulated(kind: str, seed: int) -> tuple[list[Arrival], Trajectory]:
    """Return what is heard of a robot that drives figures of eight for 300 s, and where it was.

    ``late fixes``: whole poses at 5 Hz, 0.1 m and 2 deg, heard 1 s late; of ten, one is off by 3 m.
    ``bursts``: one number of the position at a time (a line of a map), 0.1 m, at 5 Hz; every 30 s, for 3 s, all of them
    are off by the same 2 m.
    """
    rng = np.random.default_rng(seed)
    stamps = np.arange(0.0, _DURATION_S, _DT_S)
    speed, rate = 0.6 + 0.2 * np.sin(0.1 * stamps), 0.35 * np.sin(0.05 * stamps)
    poses = [Pose2()]
    for v, w in zip(speed[1:].tolist(), rate[1:].tolist()):
        poses.append(poses[-1] @ Pose2.exp(v * _DT_S, 0.0, w * _DT_S))
    arrivals = [*_wheels(stamps, poses, rng), *(_late(stamps, poses, rng) if kind == "late fixes" else ())]
    arrivals += _bursts(stamps, poses, rng) if kind == "bursts" else ()
    arrivals.sort(key=lambda one: one.at_s)
    return arrivals, Trajectory(stamps, np.array([pose.array() for pose in poses]))


def _wheels(stamps: Floats, poses: list[Pose2], rng: np.random.Generator) -> Iterator[Arrival]:
    for since_s, stamp_s, before, after in zip(stamps, stamps[1:], poses, poses[1:]):
        forward, left, turn = before.between(after).log()
        # The errors of wheels are no share of each step: a part of the way and of the turn, as a random walk.
        sigmas = 0.03 * math.sqrt(abs(forward)) + 1e-4, 1e-3, 0.05 * math.sqrt(abs(turn)) + 1e-4
        noisy = np.array([forward, left, turn]) + rng.normal(0.0, 1.0, 3) * sigmas
        motion = Motion(float(since_s), float(stamp_s), Pose2.exp(*noisy.tolist()), information_from_sigmas(*sigmas))
        yield Arrival(float(stamp_s), "wheels", motion)


def _late(stamps: Floats, poses: list[Pose2], rng: np.random.Generator) -> Iterator[Arrival]:
    information = information_from_sigmas(0.1, 0.1, math.radians(2.0))
    for stamp_s, pose in zip(stamps[::_FIX_EVERY].tolist(), poses[::_FIX_EVERY]):
        dx, dy = rng.normal(0.0, 0.1, 2)
        if rng.random() < 0.1:
            dx += 3.0 * rng.choice([-1.0, 1.0])
        measured = Pose2(pose.x + dx, pose.y + dy, pose.theta + rng.normal(0.0, math.radians(2.0)))
        yield Arrival(stamp_s + _LATE_S, "fixes", Fix(stamp_s, measured, information))


def _bursts(stamps: Floats, poses: list[Pose2], rng: np.random.Generator) -> Iterator[Arrival]:
    for k, (stamp_s, pose) in enumerate(zip(stamps[::_FIX_EVERY].tolist(), poses[::_FIX_EVERY])):
        direction = rng.uniform(0.0, math.pi)
        normal = math.cos(direction), math.sin(direction)
        away = rng.normal(0.0, 0.1) + (2.0 if stamp_s % 30.0 > 27.0 else 0.0)
        measured = Pose2(pose.x + away * normal[0], pose.y + away * normal[1], 0.0)
        yield Arrival(stamp_s + 1e-3 * (k % 2), "lines", Fix(stamp_s, measured, information_along((*normal, 0.0), 0.1)))
