"""Hostile input, by the thousand: whatever comes in, the answer is a result or an error that says what is wrong.

::

    python -m tests.trust.fuzz --cases 20000
    python -m tests.trust.fuzz --record readers.jsonl --minutes 10     # goes on where it was when it is called again

Each case is made from (target, number) alone, so that a finding is repeated by
``--only TARGET --first NUMBER --cases 1``.
"""

from __future__ import annotations

import argparse
import logging
import os
import platform
import resource
import signal
import sys
import tempfile
import time
import traceback
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from io import StringIO
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from tests.trust.records import CaseRecord, Records, commit

import trailmark
from trailmark.config import load_run_config
from trailmark.errors import TrailmarkError
from trailmark.geometry import Pose2, read_tum
from trailmark.interfaces import Session
from trailmark.paths import Keyframe, Waypoint
from trailmark.plugins import load_plugins
from trailmark.stores import SqlitePathStore, SqliteStoreConfig

PATIENCE_S = 10.0  # of processor time: the machine may have other things to do
WALL_FACTOR = 10.0  # for what waits without working
MEMORY_MIB = 1024.0
_FRAMES = 40

Rng = np.random.Generator
#: Makes one input in a folder, and gives it to the program.
Case = Callable[[Rng, Path], None]

_NUMBERS = ("nan", "inf", "-1", "1e400", "0x10", "1,5", "", "-", "1e-320", "9" * 400, "\u0661", "1_000", "null")
_WORDS = (
    *("plugin", "sources", "localizers", "estimator", "mode", "teach", "sim", "odometry", "wheels", "kalman", "path"),
    *("../../etc/passwd", "~", "${HOME}", "/dev/zero", "/dev/stdin", "a" * 5000, "\x00", "\ud7ff", "<script>", "%s"),
)


# What is done to a good input -----------------------------------------------------------------------------------------


def mutated(data: bytes, rng: Rng) -> bytes:
    """Return bytes with a few of them flipped, cut, doubled, moved or replaced by what hurts."""
    raw = bytearray(data)
    for _ in range(int(rng.integers(1, 6))):
        if not raw:
            break
        at, length = int(rng.integers(len(raw))), int(rng.integers(1, 1 + min(64, len(raw))))
        match int(rng.integers(7)):
            case 0:
                raw[at] ^= 1 << int(rng.integers(8))
            case 1:
                del raw[at:]
            case 2:
                raw[at : at + length] = rng.bytes(length)
            case 3:
                raw[at:at] = raw[at : at + length] * int(rng.integers(1, 4))
            case 4:
                del raw[at : at + length]
            case 5:
                raw[at : at + 4] = int(rng.choice([0, 0x7FFFFFFF, 0xFFFFFFFF, 0x80000000])).to_bytes(4, "little")
            case 6:
                raw[at : at + length] = bytes(length)
    return bytes(raw)


def mangled(text: str, rng: Rng) -> str:
    """Return text with words, numbers and lines replaced, doubled, swapped or lost."""
    lines = text.split("\n")
    for _ in range(int(rng.integers(1, 5))):
        row = int(rng.integers(len(lines)))
        words = lines[row].split(" ")
        word = int(rng.integers(len(words)))
        match int(rng.integers(7)):
            case 0:
                words[word] = str(rng.choice(_NUMBERS))
            case 1:
                words[word] = str(rng.choice(_WORDS))
            case 2:
                del words[word]
            case 3:
                words.insert(word, words[word])
            case 4:
                lines.insert(row, lines[int(rng.integers(len(lines)))])
            case 5:
                words = [lines[row][: int(rng.integers(len(lines[row]) + 1))]]
            case 6:
                words = words[::-1]
        lines[row] = " ".join(words)
    return "\n".join(lines)


def spoilt(data: bytes, rng: Rng) -> bytes:
    """Return a text file with wrong words, or with wrong bytes."""
    if rng.random() < 0.7:
        return mangled(data.decode(), rng).encode("utf-8", "surrogatepass")
    return mutated(data, rng)


# Targets --------------------------------------------------------------------------------------------------------------


