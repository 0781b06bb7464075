"""Landmarks in colour and depth and their peer on a real recording, side by side from one run.

    python benchmarks/kinect_landmarks.py [--seeds N] [--json | --markdown]

Every row is a localizer as a user would run it, on the first 5 s of fr1_rpy (hand-held Kinect, fast rotation; not
shipped: ``TRAILMARK_DATA``, or ``../shared/data``). Poses are projected to the plane of the first camera pose, the
truth is interpolated to the pictures' stamps and errors are after SE(2) alignment. Times are CPU time of one thread
without reading and decoding pictures; the paper reached 2 fps in a laboratory and 4 fps in a hallway, capture included.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

import trailmark
from trailmark.estimates import Belief, Fix, Motion
from trailmark.evaluation import evaluate
from trailmark.experiments import Row
from trailmark.frames import Frame, SensorInfo
from trailmark.geometry import Pose2, Trajectory
from trailmark.interfaces import Localizer, Session
from trailmark_baselines.rgbd.config import OrbRgbdConfig
from trailmark_baselines.rgbd.localizer import OrbRgbd
from trailmark_kinect_landmarks.config import FINDER_NAMES, KinectFlowConfig, KinectLandmarksConfig
from trailmark_kinect_landmarks.finders import FINDERS, WorkingImage
from trailmark_kinect_landmarks.flow import KinectFlow
from trailmark_kinect_landmarks.localizer import KinectLandmarks

SEQUENCE = "fr1_rpy_0_5s"
CAMERA = "rgbd"
ROLE: dict[str, Any] = {"camera": CAMERA}


@dataclass(frozen=True)
class Recording:
    """Decoded pictures, so that their decoding is not timed."""

    frames: Sequence[Frame]
    sensor: SensorInfo
    truth: Trajectory


@dataclass(frozen=True)
class Outcome:
    """What a localizer did on the recording."""

    pose_percent: float
    ate_m: float
    rpe_m: float
    times_ms: npt.NDArray[np.float64]


def landmarks(**settings: Any) -> Localizer:
    """Return the localizer with everything fixed, so that what is timed is what is named."""
    return KinectLandmarks(KinectLandmarksConfig(**{**ROLE, "adapt": False, **settings}))


METHODS: dict[str, Any] = {
    "all finders": lambda: landmarks(),
    "fuzzy rules choose (default)": lambda: landmarks(adapt=True),
    "blobs and rectangles": lambda: landmarks(finders=("blobs", "rectangles")),
    "all finders, found again by looks": lambda: landmarks(refind="look"),
    "all finders, centre of frame": lambda: landmarks(point="centre"),
    "all finders, as the paper": lambda: landmarks(point="centre", refind="look", angles="linear"),
    "optical flow (second mode)": lambda: KinectFlow(KinectFlowConfig(**ROLE)),
    "ORB + depth + RANSAC-Kabsch": lambda: OrbRgbd(OrbRgbdConfig(**ROLE)),
}
_BASELINE = "ORB + depth + RANSAC-Kabsch"
_QUICK = ("fuzzy rules choose (default)", _BASELINE)
_BARS = {
    "all finders": (15.0, 30.0),
    "all finders, found again by looks": (15.0, 30.0),
    "blobs and rectangles": (25.0, 60.0),
}


def load() -> Recording | None:
    """Return the recording, or None where it is missing."""
    shared = Path(__file__).parents[2] / "shared" / "data"
    folder = Path(os.environ.get("TRAILMARK_DATA", shared)) / "rgbd" / SEQUENCE
    if not folder.is_dir():
        return None
    source = trailmark.create("source", "tum_rgbd", path=folder)
    source.start(Session(name=CAMERA))
    frames = list(source.frames())
    truth = source.ground_truth()
    return Recording(frames, source.sensors[CAMERA], truth)


def play(localizer: Localizer, recording: Recording, seed: int) -> Outcome:
    """Run a localizer over the recording."""
    session = Session(
        sensors={CAMERA: recording.sensor},
        start_pose=Pose2(),
        rng=np.random.default_rng(seed),
        last_latency_s=lambda: localizer.latency_s() or 0.0,
    )
    localizer.start(session)
    pose, poses, times_ms = Pose2(), [], []
    for frame in recording.frames:
        began_s = time.process_time()
        answers = localizer.observe(frame, Belief(frame.stamp_s, pose))
        times_ms.append(1e3 * (time.process_time() - began_s))
        for answer in answers:
            if isinstance(answer, Fix | Motion):
                pose = answer.pose_map_base if isinstance(answer, Fix) else pose @ answer.pose_since_now
                poses.append((frame.stamp_s, pose))
    evaluation = evaluate(Trajectory.from_poses(poses), recording.truth)
    one_second = next((error for error in evaluation.relative if error.unit == "s"), None)
    return Outcome(
        # the first picture begins: there is nothing to say about it
        100.0 * len(poses) / (len(recording.frames) - 1),
        evaluation.absolute.position.rmse,
        one_second.position.rmse if one_second else float("nan"),
        np.array(times_ms[1:]),
    )


def rows_of(name: str, outcomes: Sequence[Outcome]) -> list[Row]:
    """Return the figures of one method, means over seeds."""
    n = len(outcomes[0].times_ms)
    times_ms = np.concatenate([outcome.times_ms for outcome in outcomes])
    ate_m, rpe_m = [o.ate_m for o in outcomes], [o.rpe_m for o in outcomes]
    fps_bar, fps_stretch = _BARS.get(name, (None, None))
    is_ours = name in ("all finders", "fuzzy rules choose (default)")
    count: dict[str, Any] = {"n": n, "seeds": len(outcomes)}
    return [
        Row(name, "pictures with a pose", "%", float(np.mean([o.pose_percent for o in outcomes])), better="higher",
            bar=90.0 if is_ours else None, stretch=98.0 if is_ours else None, **count),
        Row(name, "ATE", "m", float(np.mean(ate_m)), spread=float(np.std(ate_m)),
            bar=0.11 if is_ours else None, **count),
        Row(name, "RPE over 1 s", "m", float(np.mean(rpe_m)), spread=float(np.std(rpe_m)),
            bar=0.14 if is_ours else None, **count),
        Row(name, "rate by mean CPU time", "fps", 1e3 / float(times_ms.mean()), paper=4.0, bar=fps_bar,
            stretch=fps_stretch, better="higher", **count),
        Row(name, "CPU time p95", "ms", float(np.percentile(times_ms, 95)), bar=90.0 if is_ours else None, **count),
    ]  # fmt: skip


def comparison_rows(outcomes: Mapping[str, Sequence[Outcome]]) -> list[Row]:
    """Return the errors of ours as multiples of the baseline's, of the same run."""
    rows = []
    for name in ("all finders", "fuzzy rules choose (default)"):
        if name not in outcomes or _BASELINE not in outcomes:
            continue
        for item, value in (("ATE", "ate_m"), ("RPE over 1 s", "rpe_m")):
            ours, theirs = (float(np.mean([getattr(o, value) for o in outcomes[key]])) for key in (name, _BASELINE))
            rows.append(Row(name, f"{item} / {_BASELINE.split(' + ')[0]}'s", "", ours / theirs, stretch=1.3))
    return rows


