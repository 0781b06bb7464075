"""How fast it is beside an older checkout: the page of speed, from one command.

    python benchmarks/speed_page.py --before 7a50250 --out DIR # that commit is checked out in DIR
    python benchmarks/speed_page.py --before ../old --only frame,husky --turns 3
    python benchmarks/speed_page.py --only peers  # beside SIFT, KLT, ORB with depth, small_gicp, gtsam and evo

The two checkouts take turns, in processes of their own, and medians are compared. An older one that has an environment
in ``.venv`` runs in it, any other with the packages of this one. Processor time counts, so that others at work on the
machine do not; only of the calls of estimators, which take microseconds, wall time is taken, the median of single
calls. A further row is a function that returns its figures by name, in `ROWS`; it is run by both checkouts, and keeps
to what both know. Recordings are found by ``TRAILMARK_DATA``.
"""

from __future__ import annotations

import argparse
import datetime as dt
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from time import process_time, thread_time
from typing import Any

TOP = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(Path(__file__).resolve().parent))

HUSKY = "examples/real/husky_bag.yaml"
MRCLAM = "examples/real/mrclam_odometry.yaml"
TUM = "examples/real/tum_rgbd.yaml"
PICTURES = """\
sources: {{cam: {{plugin: image_folder, path: {folder}, rate_hz: 10}}}}
localizers: {{v: {{plugin: constant_speed, speed_mps: 1.0}}}}
"""
WHEELS = "sources: {wheels: {plugin: csv_odometry, path: wheels.csv}}\nlocalizers: {wheels: {plugin: odometry}}\n"
LONG_RUN = 200_000  # frames: 48 minutes at 70 Hz
PEERS = "peers"
_CLOCKS = "processor time; calls of estimators: wall time, the median of single calls"


def frame() -> dict[str, float]:
    """A frame with one motion, and what dead reckoning does for it [us]."""
    import core_overhead

    rows = {row.item: row.median_us for row in core_overhead.measure(3000, 1)}
    names = {
        "a frame without a localizer": "a frame without a localizer",
        "a frame with one motion, in all": "a frame with one motion, in all",
        "the same, recorded": "the same, recorded",
        "estimator: apply": "dead reckoning: a motion",
        "estimator: fix": "dead reckoning: a fix that is 200 ms late",
        "estimator: belief": "dead reckoning: a belief",
        "estimator: belief on a path": "dead reckoning: a belief on a path",
    }
    return {f"{name} [us]": rows[item] for item, name in names.items()}


def kalman() -> dict[str, float]:
    """What the Kalman estimator does for one motion a frame and a fix at every fourteenth [us]."""
    import core_overhead

    from trailmark.estimation.kalman.estimator import Kalman
    from trailmark.estimation.kalman_config import KalmanConfig
    from trailmark.geometry import Pose2
    from trailmark.paths import Path as TaughtPath
    from trailmark.paths import Waypoint

    path = TaughtPath(Waypoint(i, 0.05 * i, Pose2(0.05 * i)) for i in range(2000))
    found = core_overhead.estimator_us(3000, None, lambda: Kalman(KalmanConfig()))
    on_path = core_overhead.estimator_us(3000, path, lambda: Kalman(KalmanConfig()))["belief"]
    names = {"apply": "a motion", "fix": "a fix that is 200 ms late", "belief": "a belief"}
    figures = {f"kalman: {name} [us]": found[key] for key, name in names.items()}
    return figures | {"kalman: a belief on a path [us]": on_path}


def husky() -> dict[str, float]:
    """Wheels, an inertial unit and the Kalman estimator, out of a bag, no report [frames/s of processor time]."""
    return {"Husky bag: wheels + imu + kalman [frames/s]": frames_per_second(HUSKY)}


def mrclam() -> dict[str, float]:
    """A table of wheel odometry, no report [frames/s of processor time]."""
    return {"MRCLAM: wheels, 61,785 frames [frames/s]": frames_per_second(MRCLAM)}


def overlap() -> dict[str, float]:
    """What of a picture's processor time the loop's own thread takes [ms]: a second core does the rest beside it."""
    import cv2
    import numpy as np

    figures = _picture_ms("TUM fr1_rpy, landmarks and orb", TUM)
    with tempfile.TemporaryDirectory() as folder:
        rng, pictures = np.random.default_rng(0), Path(folder, "image_0")
        pictures.mkdir()
        ground = cv2.GaussianBlur(rng.integers(0, 256, (376, 1400), np.uint8), (0, 0), 2.0)
        for i in range(80):  # the size and the files of KITTI's odometry, seen by a camera that moves sideways
            cv2.imwrite(str(pictures / f"{i:06d}.png"), np.ascontiguousarray(ground[:, i : i + 1241]))
        Path(folder, "pictures.yaml").write_text(PICTURES.format(folder=pictures))
        return figures | _picture_ms("a folder as KITTI's, constant speed", str(Path(folder, "pictures.yaml")))