def config(rng: Rng, folder: Path) -> None:
    """A run config, loaded and checked."""
    text = (
        "mode: track\nsources:\n  wheels: {plugin: csv_odometry, path: wheels.csv, time_offset_s: 0.1}\n"
        "  floor: {plugin: image_folder, path: ., rate_hz: 70, calibration: {metres_per_pixel: 3.9e-4}}\n"
        "localizers:\n  wheels: {plugin: odometry}\n  floor: {plugin: ground_vo, camera: floor}\n"
        "estimator: {plugin: kalman, use: [wheels, floor]}\nstart: [0, 0, 90]\nstop_when: {fix_age_m: 1.0}\nseed: 3\n"
    )
    (folder / "wheels.csv").write_text("t,x,y,theta\n0,0,0,0\n")
    path = folder / ("run.toml" if rng.random() < 0.1 else "run.yaml")
    path.write_bytes(spoilt(text.encode(), rng))
    load_run_config(path, plugins=_PLUGINS)


#: What a command line is thrown together from: commands, options, files, and what is neither.
_TOKENS = (
    *("run", "teach", "replay", "compare", "evaluate", "store", "info", "check", "plugins", "show", "schema", "init"),
    *("inspect", "doctor", "bench", "--list", "reproduce", "sim", "list", "--set", "--store", "--out", "--json", "-h"),
    *("a.yaml", "b.trail", "c.tum", "d.csv", "nowhere/", "localizers.x.plugin=klt", "seed=x", "--seed", "-1", "--"),
    *("", "--plugin", "no:sim", "./x.py", "--overwrite", "--frames", "1e9", "\ud7ff", "a" * 3000, "--align", "none"),
)


def command_line(rng: Rng, folder: Path) -> None:
    """Arguments in any order, run as a command."""
    for name in ("a.yaml", "b.trail", "c.tum", "d.csv"):
        (folder / name).write_bytes(spoilt(b"sources: {wheels: {plugin: csv_odometry, path: d.csv}}\nseed: 1\n", rng))
    chosen = [str(rng.choice(_TOKENS)) for _ in range(int(rng.integers(1, 7)))]
    from trailmark.cli import main

    out, err, before = StringIO(), StringIO(), Path.cwd()
    os.chdir(folder)
    try:
        with redirect_stdout(out), redirect_stderr(err):
            main(chosen)
    except SystemExit as end:
        code = end.code
    else:
        code = None
    finally:
        os.chdir(before)
    assert code in (0, 1, 2), f"{chosen} ended with {code!r}"
    said = out.getvalue() + err.getvalue()
    assert "Traceback" not in said, f"{chosen}: {said[-400:]}"
    assert "internal error" not in said, f"{chosen}: {said[-400:]}"


def trajectory(rng: Rng, folder: Path) -> None:
    """A trajectory in TUM format."""
    text = "# t x y z qx qy qz qw\n" + "".join(f"{0.1 * i:.1f} {0.01 * i:.2f} 0 0 0 0 0.1 0.995\n" for i in range(30))
    (folder / "a.tum").write_bytes(spoilt(text.encode(), rng))
    read_tum(folder / "a.tum")


def table(rng: Rng, folder: Path) -> None:
    """Odometry from a table."""
    text = "t,x,y,theta\n" + "".join(f"{0.1 * i:.1f},{0.01 * i:.2f},0,0\n" for i in range(30))
    (folder / "a.csv").write_bytes(spoilt(text.encode(), rng))
    _play("csv_odometry", folder / "a.csv")


def carmen(rng: Rng, folder: Path) -> None:
    """A CARMEN log."""
    ranges = " ".join("1.5" for _ in range(180))
    lines = [
        f"ODOM {0.1 * i} 0 0 0 0 0 {i} host {i}\nFLASER 180 {ranges} 0 0 0 0 0 0 {i}.5 host {i}.5" for i in range(12)
    ]
    (folder / "a.log").write_bytes(spoilt(("# CARMEN\n" + "\n".join(lines) + "\n").encode(), rng))
    _play("carmen_log", folder / "a.log")