def table(outcomes: Mapping[str, Sequence[Outcome]]) -> list[str]:
    """Return a line of Markdown for each method, means over seeds, and the spread of the trajectory error over them."""
    lines = [
        "| method | pictures with a pose | ATE [m] | 1 s RPE [m] | pictures a second | 95 % of the times [ms] |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    for name, runs in outcomes.items():
        ate_m, rpe_m = ([getattr(run, value) for run in runs] for value in ("ate_m", "rpe_m"))
        times_ms = np.concatenate([run.times_ms for run in runs])
        answered = float(np.mean([run.pose_percent for run in runs]))
        lines.append(
            f"| {name} | {answered:.0f} % | {np.mean(ate_m):.3f} ± {np.std(ate_m):.3f} | {np.mean(rpe_m):.3f}"
            f" | {1e3 / times_ms.mean():.0f} | {np.percentile(times_ms, 95):.0f} |"
        )
    return lines


def finder_rows(recording: Recording) -> list[Row]:
    """Return what each finder costs alone on every tenth picture, shared edges and colour classes included."""
    rows = []
    for name in FINDER_NAMES:
        times_ms = []
        for frame in recording.frames[::10]:
            view = WorkingImage(frame.payload.bgr, frame.payload.depth_m)  # type: ignore[union-attr]
            began_s = time.process_time()
            FINDERS[name](view)
            times_ms.append(1e3 * (time.process_time() - began_s))
        rows.append(Row("one finder alone", name, "ms", float(np.median(times_ms)), n=len(times_ms)))
    return rows


def main() -> None:
    """Measure, and print a table or JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=1, help="runs of each method")
    parser.add_argument("--quick", action="store_true", help="the default and the baseline only")
    parser.add_argument("--json", action="store_true", help="print rows as JSON")
    parser.add_argument("--markdown", action="store_true", help="print the table of the page")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    recording = load()
    if recording is None:
        raise SystemExit(f"no recording {SEQUENCE}; set TRAILMARK_DATA to the folder that holds rgbd/{SEQUENCE}")
    names = _QUICK if options.quick else tuple(METHODS)
    outcomes = {name: [play(METHODS[name](), recording, seed) for seed in range(options.seeds)] for name in names}
    if options.markdown:
        print("\n".join(table(outcomes)))
        return
    rows = [row for name in names for row in rows_of(name, outcomes[name])]
    rows += comparison_rows(outcomes)
    rows += [] if options.quick else finder_rows(recording)
    if options.json:
        print(json.dumps([row.document() for row in rows], indent=1))
        return
    for row in rows:
        bar = "" if row.bar is None else f"  bar {row.bar:g}: {'met' if row.met else 'NOT met'}"
        spread = "" if row.spread is None else f" +-{row.spread:.3f}"
        print(f"{row.experiment:<32}{row.item:<24}{row.ours:>9.3f}{spread:<9} {row.unit}{bar}")


if __name__ == "__main__":
    main()