def _picture_ms(name: str, config: str) -> dict[str, float]:
    """Return the processor time of a picture of a config, in all and of the loop's thread [ms]."""
    import trailmark

    with trailmark.Pipeline(config) as pipeline:
        steps = iter(pipeline)
        for _ in range(5):
            next(steps)
        began_s, loop_began_s = process_time(), thread_time()
        n = sum(1 for _ in steps)
        whole_ms, loop_ms = 1e3 * (process_time() - began_s) / n, 1e3 * (thread_time() - loop_began_s) / n
    return {f"{name}: a picture [ms]": whole_ms, f"{name}: of it in the loop's thread [ms]": loop_ms}


def kinect() -> dict[str, float]:
    """Landmarks of a Kinect and ORB features on the same pictures, one thread, without reading them [ms]."""
    import cv2

    import trailmark
    from trailmark.estimates import Belief
    from trailmark.geometry import Pose2
    from trailmark.interfaces import Session

    cv2.setNumThreads(1)
    source = trailmark.create("source", "tum_rgbd", path=Path(os.environ["TRAILMARK_DATA"], "rgbd", "fr1_rpy_0_5s"))
    source.start(Session(name="rgbd"))
    frames, figures = list(source.frames()), {}
    for name in ("kinect_landmarks", "orb_rgbd"):
        localizer = trailmark.create("localizer", name, camera="rgbd")
        localizer.start(Session(name=name, sensors=source.sensors, start_pose=Pose2()))
        times_ms = []
        for frame in frames:
            began_s = process_time()
            localizer.observe(frame, Belief(frame.stamp_s, Pose2()))
            times_ms.append(1e3 * (process_time() - began_s))
        figures[f"{name} on fr1_rpy: a picture [ms]"] = statistics.mean(times_ms[5:])
    return figures


def store() -> dict[str, float]:
    """The path of a store of 100,000 waypoints, read and made [s]."""
    from trailmark.geometry import Pose2
    from trailmark.interfaces import Session
    from trailmark.paths import Waypoint
    from trailmark.stores.sqlite import SqlitePathStore
    from trailmark.stores.sqlite_config import SqliteStoreConfig

    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder, "long.trail"))
        written = SqlitePathStore(SqliteStoreConfig(path=path, access="create"))
        written.start(Session())
        for i in range(100_000):
            written.append(Waypoint(i, 0.05 * i, Pose2(0.05 * i, 0.001 * (i % 7), 0.0)))
        written.commit()
        written.close()
        began_s = process_time()
        read = SqlitePathStore(SqliteStoreConfig(path=path, access="read"))
        read.start(Session())
        assert read.path() is not None
        read.close()
        return {"a store of 100,000 waypoints, opened [s]": process_time() - began_s}


def start() -> dict[str, float]:
    """From a new interpreter to the first step of a small run [ms]."""
    import trailmark

    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "wheels.csv").write_text("t,x,y,theta\n0,0,0,0\n0.1,0.01,0,0\n0.2,0.02,0,0\n")
        Path(folder, "wheels.yaml").write_text(WHEELS + "estimator: {plugin: kalman}\n")
        with trailmark.Pipeline(str(Path(folder, "wheels.yaml"))) as pipeline:
            next(iter(pipeline))
            return {"start: wheels + kalman, to the first step [ms]": 1e3 * process_time()}


def memory() -> dict[str, float]:
    """The most that a long run of one motion a frame held [MB]."""
    import core_overhead as core

    from trailmark.estimates import Motion

    class Endless(core.Blank):
        def frames(self) -> Iterator[core.Frame]:
            image = self._frames[0].payload
            return (core.Frame("floor", i / core.RATE_HZ, image) for i in range(LONG_RUN))

    class Moving(core.Ready):
        def observe(self, frame: core.Frame, belief: core.Belief) -> tuple[Motion, ...]:
            i, self._next = self._next, self._next + 1
            step = core.Pose2(core.STEP_M)
            return (Motion(i / core.RATE_HZ, (i + 1) / core.RATE_HZ, step, core.GOOD),) if i >= 0 else ()

    for _ in core.pipeline_of(Endless(1), {"a": Moving(0)}):
        pass
    most_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {f"memory: {LONG_RUN:,} frames with one motion [MB]": most_kb / 1e3}


