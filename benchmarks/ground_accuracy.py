"""Accuracy of ground_vo on real and painted floors, beside what OpenCV offers, on the same pictures in the same run.

    python benchmarks/ground_accuracy.py [--what straight curve] [--floors wood_floor ...] [--seeds 5] [--peer-seeds 1]
                                         [--out FOLDER] [--quick] [--json | --markdown]

* straight: 10 m at 0.26 m/s, swaying by 3 mm, shaken by 0.05 deg at 11 Hz. Errors of the end [% of the way], of the
  odometer [%] and of heading [deg/m]; root mean square of the seeds.
* curve: 3 m with up to 20 px and 1.5 deg per picture; mean errors over 1 m.

Every picture is rendered once and given to all localizers; CPU time is that of the thread, of `observe` alone. The
runs are kept in FOLDER/ground_accuracy.jsonl, one line each; runs that are there already are not repeated, so that a
long measurement can be continued by the same command or another one (floors, methods); what is printed is of all.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from ground_scenes import BUILT_IN, PHOTOGRAPHS, RATE_HZ, SPEED_MPS, Drive, Law, photographs, scale_m, sensor

from trailmark.estimates import Belief, Lost, Motion
from trailmark.experiments import Row
from trailmark.frames import Frame
from trailmark.geometry import Pose2, wrap_angle
from trailmark.interfaces import Localizer, Session
from trailmark.testing.ground import straight
from trailmark_baselines.ground.config import KLTConfig, ORBConfig, PhaseCorrelationConfig
from trailmark_baselines.ground.klt import KLT
from trailmark_baselines.ground.orb import ORB
from trailmark_baselines.ground.phase import PhaseCorrelation
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.localizer import GroundVO

#: Bars and stretches of refined: position [%], odometer [%], heading [deg/m].
BARS = {"position": (0.15, 0.05), "odometer": (0.02, 0.005), "heading": (0.03, 0.01)}
UNITS = {"position": "%", "odometer": "%", "heading": "deg/m"}
#: Floors with a bar of their own, for the position.
HARD = {"wood_dark": (0.3, 0.1), "artificial_turf_1k": (0.5, 0.1)}
METHODS = ("refined", "paper", "klt", "orb", "phase_correlation")
#: What the tables call them, if not the same: in a column "paper" one expects figures of the paper.
IN_WORDS = {"paper": "as printed"}
#: Methods that run with every seed; the others with the first few.
ALWAYS = ("refined", "klt")
_SETTLE_FRAMES = 30
_RATIOS = "Beside KLT, root mean squares of the seeds that both have driven; straight without the two hard floors."

Run = dict[str, Any]


def make(method: str) -> Localizer:
    """Return a localizer, started with the calibrated camera."""
    camera: dict[str, Any] = {"camera": "floor"}
    localizer: Localizer
    if method == "klt":
        localizer = KLT(KLTConfig.model_validate(camera))
    elif method == "orb":
        localizer = ORB(ORBConfig.model_validate(camera))
    elif method == "phase_correlation":
        localizer = PhaseCorrelation(PhaseCorrelationConfig.model_validate(camera))
    else:
        localizer = GroundVO(GroundVOConfig.model_validate(camera | ({"preset": "paper"} if method == "paper" else {})))
    localizer.start(Session(name=method, sensors={"floor": sensor()}))
    return localizer


@dataclass
class Tracked:
    """A localizer over a drive: integrated motions, one pose per picture, and what they cost."""

    localizer: Localizer
    poses: list[Pose2] = field(default_factory=list)
    covariances: list[npt.NDArray[np.float64]] = field(default_factory=list)
    times_ms: list[float] = field(default_factory=list)
    n_lost: int = 0

    def see(self, frame: Frame) -> None:
        """Take a picture."""
        began = time.thread_time()
        said = self.localizer.observe(frame, Belief(frame.stamp_s))
        self.times_ms.append(1e3 * (time.thread_time() - began))
        pose = self.poses[-1] if self.poses else Pose2()
        covariance: npt.NDArray[np.float64] = np.zeros((3, 3))
        for estimate in said:
            if isinstance(estimate, Motion):
                pose = pose @ estimate.pose_since_now
                covariance = np.asarray(np.linalg.pinv(estimate.information), np.float64)
            self.n_lost += isinstance(estimate, Lost)
        self.poses.append(pose)
        self.covariances.append(covariance)


def odometer_m(poses: Sequence[Pose2], spacing_m: float = 0.05) -> float:
    """Return the way through poses that lie `spacing_m` apart: noise of single pictures is no way."""
    total, last = 0.0, poses[0]
    for pose in poses:
        step = last.distance_to(pose)
        if step >= spacing_m:
            total, last = total + step, pose
    return total + last.distance_to(poses[-1])


def errors_of(tracked: Tracked, truth: Sequence[Pose2], stride: int) -> Run:
    """Return the errors at the end, over stretches of `stride` pictures, and the time."""
    poses, way_m = tracked.poses, odometer_m(truth)
    turn_deg = math.degrees(wrap_angle(poses[-1].theta - truth[-1].theta))
    stretches, squares = [], []
    for first in range(_SETTLE_FRAMES, len(poses) - stride, max(1, stride // 8)):
        should = truth[first].between(truth[first + stride])
        error = should.between(poses[first].between(poses[first + stride]))
        stretches.append([100.0 * math.hypot(error.x, error.y), abs(math.degrees(error.theta))])
        spread = np.sum(tracked.covariances[first + 1 : first + stride + 1], axis=0)
        squares.append([error.x**2 / spread[0, 0], error.theta**2 / spread[2, 2]])
    over_1_m, normalised = (np.mean(part, axis=0).tolist() for part in (stretches, squares))
    return {
        "position": 100.0 * poses[-1].distance_to(truth[-1]) / way_m,
        "odometer": 100.0 * (odometer_m(poses) / way_m - 1.0),
        "heading": turn_deg / way_m,
        "position_1m": over_1_m[0],
        "heading_1m": over_1_m[1],
        "squares_along": normalised[0],
        "squares_heading": normalised[1],
        "lost": tracked.n_lost,
        "ms": float(np.median(tracked.times_ms)),
        "ms_p99": float(np.quantile(tracked.times_ms, 0.99)),
        "frames": len(poses),
    }


def line_law() -> Law:
    """Return the straight drive."""
    return straight(SPEED_MPS, sway_m=0.003, sway_s=3.0, shake_rad=math.radians(0.05))


def curve_law(n_frames: int) -> Law:
    """Return a winding drive: up to 20 px and 1.5 deg per picture, from rest."""
    poses = [Pose2()]
    for index in range(n_frames + 1):
        ease, turn_rad = min(1.0, index / 30), math.radians(1.5) * math.sin(2 * math.pi * index / 160)
        poses.append(poses[-1] @ Pose2.exp(ease * 20 * scale_m(), 0.0, ease * turn_rad))
    return lambda time_s: poses[round(time_s * RATE_HZ)]


def measured(what: str, floor: str, seed: int, methods: Sequence[str], metres: float) -> Iterator[Run]:
    """Drive once and yield a run for every method."""
    if what == "straight":
        n_frames, stride = int(metres / SPEED_MPS * RATE_HZ) + 1, round(min(1.0, metres / 2) / SPEED_MPS * RATE_HZ)
        drive = Drive(floor, line_law(), n_frames, seed)
    else:
        n_frames, stride = int(0.3 * metres / (20 * scale_m())) + 16, round(min(1.0, metres / 8) / (20 * scale_m()))
        drive = Drive(floor, curve_law(n_frames), n_frames, seed)
    all_tracked = {method: Tracked(make(method)) for method in methods}
    for frame in drive.frames():
        for tracked in all_tracked.values():
            tracked.see(frame)
    truth = drive.truth()
    for method, tracked in all_tracked.items():
        label = {"what": what, "floor": floor, "seed": seed, "method": method, "metres": metres}
        yield label | errors_of(tracked, truth, stride)


# --- from runs to rows -------------------------------------------------------------------------------------------


def rms(values: Sequence[float]) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def grouped(runs: Sequence[Run], what: str) -> Mapping[tuple[str, str], list[Run]]:
    """Return the runs of one kind by floor and method."""
    groups: dict[tuple[str, str], list[Run]] = defaultdict(list)
    for run in runs:
        if run["what"] == what:
            groups[run["floor"], run["method"]].append(run)
    return groups


def straight_rows(runs: Sequence[Run]) -> Iterator[Row]:
    """Yield position, odometer and heading of every floor and method."""
    for (floor, method), group in grouped(runs, "straight").items():
        is_ours = method == "refined" and floor in PHOTOGRAPHS
        for item, unit in UNITS.items():
            bar, stretch = BARS[item] if is_ours else (None, None)
            if floor in HARD:
                bar, stretch = HARD[floor] if is_ours and item == "position" else (None, None)
            values = [run[item] for run in group]
            yield Row(f"straight, {method}", f"{floor}: {item}", unit, rms(values), None, bar, stretch,
                      float(np.std(values)), n=len(group), seeds=len(group))  # fmt: skip
        yield Row(f"straight, {method}", f"{floor}: pictures lost", "", sum(run["lost"] for run in group),
                  bar=0.0 if is_ours else None, n=sum(run["frames"] for run in group))  # fmt: skip


def against_klt(runs: Sequence[Run]) -> Iterator[Row]:
    """Yield refined over KLT on the same pictures: geometric means over floors with the same seeds."""
    easy = [floor for floor in PHOTOGRAPHS if floor not in HARD]
    for what, items, floors in (
        ("straight", (("position", 1.0, 0.5), ("heading", 1.2, None)), easy),
        ("curve", (("position_1m", 1.2, 0.5), ("heading_1m", 1.2, 0.5)), PHOTOGRAPHS),
    ):
        groups = grouped(runs, what)
        both = [floor for floor in floors if (floor, "refined") in groups and (floor, "klt") in groups]
        if not both:
            continue
        for item, bar, stretch in items:
            ratios = [_ratio(groups[floor, "refined"], groups[floor, "klt"], item) for floor in both]
            yield Row(f"{what}, refined / KLT", f"{item}, geometric mean of {len(both)} floors", "",
                      float(np.exp(np.mean(np.log(ratios)))), None, bar, stretch, n=len(both))  # fmt: skip
        times = [float(np.median([run["ms"] for run in groups[floor, method]]))
                 for method in ("klt", "refined") for floor in both]  # fmt: skip
        faster = float(np.exp(np.mean(np.log(times[: len(both)])) - np.mean(np.log(times[len(both) :]))))
        yield Row(f"{what}, refined / KLT", "times faster", "", faster, None, 2.0, 5.0, better="higher", n=len(both))


def _ratio(ours: Sequence[Run], theirs: Sequence[Run], item: str) -> float:
    """Return the ratio of root mean squares over the seeds that both have driven."""
    seeds = {run["seed"] for run in ours} & {run["seed"] for run in theirs}
    first, second = (rms([run[item] for run in group if run["seed"] in seeds]) for group in (ours, theirs))
    return first / second


def curve_rows(runs: Sequence[Run]) -> Iterator[Row]:
    """Yield errors over 1 m of the winding line."""
    for (floor, method), group in grouped(runs, "curve").items():
        for item, unit in (("position_1m", "%"), ("heading_1m", "deg")):
            value = float(np.mean([run[item] for run in group]))
            yield Row(f"curve, {method}", f"{floor}: {item}", unit, value, n=len(group), seeds=len(group))
        yield Row(f"curve, {method}", f"{floor}: pictures lost", "", sum(run["lost"] for run in group), n=len(group))


def rows_of(runs: Sequence[Run]) -> list[Row]:
    """Return all rows."""
    return [*straight_rows(runs), *curve_rows(runs), *against_klt(runs)]


# --- the page ----------------------------------------------------------------------------------------------------


def markdown(runs: Sequence[Run]) -> str:
    """Return the tables of the page."""
    lines = (
        _table(runs, "straight", PHOTOGRAPHS) + _table(runs, "straight", BUILT_IN) + _table(runs, "curve", PHOTOGRAPHS)
    )
    ratios = list(against_klt(runs))
    if ratios:
        lines += [_RATIOS, "", "| | ours / KLT | bar | stretch | |", "|---|---|---|---|---|"]
        lines += [
            f"| {row.experiment}: {row.item} | {row.ours:.2f} | {row.bar:g} | {_short(row.stretch)} |"
            f" {'met' if row.met else 'not met'} |"
            for row in ratios
        ]
    return "\n".join(lines + _consistency(runs)) + "\n"


def _table(runs: Sequence[Run], what: str, floors: Sequence[str]) -> list[str]:
    groups = grouped(runs, what)
    shown = [floor for floor in floors if (floor, "refined") in groups]
    if not shown:
        return []
    items = ("position", "odometer", "heading") if what == "straight" else ("position_1m", "heading_1m")
    cell = "position % / odometer % / heading deg/m" if what == "straight" else "position % / heading deg"
    methods = [method for method in METHODS if any((floor, method) in groups for floor in shown)]
    lines = [f"{cell}; then median CPU ms, drives (seeds), and pictures lost where there are any.", ""]
    lines += ["| floor | " + " | ".join(IN_WORDS.get(method, method) for method in methods) + " |"]
    lines += ["|---" * (len(methods) + 1) + "|"]
    for floor in shown:
        cells = [_cell(groups[floor, method], items) if (floor, method) in groups else "" for method in methods]
        lines.append(f"| {floor} | " + " | ".join(cells) + " |")
    return [*lines, ""]


def _cell(group: Sequence[Run], items: Sequence[str]) -> str:
    figures = " / ".join(f"{rms([run[item] for run in group]):.4f}" for item in items)
    lost = sum(run["lost"] for run in group)
    time_ms = np.median([run["ms"] for run in group])
    return f"{figures}; {time_ms:.2f} ms; {len(group)}" + (f"; {lost} lost" if lost else "")


def _consistency(runs: Sequence[Run]) -> list[str]:
    groups = grouped(runs, "straight")
    about = "Squared error over 1 m, over the variance that the motions claim: 1 is honest. Along / heading."
    lines = ["", about, ""]
    lines += ["| method | geometric mean of the floors | least | most |", "|---|---|---|---|"]
    for method in METHODS:
        groups_of = [group for (_, name), group in groups.items() if name == method]
        if not groups_of:
            continue
        means = np.array([[np.mean([run[key] for run in group]) for key in ("squares_along", "squares_heading")]
                          for group in groups_of])  # fmt: skip
        parts = (np.exp(np.log(means).mean(axis=0)), means.min(axis=0), means.max(axis=0))
        cells = " | ".join(f"{part[0]:.2f} / {part[1]:.2f}" for part in parts)
        lines.append(f"| {IN_WORDS.get(method, method)} | {cells} |")
    return lines if groups else []


def _short(value: float | None) -> str:
    return "" if value is None else f"{value:g}"


# --- command line ------------------------------------------------------------------------------------------------


def main() -> None:
    """Measure what is not there yet, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--what", nargs="+", default=["straight", "curve"], choices=["straight", "curve"])
    parser.add_argument("--floors", nargs="+", help="default: all photographs that are here; without any, the painted")
    parser.add_argument("--methods", nargs="+", default=METHODS, choices=METHODS)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--peer-seeds", type=int, default=1, help="seeds of all methods but refined and klt")
    parser.add_argument("--metres", type=float, default=10.0)
    parser.add_argument("--out", type=Path, help="folder to keep runs in")
    parser.add_argument("--quick", action="store_true", help="2 m, one seed, two floors")
    parser.add_argument("--json", action="store_true", help="a list of rows")
    parser.add_argument("--markdown", action="store_true", help="the tables of the page")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    runs = _continued(options)
    rows = rows_of(runs)
    if options.markdown:
        print(markdown(runs))
        return
    if options.json:
        print(json.dumps([row.document() for row in rows], indent=2))
        return
    for row in rows:
        bar = "" if row.bar is None else f"bar {row.bar:g}  {'met' if row.met else 'NOT MET'}"
        print(f"{row.experiment:28}{row.item:48}{row.ours or 0.0:10.4f} {row.unit:8}{bar:20} n={row.n}")


def _continued(options: argparse.Namespace) -> list[Run]:
    file: Path | None = options.out and options.out / "ground_accuracy.jsonl"
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
    runs: list[Run] = [json.loads(line) for line in file.read_text().splitlines()] if file and file.is_file() else []
    done = {tuple(run[key] for key in ("what", "floor", "seed", "method", "metres")) for run in runs}
    floors = options.floors or (photographs() or BUILT_IN)[: 2 if options.quick else None]
    seeds, metres = (1, 2.0) if options.quick else (options.seeds, options.metres)
    for what in options.what:
        for seed in range(seeds):
            for floor in floors:
                methods = [
                    method
                    for method in options.methods
                    if (method in ALWAYS or seed < options.peer_seeds)
                    and (what, floor, seed, method, metres) not in done
                ]
                if not methods:
                    continue
                for run in measured(what, floor, seed, methods, metres):
                    runs.append(run)
                    if file is not None:
                        with file.open("a", encoding="utf-8") as lines:
                            lines.write(json.dumps(run) + "\n")
                print(f"{what} {floor} seed {seed}", file=sys.stderr, flush=True)
    return runs


if __name__ == "__main__":
    main()
