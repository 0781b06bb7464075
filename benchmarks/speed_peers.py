"""Rows of the page of speed that stand beside peers: both run in one process and take turns at each picture or scan.

Each row is a function that returns, by name, what the peer needs and what we need, in CPU time of one thread, and what
says whether the answers are worth the same. `speed_page.py` prints them (``--only peers``); one alone:

    TRAILMARK_DATA=/path/to/recordings python benchmarks/speed_peers.py surf kinect ground scan_to_map
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.geometry import Pose2

#: By name: the peer's figure and ours.
Beside = dict[str, tuple[float, float]]

LOGS = {
    "intel": "omni/laser2d_carmen/intel-corrected.log.gz",
    "freiburg": "omni/laser2d_carmen/freiburg-079-corrected.log.gz",
}
#: How far the guess of a scan is from where the log says it was taken: way [m] and turn.
OFF = ((0.10, math.radians(5.0)), (0.60, math.radians(10.0)))


def surf() -> Beside:
    """SURF `compact` and OpenCV's SIFT on photographs, best 200 of 320 x 240."""
    import surf_photographs as photographs

    chosen = {name: photographs.METHODS[name] for name in ("surf compact", "sift of OpenCV")}
    ours, sift = photographs.compared(list(photographs.photographs()), chosen).values()
    what = ("repeatability", "precision", "matching score", "a picture [ms]")
    return {f"SURF compact / SIFT: {item}": (float(b), float(a)) for item, a, b in zip(what, ours, sift)}


def kinect() -> Beside:
    """Landmarks of a Kinect and ORB features on the same pictures, and their errors."""
    import kinect_landmarks as benchmark

    recording = benchmark.load()
    if recording is None:
        raise SystemExit("no recording of a Kinect; set TRAILMARK_DATA")
    names = ("fuzzy rules choose (default)", "ORB + depth + RANSAC-Kabsch")
    played: dict[str, list[Any]] = {name: [] for name in names}
    for seed in range(3):
        for name in names:
            played[name].append(benchmark.play(benchmark.METHODS[name](), recording, seed))
    ours, orb = played.values()
    figures: dict[str, Callable[[Any], float]] = {
        "a picture [ms]": lambda one: float(one.times_ms.mean()),
        "absolute error [m]": lambda one: one.ate_m,
        "relative error over 1 s [m]": lambda one: one.rpe_m,
    }
    return {
        f"kinect_landmarks / orb_rgbd, fr1_rpy: {item}": (
            float(np.mean([of(one) for one in orb])),
            float(np.mean([of(one) for one in ours])),
        )
        for item, of in figures.items()
    }


def ground() -> Beside:
    """A step of `ground_vo` as it ships, every guard on, and of `klt`, on the same pictures."""
    import ground_vo as benchmark

    import trailmark
    from trailmark.estimates import Belief
    from trailmark.interfaces import Session

    run, frames = benchmark.drive(220)
    pair = [trailmark.create("localizer", name, camera="floor") for name in ("klt", "ground_vo")]
    for one in pair:
        one.start(Session(sensors={"floor": run.sensor}))
    times: tuple[list[float], list[float]] = ([], [])
    for frame in frames:
        for one, spent in zip(pair, times):
            began = time.thread_time()
            one.observe(frame, Belief(frame.stamp_s))
            spent.append(1e3 * (time.thread_time() - began))
    klt, ours = (float(np.median(spent[20:])) for spent in times)
    return {"ground_vo refined / klt: a step [ms]": (klt, ours)}


def scan_to_map() -> Beside:
    """A scan to a map: every even scan of a log is its map, 150 odd ones are matched from a guess that is off."""
    found: Beside = {}
    for log in LOGS:
        scan_map, target, tests = map_and_tests(log)
        for way_m, turn_rad in OFF:
            times: tuple[list[float], list[float]] = ([], [])
            right = [0, 0]
            for k, (points, true) in enumerate(tests):
                direction = 2.399963 * k  # golden angle: all directions, evenly
                guess = true @ Pose2(way_m * math.cos(direction), way_m * math.sin(direction), turn_rad * (-1) ** k)
                for side, match in enumerate((_gicp(target), _ours(scan_map))):
                    began = time.thread_time()
                    pose = match(points, guess)
                    times[side].append(1e3 * (time.thread_time() - began))
                    miss = true.between(pose)
                    right[side] += math.hypot(miss.x, miss.y) < 0.1 and abs(miss.theta) < math.radians(2.0)
            name = f"scan to map / small_gicp, {log}, {way_m} m off"
            found[f"{name}: a scan [ms]"] = float(np.median(times[0])), float(np.median(times[1]))
            found[f"{name}: within 0.1 m and 2 deg [%]"] = 100.0 * right[0] / len(tests), 100.0 * right[1] / len(tests)
    return found


def map_and_tests(log: str, n_tests: int = 150) -> tuple[Any, Any, list[tuple[Any, Pose2]]]:
    """Return the map of a log's even scans, the same for small_gicp, and some of its odd scans with their poses."""
    import small_gicp
    from laser_floors import log_instants

    from trailmark_omni_surf.laser.scan_map import ScanMap

    data = Path(os.environ["TRAILMARK_DATA"])
    scans = [(one.scan.points(), one.truth) for one in log_instants(data / LOGS[log])]
    scans = [(points[np.hypot(*points.T) < 30.0], pose) for points, pose in scans]
    even, odd = scans[::2], [scan for scan in scans[1::2] if len(scan[0]) >= 10]
    scan_map = ScanMap.from_scans([points for points, _ in even], [pose for _, pose in even])
    target = small_gicp.preprocess_points(_flat(scan_map.points), downsampling_resolution=0.05)
    return scan_map, target, odd[:: max(1, len(odd) // n_tests)][:n_tests]


def _ours(scan_map: Any) -> Callable[[Any, Pose2], Pose2]:
    from trailmark_omni_surf.laser.matching import match_scan

    return lambda points, guess: match_scan(scan_map, points, guess).pose_map_base


def _gicp(target: Any) -> Callable[[Any, Pose2], Pose2]:
    """Return a match by small_gicp's point-to-point ICP, the quickest that it has for points in a plane."""
    import small_gicp

    cloud, tree = target

    def match(points: Any, guess: Pose2) -> Pose2:
        source, _ = small_gicp.preprocess_points(_flat(points), downsampling_resolution=0.05)
        cos, sin, start = math.cos(guess.theta), math.sin(guess.theta), np.eye(4)
        start[:2, :2], start[:2, 3] = [[cos, -sin], [sin, cos]], [guess.x, guess.y]
        moved = small_gicp.align(
            cloud, source, tree, start, registration_type="ICP", max_correspondence_distance=1.0, num_threads=1
        ).T_target_source
        return Pose2(float(moved[0, 3]), float(moved[1, 3]), math.atan2(moved[1, 0], moved[0, 0]))

    return match


def _flat(points: Any) -> Any:
    return np.column_stack([points, np.zeros(len(points))])


#: Rows by name. They need ``pip install small_gicp scikit-image``.
PEERS: Mapping[str, Callable[[], Beside]] = {row.__name__: row for row in (surf, kinect, ground, scan_to_map)}


if __name__ == "__main__":
    import sys

    os.environ.setdefault("TRAILMARK_DATA", str(Path(__file__).resolve().parents[2] / "shared" / "data"))
    for row in sys.argv[1:]:
        for name, (peer, ours) in PEERS[row]().items():
            print(f"{name:<70}{peer:10.4g}{ours:10.4g}{ours / peer:8.2f}", flush=True)
