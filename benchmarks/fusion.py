"""How well the Kalman estimator fuses odometry with landmarks on real robots, and what an estimate costs.

Five robots of the UTIAS MRCLAM data set 6 (Leung, Halpern, Barfoot & Liu, IJRR 2011) through the public pipeline: wheel
odometry, and each sighting of a known landmark as a fix of rank two (``examples/third_party_plugin``). The cases: in
time, 2 s late, 10 % of the ranges off by 3 m, and a wrong start (1 m and 90 deg) that is believed to be right. Position
RMSE against motion capture, without alignment. One set of noise figures for all.

    TRAILMARK_DATA=/path/to/recordings python benchmarks/fusion.py [--robots 1 2] [--cases clean late] [--json]
    TRAILMARK_DATA=/path/to/recordings python benchmarks/fusion.py --husky
    python benchmarks/fusion.py --cost

``--markdown`` prints the tables of the page, with each.
``--husky``: where odometry and IMU of robot_localization's test1 bag end, beside the end that its own test expects.
That is parity with another filter, not truth: by GPS the robot ends 13 m from its start, not 87.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from time import thread_time_ns
from typing import Any

import fusion_tables
import numpy as np
import numpy.typing as npt

from trailmark import Pipeline
from trailmark.estimates import Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.geometry import Pose2, Trajectory, wrap_angle
from trailmark.interfaces import Session
from trailmark.plugins import load_plugins

Array = npt.NDArray[np.float64]

PLUGIN = Path(__file__).parents[1] / "examples" / "third_party_plugin" / "src"
ROBOTS = (1, 2, 3, 4, 5)
HUSKY_END = (-40.05, -77.00)
CASES = ("clean", "late", "outliers", "wrong_start")
ODOMETRY = {"plugin": "odometry"}


@dataclass(frozen=True, slots=True)
class Row:
    """Errors of one run; `settled_s` is from when on the position stays within 0.5 m (wrong start) [m, deg, s]."""

    robot: int
    case: str
    rmse_m: float
    p95_m: float
    max_m: float
    heading_rmse_deg: float
    settled_s: float
    settled_rmse_m: float
    gated: int
    recoveries: int


def main() -> None:
    """Print a table, or rows of JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, nargs="+", default=ROBOTS)
    parser.add_argument("--cases", nargs="+", choices=CASES, default=CASES)
    parser.add_argument("--cost", action="store_true", help="time estimates instead")
    parser.add_argument("--husky", action="store_true", help="odometry and IMU of a bag instead")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--markdown", action="store_true", help="the table of the page")
    arguments = parser.parse_args()
    if arguments.cost:
        found = costs()
        print(
            fusion_tables.cost(found) if arguments.markdown else json.dumps(found, indent=None if arguments.json else 2)
        )
        return
    folder = Path(os.environ.get("TRAILMARK_DATA", "")) / "fusion" / ("" if arguments.husky else "mrclam_D6")
    if not folder.is_dir():
        sys.exit(f"no recordings at {folder}; set TRAILMARK_DATA to their folder")
    if arguments.husky:
        ends = husky(folder / "rl_test1.bag")
        print(fusion_tables.husky(ends) if arguments.markdown else json.dumps(ends))
        return
    if arguments.markdown:
        rows = [measured(folder, robot, case) for case in arguments.cases for robot in arguments.robots]
        print(fusion_tables.robots([asdict(row) for row in rows]))
        return
    if not arguments.json:
        print("robot case          rmse    p95    max [m]  heading [deg]  settled [s], rmse then  gated  doubted")
    for case in arguments.cases:
        for robot in arguments.robots:
            row = measured(folder, robot, case)
            print(json.dumps(asdict(row)) if arguments.json else _line(row), flush=True)


def measured(folder: Path, robot: int, case: str) -> Row:
    """Return the errors of one robot in one case."""
    sys.path.insert(0, str(PLUGIN))
    plugins = load_plugins(
        files=[PLUGIN / "trailmark_mrclam" / "plugin.py", Path(__file__).with_name("delayed_landmarks.py")]
    )
    truth = _truth(folder / f"Robot{robot}_Groundtruth.dat")
    with tempfile.TemporaryDirectory() as scratch:
        config = _config(folder, robot, case, truth, Path(scratch))
        rows = []
        with Pipeline(config, plugins=plugins) as pipeline:
            for step in pipeline:
                pose = step.belief.pose_map_base
                assert pose is not None
                rows.append((step.stamp_s, pose.x, pose.y, pose.theta))
            counters = pipeline.result.counters
    return _errors(robot, case, np.array(rows), truth, counters)


def husky(bag: Path) -> dict[str, float]:
    """Return where odometry and IMU end, and how far from where robot_localization's test expects it [m]."""
    example = Path(__file__).parents[1] / "examples" / "real" / "husky_bag.yaml"
    source = f"sources.bag.path={json.dumps(str(bag))}"
    with Pipeline(example, overrides=[source]) as pipeline:
        for step in pipeline:
            pose = step.belief.pose_map_base
    assert pose is not None
    return {"x_m": pose.x, "y_m": pose.y, "from_expected_m": math.hypot(pose.x - HUSKY_END[0], pose.y - HUSKY_END[1])}


