"""Rows of the page of speed that stand beside peers: both run in one process and take turns at each picture or scan.

Each row is a function that returns, by name, what the peer needs and what we need, in CPU time of one thread, and what
says whether the answers are worth the same. `speed_page.py` prints them (``--only peers``); one alone:

    TRAILMARK_DATA=/path/to/recordings python benchmarks/speed_peers.py surf kinect ground scan_to_map fixed_lag tum
"""

from __future__ import annotations

import math
import os
import tempfile
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


def fixed_lag() -> Beside:
    """`estimator: smoother` and gtsam's incremental fixed-lag smoother, 10 s both, wheels at 50 Hz, 1,350 fixes."""
    from smoother_drives import simulated

    from trailmark.estimates import Motion

    arrivals, truth = simulated("late fixes", 0)
    # heard at once, and without those that are off by metres: gtsam has no gate of its own
    in_time = [one._replace(at_s=one.estimate.stamp_s) for one in arrivals]
    arrivals = sorted(
        (
            one
            for one in in_time
            if isinstance(one.estimate, Motion) or _miss_m(one.estimate.pose_map_base, one, truth) < 1.0
        ),
        key=lambda one: one.at_s,
    )
    found: Beside = {}
    sides = (_Gtsam(), _Smoother())
    times: tuple[list[float], list[float]] = ([], [])
    errors: tuple[list[float], list[float]] = ([], [])
    for arrival in arrivals:
        for side, spent, missed in zip(sides, times, errors):
            began = time.thread_time()
            pose = side.hear(arrival)
            took = 1e6 * (time.thread_time() - began)
            if isinstance(arrival.estimate, Motion):
                continue
            spent.append(took)
            missed.append(_miss_m(pose, arrival, truth) ** 2)
    for what, of in {"median": 50.0, "99th percentile": 99.0}.items():
        gtsam_us, ours_us = (float(np.percentile(spent[100:], of)) for spent in times)
        found[f"smoother / gtsam's fixed lag: a fix, {what} [us]"] = gtsam_us, ours_us
    gtsam_m, ours_m = (math.sqrt(float(np.mean(missed))) for missed in errors)
    found["smoother / gtsam's fixed lag: error, rms [m]"] = gtsam_m, ours_m
    return found


def _miss_m(pose: Pose2, arrival: Any, truth: Any) -> float:
    x, y, _ = truth.at([arrival.at_s]).poses[0]
    return math.hypot(pose.x - x, pose.y - y)


class _Smoother:
    """Ours, as it ships."""

    def __init__(self) -> None:
        import trailmark
        from trailmark.interfaces import Session

        self._estimator = trailmark.create("estimator", "smoother")
        self._estimator.start(Session(start_pose=Pose2()))

    def hear(self, arrival: Any) -> Pose2:
        self._estimator.apply(arrival.source, arrival.estimate)
        pose = self._estimator.belief(arrival.at_s).pose_map_base
        assert pose is not None
        return Pose2(pose.x, pose.y, pose.theta)


class _Gtsam:
    """A pose for each fix, and between them what the wheels said, composed with its covariance."""

    def __init__(self) -> None:
        import gtsam

        self._gtsam, self._lag = gtsam, gtsam.IncrementalFixedLagSmoother(10.0, gtsam.ISAM2Params())
        self._key, self._moved, self._covariance = 0, Pose2(), np.zeros((3, 3))
        start = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.01, 0.01, math.radians(0.5)]))
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(0.0, 0.0, 0.0), start))
        values.insert(0, gtsam.Pose2(0.0, 0.0, 0.0))
        self._lag.update(graph, values, {0: 0.0})
        self._pose = Pose2()

    def hear(self, arrival: Any) -> Pose2:
        from trailmark.estimates import Motion

        said = arrival.estimate
        if isinstance(said, Motion):
            self._carry(said)
            return self._pose
        if not self._covariance.any():
            return self._pose  # a fix of the start itself
        gtsam, before, self._key = self._gtsam, self._key, self._key + 1
        graph, values, moved = gtsam.NonlinearFactorGraph(), gtsam.Values(), self._moved
        noise = gtsam.noiseModel.Gaussian.Covariance(self._covariance + 1e-12 * np.eye(3))
        graph.add(gtsam.BetweenFactorPose2(before, self._key, gtsam.Pose2(moved.x, moved.y, moved.theta), noise))
        fix, noise = said.pose_map_base, gtsam.noiseModel.Gaussian.Information(np.asarray(said.information))
        graph.add(gtsam.PriorFactorPose2(self._key, gtsam.Pose2(fix.x, fix.y, fix.theta), noise))
        values.insert(self._key, gtsam.Pose2(self._pose.x, self._pose.y, self._pose.theta))
        self._lag.update(graph, values, {self._key: arrival.at_s})
        pose = self._lag.calculateEstimatePose2(self._key)
        self._pose, self._moved, self._covariance = Pose2(pose.x(), pose.y(), pose.theta()), Pose2(), np.zeros((3, 3))
        return self._pose

    def _carry(self, said: Any) -> None:
        step = said.pose_since_now
        back = np.linalg.inv(self._gtsam.Pose2(step.x, step.y, step.theta).AdjointMap())
        self._covariance = back @ self._covariance @ back.T + np.linalg.inv(said.information)
        self._moved, self._pose = self._moved @ step, self._pose @ step


def tum() -> Beside:
    """Our reader of trajectories and evo's, on 100,000 poses."""
    from evo.tools.file_interface import read_tum_trajectory_file

    from trailmark.geometry import read_tum

    rng = np.random.default_rng(0)
    rows = np.column_stack([0.01 * np.arange(100_000), rng.normal(0.0, 5.0, (100_000, 3)), np.zeros((100_000, 4))])
    rows[:, 6:] = np.column_stack([np.sin(rows[:, 1]), np.cos(rows[:, 1])])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.tum"
        np.savetxt(path, rows, fmt="%.6f")
        times: tuple[list[float], list[float]] = ([], [])
        for _ in range(5):
            for read, spent in zip((read_tum_trajectory_file, read_tum), times):
                began = time.thread_time()
                read(path)
                spent.append(1e3 * (time.thread_time() - began))
    return {"reader of TUM trajectories / evo's: 100,000 poses [ms]": (min(times[0]), min(times[1]))}


#: Rows by name. They need ``pip install small_gicp scikit-image gtsam evo``.
PEERS: Mapping[str, Callable[[], Beside]] = {
    row.__name__: row for row in (surf, kinect, ground, scan_to_map, fixed_lag, tum)
}


if __name__ == "__main__":
    import sys

    os.environ.setdefault("TRAILMARK_DATA", str(Path(__file__).resolve().parents[2] / "shared" / "data"))
    for row in sys.argv[1:]:
        for name, (peer, ours) in PEERS[row]().items():
            print(f"{name:<70}{peer:10.4g}{ours:10.4g}{ours / peer:8.2f}", flush=True)
