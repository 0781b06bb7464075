"""`trailmark calibrate odometry | mounting | delay` on drives whose answer is known, and on a recorded log.

- ``drives``: simulated drives, each with its own seed, course, wrong wheels, wrong place of the sensor and delay; the
  motions themselves are simulated, without pictures.
- ``courses``: courses that tell less, and robots that are put together wrongly: how much is told, and wrongly.
- ``plugins``: the simulated supermarket with a laser (`scan_odometry`) and wheels, through the whole pipeline.
- ``aces``: the ACES log, its wheels against its laser, and the relations of Kuemmerle et al. before and after.

    TRAILMARK_DATA=/path/to/recordings python benchmarks/calibrate.py [drives courses plugins aces] [--markdown]
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from laser_maps import print_rows
from scan_odometry import relation_errors

from trailmark.arrays import Floats
from trailmark.config import MotionCorrection
from trailmark.estimates import Motion
from trailmark.geometry import Pose2
from trailmark.pipeline.localizers.correcting import with_corrected_motions
from trailmark.plugins import load_plugins
from trailmark_calibration.drive import TwoLocalizers, observe_drive, read_localizers, restricted_to
from trailmark_calibration.fitting import Fit, KnownPlacement, fit
from trailmark_calibration.model import DELAY, TURN, TURN_PER_M, WAY, YAW, MotionPairs, X, Y, pairs_of
from trailmark_calibration.rigid import between
from trailmark_calibration.simulating import Course, DriveNoise, SimulatedDrive, draw_truth, simulate
from trailmark_calibration.telling import Question, answer
from trailmark_calibration.tracks import track_of

SHOWN = {
    WAY: ("scale of the way", 1e2, "%"),
    TURN: ("scale of turns", 1e2, "%"),
    TURN_PER_M: ("bend", math.degrees(1.0), "deg/m"),
    X: ("x", 1e3, "mm"),
    Y: ("y", 1e3, "mm"),
    YAW: ("yaw", math.degrees(1.0), "deg"),
    DELAY: ("delay", 1e3, "ms"),
}
#: Seeds of drives that nothing was tuned on.
FIRST_SEED = 5000


def fitted(drive: SimulatedDrive) -> tuple[MotionPairs, Fit]:
    """Return what is compared of a simulated drive, and what it says."""
    sensor = track_of("sensor", drive.sensor).seen_from(drive.believed)
    pairs = pairs_of(track_of("wheels", drive.wheels), sensor, 0.5)
    return pairs, fit(pairs, KnownPlacement(drive.believed))


def errors_of(values: Floats, truth: Floats) -> Floats:
    """Return found minus right."""
    errors = np.asarray(values - truth)
    errors[YAW] = math.remainder(errors[YAW], 2.0 * math.pi)
    return errors


def error_over_5_m(pairs: MotionPairs, numbers: Floats | None, drive: SimulatedDrive) -> tuple[float, float]:
    """Return the median error of the wheels over 5 m against the truth, as they are or corrected [m, rad]."""
    wheels = pairs.a if numbers is None else pairs.a.transform_twists(pairs.matrix(numbers))
    stamps_s = wheels.stamp_s
    true_s = stamps_s - drive.truth[DELAY]
    truth = np.stack([np.interp(true_s, drive.stamps_s, column) for column in drive.poses.T], axis=1)
    way_m = np.cumsum(np.hypot(*np.diff(truth[:, :2], axis=0, prepend=truth[:1, :2]).T))
    last = np.searchsorted(way_m, way_m + 5.0)
    first = np.flatnonzero(last < len(way_m))[::20]
    last = last[first]
    off = between(between(truth[first], truth[last]), wheels.motions(stamps_s[first], stamps_s[last]))
    return float(np.median(np.hypot(off[:, 0], off[:, 1]))), float(np.median(np.abs(off[:, 2])))


def drive_rows(n: int) -> Iterator[dict[str, Any]]:
    """Yield a row for each number over all drives, and for the odometry."""
    errors, before, sigmas, told, ways = [], [], [], [], []
    for seed in range(FIRST_SEED, FIRST_SEED + n):
        rng = np.random.default_rng(seed)
        truth, believed = draw_truth(rng)
        drive = simulate(rng, truth, believed)
        pairs, found = fitted(drive)
        assumed = np.array([1.0, 1.0, 0.0, *believed, 0.0, 0.0])
        errors.append(errors_of(found.values, truth))
        before.append(errors_of(assumed, truth))
        sigmas.append(found.sigmas)
        told.append(found.is_told)
        ways.append((*error_over_5_m(pairs, None, drive), *error_over_5_m(pairs, found.values, drive)))
    off, were, sigma = np.abs(errors), np.abs(before), np.array(sigmas)
    for index, (name, factor, unit) in SHOWN.items():
        yield {
            "number": f"{name} [{unit}]",
            "drives": n,
            "told": int(np.array(told)[:, index].sum()),
            "wrong by, before": f"{factor * np.median(were[:, index]):.2f}",
            "after, median": f"{factor * np.median(off[:, index]):.2f}",
            "after, worst": f"{factor * off[:, index].max():.2f}",
            "own sigma, median": f"{factor * np.median(sigma[:, index]):.2f}",
            "within 3 sigmas": f"{int((off[:, index] < 3.0 * sigma[:, index]).sum())} of {n}",
        }
    errors_m = np.array(ways)
    for name, factor, column in (("wheels over 5 m [mm]", 1e3, 0), ("wheels over 5 m [deg]", math.degrees(1.0), 1)):
        was, is_now = errors_m[:, column], errors_m[:, column + 2]
        yield {
            "number": name,
            "drives": n,
            "told": "",
            "wrong by, before": f"{factor * np.median(was):.2f}",
            "after, median": f"{factor * np.median(is_now):.2f}",
            "after, worst": f"{factor * is_now.max():.2f}",
            "own sigma, median": "",
            "within 3 sigmas": f"{int((is_now <= 0.5 * was).sum())} of {n} halved",
        }


#: Name, course, length [s], noise, and what is drawn otherwise.
COURSES: dict[str, tuple[Course, float, DriveNoise, dict[int, float]]] = {
    "straight": ("straight", 120.0, DriveNoise(), {}),
    "one circle": ("circle", 120.0, DriveNoise(), {}),
    "mixed, 20 s": ("mixed", 20.0, DriveNoise(), {}),
    "mixed, 5 times the noise": ("mixed", 240.0, DriveNoise(0.025, 0.05, 0.01, 0.005), {}),
    "mixed, 3 % wrong motions": ("mixed", 240.0, DriveNoise(outliers=0.03), {}),
    "mixed, wheels swapped": ("mixed", 120.0, DriveNoise(), {TURN: -1.0}),
    "mixed, sensor the other way round": ("mixed", 120.0, DriveNoise(), {YAW: math.pi}),
}


def course_rows(n: int) -> Iterator[dict[str, Any]]:
    """Yield a row for each course: on how many drives each number is told, and how many are wrong by 3 sigmas."""
    for name, (course, duration_s, noise, changes) in COURSES.items():
        told, wrong, worst, share = np.zeros(8, int), 0, 0.0, []
        for seed in range(FIRST_SEED, FIRST_SEED + n):
            rng = np.random.default_rng(seed)
            truth, believed = draw_truth(rng)
            for index, value in changes.items():
                truth[index] = value
            if YAW in changes:
                believed[2] = 0.0
            drive = simulate(rng, truth, believed, course=course, duration_s=duration_s, noise=noise)
            _, found = fitted(drive)
            sigmas = (np.abs(errors_of(found.values, truth)) / found.sigmas)[found.is_told]
            told += found.is_told
            wrong += int((sigmas > 3.0).sum())
            worst = max(worst, *sigmas.tolist()) if len(sigmas) else worst
            share.append(found.n_outliers / found.n_pairs)
        yield {
            "course": name,
            "drives": n,
            **{label: int(told[index]) for index, (label, _, _) in SHOWN.items()},
            "told and beyond 3 sigmas": f"{wrong} of {int(told[list(SHOWN)].sum())}",
            "farthest [sigmas]": f"{worst:.1f}",
            "left out": f"{100 * np.mean(share):.0f} %",
        }


SHOP = """
sources:
  shop:
    plugin: sim
    world: supermarket
    route: round
    vehicle: {{kind: differential, wheels: {{scale: {scale:.4f}, turn_scale: {turn_scale:.4f}, slip_m: 0.002}}}}
    sensors: [wheels, laser]
    sway_m: 0.05
    perturb: {{sensors: [laser], wrong: {{x_m: {x_m:.4f}, y_m: {y_m:.4f}, yaw_deg: {yaw_deg:.3f}}}}}