def kitti(rng: Rng, folder: Path) -> None:
    """A KITTI sequence: times, calibration and poses."""
    path = folder / "sequences" / "00"
    (path / "image_0").mkdir(parents=True)
    (folder / "poses").mkdir()
    for i in range(4):
        (path / "image_0" / f"{i:06d}.png").write_bytes(_PNG)
    files = {
        path / "times.txt": "".join(f"{0.1 * i:e}\n" for i in range(4)),
        path / "calib.txt": "".join(f"P{i}: 718.9 0 607.2 0 0 719.1 185.2 0 0 0 1 0\n" for i in range(4)),
        folder / "poses" / "00.txt": "1 0 0 0 0 1 0 0 0 0 1 0\n" * 4,
    }
    chosen = int(rng.integers(len(files)))
    for number, (file, text) in enumerate(files.items()):
        file.write_bytes(spoilt(text.encode(), rng) if number == chosen else text.encode())
    _play("kitti_odometry", path)


def rgbd(rng: Rng, folder: Path) -> None:
    """A TUM RGB-D sequence: its lists."""
    for name in ("rgb", "depth"):
        (folder / name).mkdir()
        for i in range(3):
            (folder / name / f"{i}.png").write_bytes(_PNG if name == "rgb" else _DEPTH)
        lines = "# x\n" + "".join(f"{0.1 * i:.2f} {name}/{i}.png\n" for i in range(3))
        (folder / f"{name}.txt").write_bytes(spoilt(lines.encode(), rng) if rng.random() < 0.6 else lines.encode())
    truth = "".join(f"{0.1 * i:.2f} 0 0 {0.01 * i} 0 0 0 1\n" for i in range(3))
    (folder / "groundtruth.txt").write_bytes(spoilt(truth.encode(), rng))
    _play("tum_rgbd", folder)


def picture(rng: Rng, folder: Path) -> None:
    """Pictures that are cut, of absurd size, of another depth, or no pictures at all."""
    (folder / "p").mkdir()
    (folder / "p" / "0.png").write_bytes(_PNG)
    kind = int(rng.integers(6))
    match kind:
        case 0:
            data, name = mutated(_PNG, rng), "1.png"
        case 1:
            data, name = mutated(_JPEG, rng), "1.jpg"
        case 2:
            data, name = (
                _png_of_size(int(rng.choice([0, 1, 30000, 2**31 - 1])), int(rng.choice([0, 1, 30000]))),
                "1.png",
            )
        case 3:
            data, name = _DEPTH, "1.png"
        case 4:
            data, name = rng.bytes(int(rng.integers(0, 500))), "1.png"
        case _:
            data, name = _JPEG[: int(rng.integers(len(_JPEG)))], "1.jpg"
    (folder / "p" / name).write_bytes(data)
    _play("image_folder", folder / "p", rate_hz=10.0)


def bag(rng: Rng, folder: Path) -> None:
    """A bag with wrong bytes, or cut."""
    source = _bag()
    target = folder / "bag"
    target.mkdir()
    chosen = int(rng.integers(2))
    for number, file in enumerate(sorted(source.iterdir())):
        data = file.read_bytes()
        (target / file.name).write_bytes(mutated(data, rng) if number == chosen else data)
    _play("rosbag", target)


def store(rng: Rng, folder: Path) -> None:
    """A path store with wrong bytes, cut, or of another program."""
    path = folder / "place.trail"
    path.write_bytes(mutated(_store(), rng) if rng.random() < 0.95 else rng.bytes(3000))
    opened = SqlitePathStore(SqliteStoreConfig(path=str(path), access="append" if rng.random() < 0.2 else "read"))
    try:
        opened.start(Session("path_store"))
        opened.path()
        opened.sensors()
        for owner in opened.owners():
            opened.localizer_map(owner).keyframes()
            opened.localizer_map(owner).load("model")
    finally:
        opened.close()


def calibration(rng: Rng, folder: Path) -> None:
    """A calibration file."""
    text = "fx: 500\nfy: 500\ncx: 320\ncy: 240\ndistortion: [0.1, 0.0, 0.0, 0.0]\n"
    if rng.random() < 0.5:
        text = "metres_per_pixel: [3.9e-4, 3.9e-4]\nflat_field: flat.png\n"
        (folder / "flat.png").write_bytes(mutated(_PNG, rng))
    (folder / "a.calib.yaml").write_bytes(spoilt(text.encode(), rng))
    from trailmark.config import read_calibration

    read_calibration(folder / "a.calib.yaml")


TARGETS: dict[str, Case] = {
    case.__name__: case
    for case in (config, command_line, trajectory, table, carmen, kitti, rgbd, picture, bag, store, calibration)
}

