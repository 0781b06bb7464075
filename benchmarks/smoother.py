"""The fixed-lag smoother beside the Kalman filter: error, NEES and time, on recordings and simulated drives.

Both with their default config and the same localizers, in the loop, and ``kalman`` without its ``learn_scales``: five
robots of MRCLAM data set 6, the Husky of robot_localization's tests, two mowing drives of Plaza (``TRAILMARK_DATA``),
and two simulated drives of three seeds. Errors are of the belief at every frame, without alignment; ``ago`` columns are
of what is believed of 2 s and 5 s earlier, at the same instants. Time is that of one estimate with the belief after it,
of the thread. ``--seconds`` is of MRCLAM, from the beginning.

    TRAILMARK_DATA=... python benchmarks/smoother.py [mrclam husky plaza simulated] [--seconds 300] [--markdown]
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import thread_time_ns
from typing import Any
from unittest import mock

import numpy as np
from fusion import HUSKY_END
from smoother_drives import mrclam_config, plaza_config, simulated

import trailmark
from trailmark.arrays import Floats
from trailmark.estimates import Applied, Belief, Estimate, Motion
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.smoother.estimator import Smoother
from trailmark.geometry import Pose2, Trajectory, wrap_angles
from trailmark.interfaces import Estimator, Session
from trailmark.plugins import load_plugins

ESTIMATORS: dict[str, type[Estimator]] = {"kalman": Kalman, "kalman, as told": Kalman, "smoother": Smoother}
#: What is not at its default: nobody's standard deviations are learned.
KEYS: dict[str, dict[str, Any]] = {"kalman, as told": {"learn_scales": False}}
SETS = ("mrclam", "husky", "plaza", "simulated")
AGO_S = (2.0, 5.0)
#: Of every so many frames one is asked for the past, too.
ASK_EVERY = 25


@dataclass(frozen=True, slots=True)
class Row:
    """One drive by one estimator: errors of the position [m], NEES per degree of freedom, time of an estimate [us]."""

    drive: str
    estimator: str
    n: int
    rms_m: float
    max_m: float
    nees: float
    rms_2s_ago: float
    rms_5s_ago: float
    nees_5s_ago: float
    gated: float
    motion_us: float
    fix_us: float
    p99_us: float


class Watch:
    """Times each estimate with the belief after it, and asks for the past now and then."""

    def __init__(self) -> None:
        self.motion_us: list[float] = []
        self.other_us: list[float] = []
        self.now: list[Belief] = []
        self.past: dict[float, list[Belief]] = {ago_s: [] for ago_s in AGO_S}
        self.n_gated = self.n_absolute = 0

    def applying(self, apply: Callable[[Estimator, str, Estimate], Applied]) -> Callable[..., Applied]:
        """Return `apply` of an estimator, timed."""

        def timed(estimator: Estimator, source: str, estimate: Estimate) -> Applied:
            began_ns = thread_time_ns()
            applied = apply(estimator, source, estimate)
            belief = estimator.belief()
            spent_us = (thread_time_ns() - began_ns) / 1000.0
            if isinstance(estimate, Motion):
                self.motion_us.append(spent_us)
            else:
                self.other_us.append(spent_us)
                self.n_absolute += 1
                self.n_gated += applied.status == "gated"
            self._note(estimator, belief)
            return applied

        return timed

    def _note(self, estimator: Estimator, belief: Belief) -> None:
        self.now.append(belief)
        if len(self.now) % ASK_EVERY:
            return
        for ago_s, beliefs in self.past.items():
            beliefs.append(estimator.belief(belief.stamp_s - ago_s))

    def row(self, drive: str, estimator: str, truth: Trajectory | None) -> Row:
        """Return the figures."""
        now = _judged(self.now, truth)
        past = {ago_s: _judged(beliefs, truth) for ago_s, beliefs in self.past.items()}
        both = np.array([*self.motion_us, *self.other_us])
        return Row(
            drive, estimator, now.n, now.rms_m, now.max_m, now.nees, past[2.0].rms_m, past[5.0].rms_m, past[5.0].nees,
            self.n_gated / max(1, self.n_absolute), float(np.median(self.motion_us)),
            float(np.median(self.other_us or [math.nan])), float(np.quantile(both, 0.99)),
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Judged:
    """Errors of beliefs."""

    n: int
    rms_m: float
    max_m: float
    nees: float


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="*", default=[])
    parser.add_argument("--robots", type=int, nargs="+", default=(1, 2, 3, 4, 5))
    parser.add_argument("--seconds", type=float, default=math.inf, help="of MRCLAM, from the beginning")
    parser.add_argument("--markdown", action="store_true")
    arguments = parser.parse_args()
    data = Path(os.environ.get("TRAILMARK_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not (data / "fusion").is_dir():
        sys.exit(f"no recordings at {data}; set TRAILMARK_DATA to their folder")
    mark = "|" if arguments.markdown else ""
    print(mark + f"{mark} ".join(Row.__dataclass_fields__) + mark)
    if mark:
        print("|" + "---|" * len(Row.__dataclass_fields__))
    for row in _rows(arguments.sets or list(SETS), data, arguments.robots, arguments.seconds):
        print(mark + f"{mark} ".join(_cell(getattr(row, name)) for name in Row.__dataclass_fields__) + mark, flush=True)


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return "-" if math.isnan(value) else f"{value:.3g}"
    return str(value)


def _rows(sets: list[str], data: Path, robots: list[int], seconds: float) -> Iterator[Row]:
    for robot in robots if "mrclam" in sets else ():
        for name in ESTIMATORS:
            yield recorded(f"MRCLAM {robot}", name, mrclam_config(data / "fusion" / "mrclam_D6", robot), seconds)
    for name in ESTIMATORS if "husky" in sets else ():
        yield husky(name, data / "fusion" / "rl_test1.bag")
    for number in (1, 2) if "plaza" in sets else ():
        for name in ESTIMATORS:
            with tempfile.TemporaryDirectory() as scratch:
                yield recorded(f"Plaza {number}", name, plaza_config(data / "uwb", number, Path(scratch)))
    for kind in ("late fixes", "bursts") if "simulated" in sets else ():
        for seed in range(3):
            for name in ESTIMATORS:
                yield fed(f"{kind}, seed {seed}", name, kind, seed)


def recorded(drive: str, name: str, config: dict[str, Any], seconds: float = math.inf) -> Row:
    """Return the row of a recording, or of its beginning."""
    watch = Watch()
    truth, _ = _run(
        name, config | {"estimator": {"plugin": _plugin(name)} | KEYS.get(name, {})}, watch, seconds=seconds
    )
    return watch.row(drive, name, truth)


def husky(name: str, bag: Path) -> Row:
    """Return the row of the Husky: the error is that of its end, against where robot_localization's test expects it."""
    watch = Watch()
    example = Path(__file__).parents[1] / "examples" / "real" / "husky_bag.yaml"
    keys = {"plugin": _plugin(name)} | KEYS.get(name, {})
    overrides = [f"sources.bag.path={bag}", *(f"estimator.{key}={json.dumps(value)}" for key, value in keys.items())]
    _, pose = _run(name, example, watch, overrides=overrides)
    row = watch.row("Husky (error: its end)", name, None)
    assert pose is not None
    off_m = math.hypot(pose.x - HUSKY_END[0], pose.y - HUSKY_END[1])
    return Row(
        row.drive, name, len(watch.now), off_m, *(getattr(row, key) for key in list(Row.__dataclass_fields__)[4:])
    )