seed: {seed}
localizers:
  wheels: {{plugin: odometry}}
  laser: {{plugin: scan_odometry}}
"""


def plugin_rows(n: int, folder: Path) -> Iterator[dict[str, Any]]:
    """Yield a row for each number of each drive through the supermarket."""
    for seed in range(1, n + 1):
        rng = np.random.default_rng(FIRST_SEED + seed)
        drawn = {
            "scale": rng.uniform(-0.06, 0.06),
            "turn_scale": rng.uniform(-0.08, 0.08),
            "x_m": rng.uniform(-0.08, 0.08),
            "y_m": rng.uniform(-0.08, 0.08),
            "yaw_deg": rng.uniform(-6.0, 6.0),
        }
        file = folder / f"shop{seed}.yaml"
        file.write_text(SHOP.format(seed=seed, **drawn))
        two = TwoLocalizers("wheels", "laser")
        drive = observe_drive(restricted_to(read_localizers(file, load_plugins(), []), two, None), two)
        believed = drive.sensors["laser"].pose_base_sensor
        right = {
            WAY: 1.0 / (1.0 + drawn["scale"]),
            TURN: 1.0 / (1.0 + drawn["turn_scale"]),
            X: believed.x - drawn["x_m"],
            Y: believed.y - drawn["y_m"],
            YAW: believed.yaw - math.radians(drawn["yaw_deg"]),
            DELAY: 0.0,
        }
        document = answer(Question("odometry", two), drive).document
        assumed = {WAY: 1.0, TURN: 1.0, X: believed.x, Y: believed.y, YAW: believed.yaw, DELAY: 0.0}
        names = {WAY: "way", TURN: "turn", X: "x", Y: "y", YAW: "yaw", DELAY: "delay"}
        row: dict[str, Any] = {"drive": seed, "intervals": document["intervals"], "left out": document["outliers"]}
        for index, key in names.items():
            label, factor, unit = SHOWN[index]
            number = document["numbers"][key]
            before, after = abs(assumed[index] - right[index]), abs(number["value"] - right[index])
            row[f"{label} [{unit}]"] = f"{factor * before:.2f}, {factor * after:.2f} ({after / number['sigma']:.1f})"
        check = document["check"]
        row["5 s, other half [mm]"] = f"{1e3 * check['before'][0]:.0f}, {1e3 * check['after'][0]:.0f}"
        yield row


ACES = """
sources: {{log: {{plugin: carmen_log, path: {path}, scan_poses: odometry}}}}
localizers:
  wheels: {{plugin: odometry}}
  laser: {{plugin: scan_odometry}}