_PLUGINS = load_plugins()
_PNG = cv2.imencode(".png", np.arange(24 * 32, dtype=np.uint8).reshape(24, 32))[1].tobytes()
_DEPTH = cv2.imencode(".png", np.arange(24 * 32, dtype=np.uint16).reshape(24, 32))[1].tobytes()
_JPEG = cv2.imencode(".jpg", np.arange(24 * 32, dtype=np.uint8).reshape(24, 32))[1].tobytes()
_made: dict[str, bytes | Path] = {}


def _play(plugin: str, path: Path, **keys: float) -> None:
    """Open a recording and read its first frames and its truth."""
    source = trailmark.create("source", plugin, plugins=_PLUGINS, path=str(path), **keys)
    try:
        source.start(Session("front"))
        for frame in islice(source.frames(), _FRAMES):
            assert np.isfinite(frame.stamp_s), f"a frame at {frame.stamp_s} s"
        source.ground_truth()
    finally:
        source.close()


def _png_of_size(width: int, height: int) -> bytes:
    """Return a PNG that says it is of a size, with hardly any data."""

    def chunk(name: bytes, data: bytes) -> bytes:
        return len(data).to_bytes(4, "big") + name + data + zlib.crc32(name + data).to_bytes(4, "big")

    header = width.to_bytes(4, "big") + height.to_bytes(4, "big") + b"\x08\x00\x00\x00\x00"
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"\0" * 100)) + chunk(b"IEND", b"")
    )


def _store() -> bytes:
    """Return the bytes of a good store."""
    if "store" not in _made:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "place.trail"
            opened = SqlitePathStore(SqliteStoreConfig(path=str(path), access="create"))
            opened.start(Session("path_store"))
            for index in range(12):
                pose = Pose2(0.05 * index, 0.0, 0.0)
                patch = np.full((44, 44), index, np.uint8)
                opened.localizer_map("floor").add(Keyframe(0.05 * index, float(index), pose, {"patch": patch}))
                opened.append(Waypoint(index, 0.05 * index, pose))
            opened.localizer_map("floor").save("model", {"weights": np.linspace(0, 1, 50)})
            opened.commit()
            opened.close()
            _made["store"] = path.read_bytes()
    data = _made["store"]
    assert isinstance(data, bytes)
    return data


def _bag() -> Path:
    """Return a good bag."""
    if "bag" not in _made:
        from rosbags.rosbag2 import Writer
        from rosbags.typesys import Stores, get_typestore

        path = Path(tempfile.mkdtemp()) / "bag"
        types = get_typestore(Stores.ROS2_HUMBLE)
        with Writer(path, version=8) as writer:
            topic = writer.add_connection("/front", "sensor_msgs/msg/Image", typestore=types)
            for i in range(5):
                stamp = types.types["builtin_interfaces/msg/Time"](sec=100 + i, nanosec=0)
                header = types.types["std_msgs/msg/Header"](stamp=stamp, frame_id="front")
                image = types.types["sensor_msgs/msg/Image"](
                    header=header, height=24, width=32, encoding="mono8", is_bigendian=0, step=32,
                    data=np.full(24 * 32, i, np.uint8),
                )  # fmt: skip
                writer.write(topic, (100 + i) * 10**9, types.serialize_cdr(image, "sensor_msgs/msg/Image"))
        _made["bag"] = path
    found = _made["bag"]
    assert isinstance(found, Path)
    return found


# Running them ---------------------------------------------------------------------------------------------------------


@dataclass
class Tally:
    """What became of the cases of a target."""

    target: str
    n: int = 0
    n_refused: int = 0
    slowest_s: float = 0.0
    findings: list[str] = field(default_factory=list)


def run(target: str, numbers: range) -> Tally:
    """Run cases of a target by their numbers."""
    tally = Tally(target)
    for number in numbers:
        rng = np.random.default_rng([zlib.crc32(target.encode()), number])
        began_s = time.process_time()
        with tempfile.TemporaryDirectory() as folder, _limited_time() as rung:
            try:
                TARGETS[target](rng, Path(folder))
            except TrailmarkError as error:
                tally.n_refused += 1
                if not str(error).strip():
                    tally.findings.append(f"{target} {number}: {type(error).__name__} says nothing")
            except Exception:
                tally.findings.append(f"{target} {number}: {traceback.format_exc(limit=-3)}")
            if rung:
                tally.findings.append(f"{target} {number}: still at it after {PATIENCE_S:g} s")
        tally.n += 1
        tally.slowest_s = max(tally.slowest_s, time.process_time() - began_s)
    return tally