def costs(n: int = 4000, history: int = 140) -> dict[str, float]:
    """Return the median processor time of an estimate in order, and of one that is replayed [us]."""
    estimator = Kalman(KalmanConfig())
    estimator.start(Session(start_pose=Pose2()))
    good, fair = information_from_sigmas(1e-3, 1e-3, 1e-3), information_from_sigmas(0.3, 0.3, 0.3)
    motions, fixes, replays, late_fixes = [], [], [], []
    for i in range(n):
        motion = Motion(i / 70, (i + 1) / 70, Pose2(0.0037), good)
        motions.append(_timed(estimator, "vo", motion))
        if i % 7 == 6:
            fixes.append(_timed(estimator, "camera", Fix(motion.stamp_s, Pose2(0.0037 * (i + 1)), fair)))
        if i % 70 == 69 and i > history:  # 2 s late: as many motions, and the fixes among them, are done again
            late = Fix((i - history) / 70, Pose2(0.0037 * (i - history)), information_from_sigmas(3.0, 3.0, 3.0))
            late_fixes.append(_timed(estimator, "slow", late, asked_s=motion.stamp_s))
            replays.append(late_fixes[-1] / (history * 8 / 7))
    named = {"motion_us": motions, "fix_us": fixes, "late_fix_us": late_fixes, "replayed_us": replays}
    return {name: round(statistics.median(values), 1) for name, values in named.items()}


def _timed(estimator: Kalman, source: str, estimate: Motion | Fix, asked_s: float | None = None) -> float:
    """Return the processor time of an estimate, and of the belief if that is asked for: then all is replayed [us]."""
    began_ns = thread_time_ns()
    estimator.apply(source, estimate)
    if asked_s is not None:
        estimator.belief(asked_s)
    return (thread_time_ns() - began_ns) / 1000.0


def _config(folder: Path, robot: int, case: str, truth: Trajectory, scratch: Path) -> dict[str, Any]:
    measurements = folder / f"Robot{robot}_Measurement.dat"
    first_s = float(np.loadtxt(folder / f"Robot{robot}_Odometry.dat")[0, 0])
    start = truth.at([first_s])[0][1]
    if case == "outliers":
        measurements = _with_outliers(measurements, scratch)
    if case == "wrong_start":
        start = Pose2(start.x + 1.0, start.y, start.theta + math.pi / 2)
    beside = {"barcodes": str(folder / "Barcodes.dat"), "landmarks": str(folder / "Landmark_Groundtruth.dat")}
    landmarks: dict[str, Any] = {"plugin": "range_bearing"}
    if case == "late":
        landmarks = {"plugin": "delayed_range_bearing", "delay_s": 2.0}
    return {
        "sources": {
            "wheels": {
                "plugin": "csv_odometry",
                "path": str(folder / f"Robot{robot}_Odometry.dat"),
                "header": ["t", "v", "omega"],
            },
            "landmarks": {"plugin": "mrclam_landmarks", "path": str(measurements), **beside},
        },
        "localizers": {"wheels": ODOMETRY, "landmarks": landmarks},
        "estimator": {"plugin": "kalman"},
        "start": [start.x, start.y, math.degrees(start.theta)],
        "pace": "step",
    }


def _with_outliers(path: Path, scratch: Path) -> Path:
    """Write the measurements again, with 10 % of the ranges longer or shorter by 3 m."""
    rng = np.random.default_rng(0)
    table = np.loadtxt(path)
    is_outlier = rng.random(len(table)) < 0.1
    table[is_outlier, 2] += 3.0 * rng.choice([-1.0, 1.0], is_outlier.sum())
    table[:, 2] = np.maximum(table[:, 2], 0.1)
    np.savetxt(scratch / path.name, table, fmt=["%.3f", "%d", "%.3f", "%.3f"])
    return scratch / path.name


def _truth(path: Path) -> Trajectory:
    table = np.loadtxt(path)
    is_new = np.diff(table[:, 0], prepend=-np.inf) > 0
    return Trajectory(table[is_new, 0], table[is_new, 1:])


def _errors(robot: int, case: str, rows: Array, truth: Trajectory, counters: Any) -> Row:
    last = np.append(np.diff(rows[:, 0]) > 0, True)  # of several frames of one instant
    rows = rows[last & (rows[:, 0] >= truth.stamps_s[0]) & (rows[:, 0] <= truth.stamps_s[-1])]
    true = truth.at(rows[:, 0])
    errors = np.hypot(*(rows[:, 1:3] - true.positions).T)
    turns = np.array([wrap_angle(turn) for turn in rows[:, 3] - true.headings])
    settled = 0 if case != "wrong_start" else _first_settled(rows[:, 0], errors)
    return Row(
        robot,
        case,
        _rms(errors),
        float(np.quantile(errors, 0.95)),
        float(errors.max()),
        math.degrees(_rms(turns)),
        float(rows[settled, 0] - rows[0, 0]),
        _rms(errors[settled:]),
        counters.get("localizer.landmarks.gated", 0),
        counters.get("estimator.recoveries", 0),
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values * values)))


def _first_settled(stamps_s: Array, errors: Array) -> int:
    """Return from where on the error stays within 0.5 m for 10 s."""
    for index in np.flatnonzero(errors < 0.5):
        end = np.searchsorted(stamps_s, stamps_s[index] + 10.0)
        if errors[index:end].max() < 0.5:
            return int(index)
    return len(errors) - 1


def _line(row: Row) -> str:
    errors = f"{row.rmse_m:6.3f} {row.p95_m:6.3f} {row.max_m:6.3f}     {row.heading_rmse_deg:6.1f}"
    settled = f"{row.settled_s:6.1f} {row.settled_rmse_m:8.3f}"
    return f"R{row.robot}    {row.case:<12} {errors}         {settled}     {row.gated:6d}   {row.recoveries:6d}"


if __name__ == "__main__":
    main()