"""


def aces_rows(data: Path, folder: Path, seconds: float) -> Iterator[dict[str, Any]]:
    """Yield what the log says of its wheels, and what its relations say before and after."""
    file = folder / "aces.yaml"
    file.write_text(ACES.format(path=data / "laser" / "aces.clf.bz2"))
    two = TwoLocalizers("wheels", "laser")
    window = [f"sources.log.stop_s={seconds}"] if math.isfinite(seconds) else []
    drive = observe_drive(restricted_to(read_localizers(file, load_plugins(), window), two, None), two)
    found = answer(Question("odometry", two), drive)
    for line in found.lines:
        yield {"what": "said", "value": " ".join(line.split())}
    yield {"what": "config", "value": f"`{found.config_lines[-1].strip()}`"}
    numbers = found.document["numbers"]
    correction = MotionCorrection(
        way=numbers["way"]["value"],
        turn=numbers["turn"]["value"],
        turn_deg_per_m=math.degrees(numbers["turn_per_m"]["value"]),
    )
    wheels = [one for one in drive.said["wheels"] if isinstance(one, Motion)]
    stamps_s = np.array([wheels[0].since_s, *(motion.stamp_s for motion in wheels)])
    relations = np.loadtxt(data / "laser" / "aces.relations")
    relations = relations[(relations[:, :2] <= stamps_s[-1]).all(axis=1)]
    near = relations[np.abs(relations[:, 1] - relations[:, 0]) < 30.0]
    for name, motions in (("as logged", wheels), ("corrected", with_corrected_motions(wheels, correction))):
        poses = [Pose2()]
        for motion in motions:
            assert isinstance(motion, Motion)
            poses.append(poses[-1] @ motion.pose_since_now)
        for group, rows in (("all", relations), ("less than 30 s apart", near)):
            scans_s = np.unique(rows[:, :2])
            errors = relation_errors(poses_at(scans_s, stamps_s, poses), scans_s, rows)
            mean_m, mean_deg = errors[:, 0].mean(), math.degrees(errors[:, 1].mean())
            value = f"{mean_m:.3f} m, {mean_deg:.2f} deg (n = {len(errors)})"
            yield {"what": f"relations {group}, {name}", "value": value}


def poses_at(at_s: Floats, stamps_s: Floats, poses: Sequence[Pose2]) -> list[Pose2]:
    """Return poses at other stamps, between those that are known."""
    after = np.clip(np.searchsorted(stamps_s, at_s), 1, len(stamps_s) - 1)
    shares = np.clip((at_s - stamps_s[after - 1]) / (stamps_s[after] - stamps_s[after - 1]), 0.0, 1.0)
    return [poses[k - 1].interpolate(poses[k], float(share)) for k, share in zip(after.tolist(), shares)]


def main() -> None:
    """Print the tables that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tables", nargs="*", default=[])
    parser.add_argument("--drives", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=math.inf, help="So much of the log.")
    parser.add_argument("--out", type=Path, default=Path("runs/calibrate"), help="For configs that are written.")
    parser.add_argument("--markdown", action="store_true")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    folder = arguments.out.absolute()
    for name in arguments.tables or ["drives", "courses", "plugins", "aces"]:
        rows = {
            "drives": lambda: drive_rows(arguments.drives),
            "courses": lambda: course_rows(arguments.drives),
            "plugins": lambda: plugin_rows(min(arguments.drives, 3), folder),
            "aces": lambda: aces_rows(Path(os.environ.get("TRAILMARK_DATA", "")), folder, arguments.seconds),
        }[name]()
        print_rows(rows, arguments.markdown)


if __name__ == "__main__":
    main()