@contextmanager
def _limited_time() -> Iterator[list[bool]]:
    """Interrupt what takes too long; what it gives tells that, whatever became of the exception."""
    rung: list[bool] = []

    def ring(*_: object) -> None:
        rung.append(True)
        raise TimeoutError

    timers = {
        signal.SIGPROF: (signal.ITIMER_PROF, PATIENCE_S),
        signal.SIGALRM: (signal.ITIMER_REAL, WALL_FACTOR * PATIENCE_S),
    }
    before = {number: signal.signal(number, ring) for number in timers}
    for timer, seconds in timers.values():
        signal.setitimer(timer, seconds)
    try:
        yield rung
    finally:
        for number, (timer, _) in timers.items():
            signal.setitimer(timer, 0.0)
            signal.signal(number, before[number])


def peak_mib() -> float:
    """Return the most memory that this process ever held."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def page(records: Records, command: str) -> str:
    """Return the results as a part of a page."""
    tallies = records.tallies()
    n_findings, cpu_s = sum(len(t.findings) for t in tallies.values()), sum(record.cpu_s for record in records)
    peak = max((tally.peak_mib for tally in tallies.values()), default=0.0)
    about = f"{time.strftime('%Y-%m-%d')}, trailmark {trailmark.__version__}, Python {platform.python_version()}"
    lines = [
        f"`{command}`, {about}.",
        f"{len(records)} cases in {cpu_s / 60:.1f} min of processor time, of code {records.commits()},",
        f"in processes whose memory peaked at {peak:.0f} MiB (bound: {MEMORY_MIB:.0f}): {n_findings} findings.",
        "A finding is any error that is not the program's own, an error without words, "
        f"or a case longer than {PATIENCE_S:g} s of processor time or {WALL_FACTOR * PATIENCE_S:g} s in all.",
        "",
        "| input | cases | refused | slowest [s] | findings |",
        "|---|--:|--:|--:|--:|",
    ]
    for name, tally in tallies.items():
        figures = f"{tally.n} | {tally.ended['refused']} | {tally.slowest_s:.2f} | {len(tally.findings)}"
        lines.append(f"| {name.replace('_', ' ')} | {figures} |")
    return "\n".join(lines) + "\n"


def try_case(target: str, number: int, code: str) -> CaseRecord:
    """Run a case and return what became of it."""
    tally = run(target, range(number, number + 1))
    for finding in tally.findings:
        print(finding, flush=True)
    ended, peak = "refused" if tally.n_refused else "taken", peak_mib()
    large = (f"{target} {number}: the process held {peak:.0f} MiB",) if peak > MEMORY_MIB else ()
    return CaseRecord(target, number, ended, round(tally.slowest_s, 3), round(peak, 1), (*tally.findings, *large), code)


def main() -> int:
    """Run the cases and write the page; return 1 if there are findings."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=20_000, help="of all targets together")
    parser.add_argument("--first", type=int, default=0, help="number of the first case of each target")
    parser.add_argument("--only", choices=sorted(TARGETS), help="only this target")
    parser.add_argument("--minutes", type=float, default=24 * 60.0, help="begin no case after this")
    parser.add_argument("--record", type=Path, help="file to keep each case in; what it has passed is not run again")
    options = parser.parse_args()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    logging.disable(logging.CRITICAL)
    names = [options.only] if options.only else list(TARGETS)
    numbers = range(options.first, options.first - (-options.cases // len(names)))
    records, code, until_s = Records(options.record), commit(), time.time() + 60 * options.minutes
    waiting = [(name, number) for number in numbers for name in names if not records.has_passed(name, number)]
    for name in {name for name, _ in waiting}:  # what is imported on first use is not the input's fault
        run(name, range(options.first, options.first + 1))
    for name, number in waiting:
        if time.time() > until_s:
            break
        records.add(try_case(name, number, code))
    print(page(records, f"python -m tests.trust.fuzz --cases {options.cases}"))
    return int(any(record.findings for record in records))


if __name__ == "__main__":
    sys.exit(main())
