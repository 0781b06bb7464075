"""What the core itself costs at every frame: frames, parts that do nothing, and a clock.

A run of empty frames through the real pipeline is timed as a whole, once without a localizer and once with N that
do nothing; the difference by N is the cost of one localizer. Processor time counts, so that others at work on the
machine do not. Prints a table, or with ``--json`` a list of rows. With ``--before`` another checkout, by its own
interpreter in ``.venv``, takes turns with this one. The bar is 50 us per frame and localizer (median of the
repetitions).

    python benchmarks/core_overhead.py [--frames 5000] [--repeat 7] [--quick] [--json] [--before ../old]
"""

from __future__ import annotations

import argparse
import gc
import json
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter_ns, process_time_ns

import numpy as np

from trailmark.config import SourceConfig
from trailmark.estimates import Belief, Estimate, Fix, Motion, information_from_sigmas
from trailmark.estimation.dead_reckoning import DeadReckoning
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.frames import Frame, Image, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Estimator, FrameSource, Localizer, Session
from trailmark.paths import Path as TaughtPath
from trailmark.paths import Waypoint
from trailmark.pipeline import Pipeline

try:
    from trailmark.pipeline import LocalizerPart, Parts, SourceStream
except ImportError:  # an older checkout, beside this one
    Parts = None

BAR_US = 50.0
RATE_HZ = 70.0
STEP_M = 0.0037  # one frame of the ground-camera paper
GOOD = information_from_sigmas(1e-4, 1e-4, 1e-4)
#: Motions by which a fix is late: 200 ms.
_LATE = 14


class Blank(FrameSource):
    """The same picture again and again."""

    def __init__(self, n: int) -> None:
        super().__init__(None)
        image = Image(np.zeros((480, 512), np.uint8))
        self._frames = [Frame("floor", i / RATE_HZ, image) for i in range(n)]

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        """One camera."""
        return {"floor": SensorInfo("floor", "image", (512, 480))}

    def frames(self) -> Iterator[Frame]:
        """Yield frames that were made before."""
        yield from self._frames


class Idle(Localizer):
    """Looks at nothing and says nothing."""

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return nothing."""
        return ()


class Ready(Localizer):
    """Says what it was given: one motion a frame, made before. As wheel odometry it does not look at the belief."""

    uses_belief = False

    def __init__(self, n: int) -> None:
        super().__init__(None)
        step = Pose2(STEP_M)
        self._motions = [(Motion(i / RATE_HZ, (i + 1) / RATE_HZ, step, GOOD),) for i in range(n)]

    def start(self, session: Session) -> None:
        """Begin at the first frame."""
        self._next = -1

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return the motion until this frame."""
        self._next += 1
        return self._motions[self._next - 1] if self._next else ()


@dataclass(frozen=True)
class Row:
    """One measurement [us]."""

    item: str
    median_us: float
    best_us: float
    worst_us: float


def pipeline_of(source: FrameSource, localizers: Mapping[str, Localizer], out: Path | None = None) -> Pipeline:
    """Return a run of these parts."""
    if Parts is None:
        return _old_pipeline_of(source, localizers, out)
    parts = Parts(
        estimator=dead_reckoning(),
        sources=[SourceStream("floor", source, SourceConfig())],
        localizers=[LocalizerPart(name, localizer, frozenset({"floor"})) for name, localizer in localizers.items()],
    )
    return Pipeline(parts, out=out)


def _old_pipeline_of(source: FrameSource, localizers: Mapping[str, Localizer], out: Path | None) -> Pipeline:
    """Return the same in a checkout from before `Parts`."""
    from trailmark.pipeline import Feed, Plan, PlannedLocalizer, Settled

    planned = [PlannedLocalizer(name, localizer, frozenset({"floor"})) for name, localizer in localizers.items()]
    settle = lambda sensors, names_of: Settled(planned)  # noqa: E731
    feeds = [Feed("floor", source, SourceConfig())]
    return Pipeline(Plan(settle, dead_reckoning(), feeds), out=out)


def frame_us(n: int, localizers: Mapping[str, Localizer], out: Path | None = None) -> float:
    """Return the mean time of a frame in one run [us]."""
    pipeline = pipeline_of(Blank(n), localizers, out)
    pipeline.start()
    gc.collect()
    began_ns = process_time_ns()
    for _ in pipeline:
        pass
    return (process_time_ns() - began_ns) / n / 1e3


def dead_reckoning() -> Estimator:
    """Return the estimator that runs without a choice have."""
    return DeadReckoning(DeadReckoningConfig())