def fed(drive: str, name: str, kind: str, seed: int) -> Row:
    """Return the row of a simulated drive, whose estimates come without a pipeline."""
    estimator_class, watch = ESTIMATORS[name], Watch()
    arrivals, truth = simulated(kind, seed)
    spec = load_plugins().registry.find("estimator", _plugin(name))
    estimator = estimator_class(spec.load_config().model_validate(KEYS.get(name, {})))
    estimator.start(Session("estimator", start_pose=Pose2()))
    apply = watch.applying(estimator_class.apply)
    for _, source, estimate in arrivals:
        apply(estimator, source, estimate)
    return watch.row(drive, name, truth)


def _run(
    name: str, config: Any, watch: Watch, *, overrides: Sequence[str] = (), seconds: float = math.inf
) -> tuple[Trajectory | None, Pose2 | None]:
    estimator_class, pose = ESTIMATORS[name], None
    timed = mock.patch.object(estimator_class, "apply", watch.applying(estimator_class.apply))
    with timed, trailmark.Pipeline(config, overrides=list(overrides)) as pipeline:
        first_s = None
        for step in pipeline:
            pose = step.belief.pose_map_base
            first_s = step.stamp_s if first_s is None else first_s
            if step.stamp_s > first_s + seconds:
                break
        pipeline.close()
        return pipeline.result.ground_truth, pose


def _plugin(name: str) -> str:
    return name.split(",")[0]


def _judged(beliefs: list[Belief], truth: Trajectory | None) -> Judged:
    if truth is None:
        return Judged(0, math.nan, math.nan, math.nan)
    first_s, last_s = truth.stamps_s[[0, -1]].tolist()
    of_stamp = {one.stamp_s: one for one in beliefs if first_s <= one.stamp_s <= last_s}  # the last of each stamp
    stamps = sorted(at_s for at_s, belief in of_stamp.items() if belief.covariance is not None)
    poses = [of_stamp[at_s].pose_map_base.array() for at_s in stamps]  # type: ignore[union-attr]
    covariances = [of_stamp[at_s].covariance for at_s in stamps]
    true = truth.at(stamps)
    errors: Floats = np.array(poses) - np.column_stack([true.positions, true.headings])
    errors[:, 2] = wrap_angles(errors[:, 2])
    away = np.hypot(errors[:, 0], errors[:, 1])
    nees = np.einsum("ni,ni->n", errors, np.linalg.solve(np.array(covariances), errors[:, :, np.newaxis])[:, :, 0])
    return Judged(len(away), math.sqrt(float((away**2).mean())), float(away.max()), float(nees.mean() / 3.0))


if __name__ == "__main__":
    main()