def first() -> dict[str, float]:
    """The demo's first seconds, with no kernel compiled and with all kept [s]."""
    import first_command

    costs = first_command.measure(Path.cwd(), whole=False)
    return {f"the demo's first seconds, {kind} [s]": cost for kind, cost in costs.items()}


def demo() -> dict[str, float]:
    """The demo to its end, with its report, with no kernel compiled and with all kept [s]."""
    import first_command

    return {f"demo, {kind} [s]": cost for kind, cost in first_command.measure(Path.cwd(), whole=True).items()}


def simulator() -> dict[str, float]:
    """A picture or a scan of each simulated sensor on one core [ms]."""
    import sim_render

    figures = {}
    for row in sim_render.measure(40):
        shutter = "".join(f", {key} {row[key]}" for key in ("readout_ms", "exposure_ms") if key in row)
        figures[f"simulator: {row['world']}, {row['sensor']}{shutter} [ms]"] = row["frame_ms"]
    return figures


def absolute() -> dict[str, float]:
    """The searches of `ground_map` for a remembered patch, from the picture to the pose [ms]."""
    import cv2
    import numpy as np

    from trailmark_ground_vo.config import GroundMapConfig
    from trailmark_ground_vo.motion import ImageMotion
    from trailmark_ground_vo.patch import PatchFinder

    cv2.setNumThreads(1)
    size, rng = (512, 480), np.random.default_rng(0)
    ground = cv2.GaussianBlur(rng.normal(128.0, 150.0, size[::-1]), (0, 0), 1.5)
    turned = np.add(cv2.getRotationMatrix2D((255.5, 239.5), 1.1, 1.0), [[0.0, 0.0, 9.0], [0.0, 0.0, -7.0]])
    moved = cv2.warpAffine(ground, turned, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    seen = [np.clip(one + rng.normal(0.0, 3.0, one.shape), 0, 255).astype(np.uint8) for one in (ground, moved)]
    figures = {}
    for search in ("pyramid", "exhaustive"):
        finder = PatchFinder(GroundMapConfig.model_validate({"camera": "floor", "search": search}), size)
        patch, times_ms = finder.register(finder.view(seen[0])), []
        for _ in range(150):
            began_s = thread_time()
            found = finder.find(finder.view(seen[1]), patch, ImageMotion(0.0, 0.0, 0.0))
            times_ms.append(1e3 * (thread_time() - began_s))
            assert not found.reason
        name = f"ground_map: absolute search, picture to pose, {search} [ms]"
        figures[name] = statistics.median(times_ms[10:])
    return figures


ROWS: Mapping[str, Callable[[], dict[str, float]]] = {
    row.__name__: row
    for row in (frame, kalman, husky, mrclam, overlap, kinect, store, start, memory, first, demo, simulator, absolute)
}


def frames_per_second(config: str) -> float:
    """Return how many frames of a config are worked through in a second of processor time, the start apart."""
    import trailmark

    with trailmark.Pipeline(config) as pipeline:
        steps = iter(pipeline)
        next(steps)
        began_s = process_time()
        n = sum(1 for _ in steps)
        return n / (process_time() - began_s)


def figures_of(top: Path, row: str) -> dict[str, Any]:
    """Return the figures of a row in a checkout, measured with this very file; of ``peers:NAME`` pairs of figures."""
    own = top / ".venv" / "bin" / "python"
    command = [str(own if own.exists() else sys.executable), __file__, "--measure", row]
    packages = [] if own.exists() or top == TOP else [top / "core", *sorted((top / "plugins").iterdir())]
    paths = os.pathsep.join([*map(str, packages), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = os.environ | {"PYTHONPATH": paths}
    done = subprocess.run(command, cwd=top, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{row} failed in {top}:\n{done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


def checked_out(commit: str, folder: Path, needs_environment: bool) -> Path:
    """Return a clone of this checkout at a commit, its modules compiled as those of a checkout in use.

    Rows that start programs need its command, and so an environment of its own: of the newest packages that it takes.
    """
    top = folder.resolve() / f"before-{commit}"
    if not top.is_dir():
        subprocess.run(["git", "clone", "-q", "--shared", "--no-checkout", TOP, top], check=True)
    subprocess.run(["git", "-C", top, "checkout", "-q", "--force", commit], check=True)
    subprocess.run([sys.executable, "-m", "compileall", "-q", top / "core", top / "plugins"], check=True)
    if needs_environment and not (top / ".venv").is_dir():
        subprocess.run([sys.executable, "-m", "venv", top / ".venv"], check=True)
        subprocess.run([top / ".venv" / "bin" / "pip", "install", "-q", "-e", top], check=True)
    return top


def beside_peers(turns: int) -> dict[str, tuple[float, float]]:
    """Return the medians of all figures beside peers, theirs and ours: each turn is one process for both."""
    import speed_peers

    found: dict[str, list[tuple[float, float]]] = {}
    for _ in range(turns):
        for row in speed_peers.PEERS:
            for name, pair in figures_of(TOP, f"peers:{row}").items():
                found.setdefault(name, []).append(pair)
    return {name: tuple(map(statistics.median, zip(*pairs))) for name, pairs in found.items()}


def compared(before: Path, row: str, turns: int) -> dict[str, tuple[float, float]]:
    """Return the medians of a row's figures, before and now."""
    found: dict[str, tuple[list[float], list[float]]] = {}
    for _ in range(turns):
        for side, top in enumerate((before, TOP)):
            for name, figure in figures_of(top, row).items():
                found.setdefault(name, ([], []))[side].append(figure)
    return {name: (statistics.median(old), statistics.median(new)) for name, (old, new) in found.items()}


def cost_ratio(name: str, before: float, now: float) -> float:
    """Return the cost now beside the cost before: of a rate the inverse."""
    return before / now if name.endswith("/s]") else now / before


def _measure(row: str) -> dict[str, Any]:
    if row.startswith("peers:"):
        import speed_peers

        return speed_peers.PEERS[row.removeprefix("peers:")]()
    return ROWS[row]()


def commit_of(top: Path) -> str:
    """Return the commit of a checkout, short."""
    command = ["git", "-C", str(top), "rev-parse", "--short", "HEAD"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def main() -> None:
    """Measure, and print the page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--before", help="another checkout, or with --out an older commit of this one")
    parser.add_argument("--out", type=Path, help="folder in which the older commit is checked out")
    parser.add_argument("--only", default=",".join((*ROWS, PEERS)), help="names of rows, separated by commas")
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--measure", help=argparse.SUPPRESS)
    options = parser.parse_args()
    os.environ.setdefault("TRAILMARK_DATA", str(TOP.parent / "shared" / "data"))
    if options.measure:
        print(json.dumps(_measure(options.measure)))
        return
    rows = options.only.split(",")
    if unknown := [row for row in rows if row not in (*ROWS, PEERS)]:
        parser.error(f"--only: there is no row {', '.join(unknown)}; there are {', '.join((*ROWS, PEERS))}")
    own = [row for row in rows if row != PEERS]
    if own and options.before is None:
        parser.error("--before is needed: a figure alone says more of the machine than of the code")
    if own:
        print_before_and_now(own, options)
    if PEERS in rows:
        print_beside_peers(options.turns)


def print_before_and_now(rows: Sequence[str], options: argparse.Namespace) -> None:
    """Print the table of this checkout beside an older one."""
    starts_programs = bool({"first", "demo"} & set(rows))
    before = (
        checked_out(options.before, options.out, starts_programs) if options.out else Path(options.before).resolve()
    )
    sides = f"Commit {commit_of(before)} beside {commit_of(TOP)}"
    print(f"{sides}, medians of {options.turns} turns, {dt.date.today()}; {_CLOCKS}.\n")
    print("| work | before | now | cost: now / before |\n|---|--:|--:|--:|")
    for row in rows:
        for name, (old, new) in compared(before, row, options.turns).items():
            print(f"| {name} | {old:,.4g} | {new:,.4g} | {cost_ratio(name, old, new):.2f} |", flush=True)


def print_beside_peers(turns: int) -> None:
    """Print the table of this checkout beside other packages."""
    print(f"\nCommit {commit_of(TOP)}, medians of {turns} turns, {dt.date.today()}; processor time.\n")
    print("| ours / the peer | peer | ours | ours / peer |\n|---|--:|--:|--:|")
    for name, (peer, ours) in beside_peers(turns).items():
        print(f"| {name} | {peer:,.4g} | {ours:,.4g} | {ours / peer:.2f} |", flush=True)


if __name__ == "__main__":
    main()