def estimator_us(n: int, path: TaughtPath | None, make: Callable[[], Estimator] = dead_reckoning) -> dict[str, float]:
    """Return the median time of an apply, a belief, and a fix late by `_LATE` motions with the belief after it [us].

    What follows a late fix is done again by then. All that is told agrees. Of single calls: the few in which others
    had the processor do not count.
    """
    estimator = make()
    estimator.start(Session(start_pose=Pose2(), path=path))
    spent_ns: dict[str, list[int]] = {"apply": [], "belief": [], "fix": []}
    for i in range(n):
        motion = Motion(i / RATE_HZ, (i + 1) / RATE_HZ, Pose2(STEP_M), GOOD)
        t0 = perf_counter_ns()
        estimator.apply("vo", motion)
        t1 = perf_counter_ns()
        estimator.belief(motion.stamp_s)
        t2 = perf_counter_ns()
        spent_ns["apply"].append(t1 - t0)
        spent_ns["belief"].append(t2 - t1)
        if i % _LATE == _LATE - 1:
            fix = Fix(motion.stamp_s - _LATE / RATE_HZ, Pose2(STEP_M * (i + 1 - _LATE)), GOOD)
            t0 = perf_counter_ns()
            estimator.apply("map", fix)
            estimator.belief(motion.stamp_s)
            spent_ns["fix"].append(perf_counter_ns() - t0)
    return {name: statistics.median(times_ns) / 1e3 for name, times_ns in spent_ns.items()}


def measure(n: int, repeat: int) -> list[Row]:
    """Return all rows; each is measured `repeat` times, interleaved, after one run to warm up."""
    path = TaughtPath(Waypoint(i, 0.05 * i, Pose2(0.05 * i)) for i in range(2000))
    samples: dict[str, list[float]] = {}
    for round_ in range(repeat + 1):
        with tempfile.TemporaryDirectory() as folder:
            none = frame_us(n, {})
            found = {
                "a frame without a localizer": none,
                "one localizer that does nothing": frame_us(n, {"a": Idle(None)}) - none,
                "each of four that do nothing": (frame_us(n, {name: Idle(None) for name in "abcd"}) - none) / 4,
                "a frame with one localizer, in all": frame_us(n, {"a": Idle(None)}),
                "a frame with one motion, in all": frame_us(n, {"a": Ready(n)}),
                "the same, recorded": frame_us(n, {"a": Ready(n)}, Path(folder) / "run"),
            }
        found |= {f"estimator: {name}": us for name, us in estimator_us(n, None).items()}
        found["estimator: belief on a path"] = estimator_us(n, path)["belief"]
        if round_:
            for name, us in found.items():
                samples.setdefault(name, []).append(us)
    return [
        Row(name, round(statistics.median(us), 2), round(min(us), 2), round(max(us), 2)) for name, us in samples.items()
    ]


def rows_of(top: Path, n: int, repeat: int) -> list[Row]:
    """Return the rows of a checkout, measured by its own interpreter with this very file."""
    python = top / ".venv" / "bin" / "python"
    command = [str(python if python.exists() else sys.executable), __file__, "--json"]
    command += ["--frames", str(n), "--repeat", str(repeat)]
    done = subprocess.run(command, cwd=top, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{top} failed:\n{done.stderr}")
    return [Row(**{key: row[key] for key in Row.__dataclass_fields__}) for row in json.loads(done.stdout)]


def compare(before: Path, n: int, repeat: int) -> list[tuple[str, float, float]]:
    """Return item, median before and median now [us]; the two checkouts take turns."""
    found: dict[str, tuple[list[float], list[float]]] = {}
    for _ in range(repeat):
        for side, top in enumerate((before, Path(__file__).resolve().parents[1])):
            for row in rows_of(top, n, 1):
                found.setdefault(row.item, ([], []))[side].append(row.median_us)
    return [(item, *map(statistics.median, sides)) for item, sides in found.items()]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=5000)
    parser.add_argument("--repeat", type=int, default=7)
    parser.add_argument("--quick", action="store_true", help="fewer frames and repetitions")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--before", type=Path, help="another checkout, beside this one")
    options = parser.parse_args()
    if options.quick:
        options.frames, options.repeat = 1000, 3
    if options.before is not None:
        print(f"{'':38}{'before':>9}{'now':>9}{'ratio':>9}   [us], {options.repeat} turns of {options.frames} frames")
        for item, before_us, now_us in compare(options.before.resolve(), options.frames, options.repeat):
            print(f"{item:38}{before_us:9.2f}{now_us:9.2f}{now_us / before_us:9.2f}")
        return
    rows = measure(options.frames, options.repeat)
    if options.json:
        print(json.dumps([vars(row) | {"bar_us": BAR_US} for row in rows], indent=2))
        return
    print(f"{'':38}{'median':>9}{'best':>9}{'worst':>9}   [us], {options.repeat} runs of {options.frames} frames")
    for row in rows:
        print(f"{row.item:38}{row.median_us:9.2f}{row.best_us:9.2f}{row.worst_us:9.2f}")
    print(f"bar: {BAR_US:g} us per frame and localizer")


if __name__ == "__main__":
    main()
