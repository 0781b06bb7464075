"""Frames that are rendered once: the same bytes for every cell, and never those of another run."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from trailmark.commands import Command, Stop
from trailmark.config import Document, SourceConfig, load_run_config
from trailmark.frames import RGBD, Frame, Odometry, Record, SensorInfo
from trailmark.geometry import Pose2, Trajectory
from trailmark.interfaces import Drivable, Session
from trailmark.paths import Path as TaughtPath
from trailmark.paths import Waypoint
from trailmark.plugins import load_plugins
from trailmark_bench import Index, load_bench, run_bench
from trailmark_bench.cached_source import CachedSource
from trailmark_bench.executors.config import LocalConfig
from trailmark_bench.executors.local import LocalExecutor
from trailmark_bench.frame_cache import FrameCache
from trailmark_bench.taught_cache import TaughtCache, is_repeatable


class Robot(Drivable):
    """Draws frames of every awkward sort; bumps into something at the third and after the last."""

    def __init__(self, drives_itself: bool = True) -> None:
        super().__init__(SourceConfig())
        self.n_starts = 0
        self._drives_itself = drives_itself

    def start(self, session: Session) -> None:
        self.n_starts += 1
        self.drives_itself = self._drives_itself
        self._rng = np.random.default_rng(session.rng.bit_generator.random_raw())
        self._n = self._bumps = 0

    @property
    def sensors(self) -> dict[str, SensorInfo]:
        return {"rgbd": SensorInfo("rgbd", "rgbd", size=(4, 3)), "tags": SensorInfo("tags", "tags")}

    @property
    def accepts(self) -> frozenset[type[Command]]:
        return frozenset({Stop})

    def drive(self, command: Command) -> None:
        pass

    def frames(self) -> Iterator[Frame]:
        for self._n in range(1, 7):
            self._bumps += self._n == 3
            depth = self._rng.random((3, 4), dtype=np.float32)
            depth[0, 0] = np.nan
            picture = self._rng.integers(0, 255, (6, 8, 3), dtype=np.uint8)[::2, ::2]  # strided
            payloads = [
                RGBD(picture, depth),
                Record({"ids": np.array([], dtype=np.int64), "x": self._rng.random(3)}),
                Odometry(Pose2(0.1 * self._n, -0.0, 1e-300)),
            ]
            yield Frame("rgbd" if self._n % 3 == 0 else "tags", 0.1 * self._n, payloads[self._n % 3])
        self._bumps += 1

    def ground_truth(self) -> Trajectory:
        return Trajectory.from_poses([(0.1 * k, Pose2(0.1 * k, 0.0, 0.0)) for k in range(1, self._n + 1)])

    def counters(self) -> dict[str, int]:
        return {"bumps": self._bumps}


def session(seed: int = 0, **more) -> Session:
    return Session(name="robot", rng=np.random.default_rng(seed), **more)


def taken(source: Drivable, told: Session, n: int = 99) -> list[object]:
    """Return all that a run gets of a source when it takes so many frames, in bytes."""
    source.start(told)
    found: list[object] = [source.sensors, source.accepts, source.drives_itself]
    stream = source.frames()
    for frame in stream:
        payload = frame.payload
        arrays = payload.arrays.values() if isinstance(payload, Record) else ()
        arrays = [payload.bgr, payload.depth_m] if isinstance(payload, RGBD) else list(arrays)
        assert not any(array.flags.writeable for array in arrays)
        found.append((frame.sensor, frame.stamp_s, type(payload), payload if not arrays else None))
        found.extend((array.dtype, array.shape, array.tobytes()) for array in arrays)
        n -= 1
        if n == 0:
            break
    stream.close()
    source.close()
    truth = source.ground_truth()
    return [*found, dict(source.counters()), truth.stamps_s.tobytes(), truth.poses.tobytes()]


@pytest.fixture
def cache(tmp_path: Path) -> FrameCache:
    return FrameCache(tmp_path / "frames", limit_mb=1.0)


def test_what_is_played_is_what_was_rendered(cache: FrameCache) -> None:
    robot = Robot()
    plain = taken(Robot(), session())

    first = taken(CachedSource(robot, cache, {}), session())
    second = taken(CachedSource(robot, cache, {}), session())

    assert plain == first == second
    assert robot.n_starts == 1


@pytest.mark.parametrize("n", [1, 2, 3, 5, 6])
def test_a_run_that_ends_early_gets_what_it_would_have_got(cache: FrameCache, n: int) -> None:
    taken(CachedSource(Robot(), cache, {}), session())

    assert taken(CachedSource(Robot(), cache, {}), session(), n) == taken(Robot(), session(), n)


@pytest.mark.parametrize(
    "other", [{"seed": 1}, {"mode": "teach"}, {"start_pose": Pose2(1.0, 0.0, 0.0)}, {"name": "other"}], ids=str
)
def test_frames_of_another_run_are_not_taken(cache: FrameCache, other: dict) -> None:
    robot = Robot()
    taken(CachedSource(robot, cache, {}), session())
    told = session(other.pop("seed", 0))

    taken(CachedSource(robot, cache, {}), replace(told, **other))
    assert robot.n_starts == 2


def test_frames_of_other_settings_or_code_are_not_taken(cache: FrameCache) -> None:
    robot = Robot()
    taken(CachedSource(robot, cache, {"code": "old"}), session())

    taken(CachedSource(robot, cache, {"code": "new"}), session())

    assert robot.n_starts == 2


def test_frames_that_hang_on_the_run_are_not_kept(cache: FrameCache, tmp_path: Path) -> None:
    taken(CachedSource(Robot(drives_itself=False), cache, {}), session())

    assert not (tmp_path / "frames").exists()


def test_frames_beside_a_taught_path_are_those_of_that_path(cache: FrameCache) -> None:
    one, other = ([Waypoint(0, 0.0, Pose2()), Waypoint(1, 1.0, Pose2(1.0, y_m, 0.0))] for y_m in (0.0, 1e-9))
    robot = Robot()
    taken(CachedSource(robot, cache, {}), session())

    starts = []
    for waypoints in (one, other, one):
        taken(CachedSource(robot, cache, {}), session(path=TaughtPath(waypoints)))
        starts.append(robot.n_starts)

    assert starts == [2, 3, 3]


def test_frames_of_a_run_that_ended_early_are_not_kept(cache: FrameCache, tmp_path: Path) -> None:
    taken(CachedSource(Robot(), cache, {}), session(), 3)

    assert list((tmp_path / "frames").iterdir()) == []


@pytest.mark.parametrize("file", ["frames.bin", "index.json"])
def test_a_damaged_archive_is_rendered_anew(cache: FrameCache, tmp_path: Path, file: str) -> None:
    taken(CachedSource(Robot(), cache, {}), session())
    (archive,) = (tmp_path / "frames").iterdir()
    (archive / file).chmod(0o644)
    with (archive / file).open("rb+") as damaged:
        damaged.truncate(40)

    assert taken(CachedSource(Robot(), cache, {}), session()) == taken(Robot(), session())


def test_what_was_not_used_for_longest_makes_room(tmp_path: Path) -> None:
    cache = FrameCache(tmp_path, limit_mb=0.04)  # four archives of two blocks and their folder
    for seed in range(8):
        taken(CachedSource(Robot(), cache, {}), session(seed))
        for age, place in enumerate(sorted(tmp_path.iterdir(), key=os.path.getmtime, reverse=True)):
            os.utime(place, (1e9 - age, 1e9 - age))
    again = Robot()
    taken(CachedSource(again, cache, {}), session(7))
    gone = Robot()
    taken(CachedSource(gone, cache, {}), session(0))

    assert (again.n_starts, gone.n_starts) == (0, 1)
    assert len(list(tmp_path.iterdir())) <= 5


def test_frames_larger_than_the_cache_are_not_kept(tmp_path: Path) -> None:
    cache = FrameCache(tmp_path / "frames", limit_mb=0.0001)

    assert taken(CachedSource(Robot(), cache, {}), session()) == taken(Robot(), session())
    assert list((tmp_path / "frames").iterdir()) == []


FIGURES = ("metrics.json", "estimates.csv", "config.yaml", "trajectories/fused.tum", "trajectories/groundtruth.tum")


@pytest.fixture
def taught(tmp_path: Path) -> tuple[Path, Path]:
    """Return a store and the folder of the run that taught it."""
    (tmp_path / "teach" / "trajectories").mkdir(parents=True)
    (tmp_path / "teach" / "trajectories" / "fused.tum").write_text("0 0 0\n")
    (tmp_path / "place.trail").write_bytes(b"taught")
    return tmp_path / "place.trail", tmp_path / "teach"


def test_what_was_taught_is_copied_as_it_was(cache: FrameCache, taught: tuple[Path, Path], tmp_path: Path) -> None:
    store, run = taught
    places = TaughtCache(cache, {}, threads=1)
    places.keep("key", store, run)
    store.write_bytes(b"what a run made of it")
    there, its_run = tmp_path / "other.trail", tmp_path / "other"

    assert not places.copy_to("another", there, its_run)
    assert not there.exists()
    assert not its_run.exists()
    assert places.copy_to("key", there, its_run)
    assert there.read_bytes() == b"taught"
    assert (its_run / "trajectories" / "fused.tum").read_text() == "0 0 0\n"


@pytest.mark.parametrize("damage", ["a file is gone", "the store is cut", "half of it is removed", "no index"])
def test_a_damaged_place_is_taught_anew_and_mended(
    cache: FrameCache, taught: tuple[Path, Path], tmp_path: Path, damage: str
) -> None:
    places = TaughtCache(cache, {}, threads=1)
    places.keep("key", *taught)
    kept = cache.place_of("key")
    if damage == "the store is cut":
        (kept / "store").write_bytes(b"tau")
    elif damage == "no index":
        (kept / "index.json").unlink()
    else:
        (kept / "run" / "trajectories" / "fused.tum").unlink()
    if damage == "half of it is removed":
        (kept / "run" / "trajectories").rmdir()
    there, its_run = tmp_path / "other.trail", tmp_path / "other"

    assert not places.copy_to("key", there, its_run)
    assert not there.exists()
    assert not its_run.exists()
    places.keep("key", *taught)
    assert places.copy_to("key", there, its_run)
    assert there.read_bytes() == b"taught"


def test_what_makes_room_is_gone_as_a_whole(cache: FrameCache, taught: tuple[Path, Path], monkeypatch) -> None:
    TaughtCache(cache, {}, threads=1).keep("key", *taught)
    removed: list[Path] = []
    with monkeypatch.context() as killed:  # as if it was killed before the first file was removed
        killed.setattr("trailmark_bench.frame_cache.shutil.rmtree", lambda place, **_: removed.append(place))
        cache.make_room(cache.limit_mb)

    assert [place.exists() for place in removed] == [True]
    assert not cache.place_of("key").exists()
    cache.make_room(cache.limit_mb)
    assert not removed[0].exists()


def test_places_make_room_for_each_other_and_for_frames(tmp_path: Path, taught: tuple[Path, Path]) -> None:
    cache = FrameCache(tmp_path / "frames", limit_mb=0.04)
    for k in range(9):
        TaughtCache(cache, {}, threads=1).keep(f"key-{k}", *taught)
    assert len(list((tmp_path / "frames").iterdir())) <= 5

    TaughtCache(FrameCache(tmp_path / "none", limit_mb=1e-6), {}, threads=1).keep("key", *taught)
    assert list((tmp_path / "none").iterdir()) == []


def test_a_teaching_hangs_on_its_seed_and_not_on_where_its_store_lies() -> None:
    run = {"mode": "teach", "sources": {"robot": {"plugin": "sim"}}, "localizers": {"wheels": "odometry"}}
    config = load_run_config(Document(run), plugins=load_plugins())
    places = TaughtCache(FrameCache(Path("nowhere"), 1.0), {}, threads=1)

    other_seed = replace(config, document={**config.document, "seed": 7})

    assert places.key_of(config.with_store(Path("a.trail"))) == places.key_of(config.with_store(Path("b.trail")))
    assert places.key_of(config) != places.key_of(other_seed)
    assert places.key_of(config) != TaughtCache(FrameCache(Path("nowhere"), 1.0), {}, threads=2).key_of(config)
    assert is_repeatable(config)
    live = replace(config, settings=config.settings.model_copy(update={"pace": "realtime"}))
    assert not is_repeatable(live)


def test_a_bench_says_the_same_whether_frames_are_rendered_once_or_each_time(tmp_path: Path) -> None:
    source = {"plugin": "sim", "world": "ground_course", "duration_s": 1, "sensors": ["floor", "wheels"]}
    cells = {
        "localizers": ["klt", "odometry"],
        "perturbations": {
            "clean": {},
            "noise": {"sensors": ["floor"], "noise": 12},
            "several": {"dropped": 0.2, "late_s": 0.02, "specks": {}, "cover": {"from_s": 0.3, "to_s": 0.6}},
        },
        "seeds": [3],
    }
    document = {"sources": {"robot": source}, "bench": {"code": "version", "cells": cells}}
    bench = load_bench(document, plugins=load_plugins())
    said = {}
    for name, frames_mb in (("each", 0), ("once", 500)):
        with Index(tmp_path / name, write=True) as index:
            run_bench(bench.cells, index, LocalExecutor(LocalConfig(jobs=1, frames_mb=frames_mb)))
            said[name] = {record.label: record.result["metrics"] for record in index.records()}

    assert said["each"] == said["once"]
    assert len(said["once"]) == 6
    for cell in bench.cells:
        each, once = (tmp_path / name / "cells" / cell.id / "run" for name in ("each", "once"))
        assert all((each / file).read_bytes() == (once / file).read_bytes() for file in FIGURES), cell.label
    counted = [json.loads((tmp_path / "once" / "cells" / cell.id / "result.json").read_bytes()) for cell in bench.cells]
    assert sum("source.robot.perturb.dropped" in one["counters"] for one in counted) == 2
    # frames, those with noise, and of several faults: the first of each sensor, two more of the camera
    assert len(list((tmp_path / "once" / "frames").iterdir())) == 1 + 1 + 4
    assert not (tmp_path / "each" / "frames").exists()


def test_a_bench_says_the_same_whether_a_place_is_taught_once_or_each_time(tmp_path: Path) -> None:
    source = {"plugin": "sim", "world": "ground_course", "duration_s": 2, "sensors": ["wheels"], "driver": "route"}
    cells = {"perturbations": {"clean": {}, "gaps": {"dropped": 0.3}}, "localizers": ["odometry"], "seeds": [3]}
    section = {"code": "version", "judging": {"align": "none"}, "teach": {}, "cells": cells}
    bench = load_bench({"sources": {"robot": source}, "bench": section}, plugins=load_plugins())
    for name, frames_mb in (("each", 0), ("once", 500)):
        with Index(tmp_path / name, write=True) as index:
            run_bench(bench.cells, index, LocalExecutor(LocalConfig(jobs=1, frames_mb=frames_mb)))
            assert [record.state for record in index.records()] == ["ok", "ok"]

    files = [f"run/{name}" for name in FIGURES if name != "config.yaml"]  # which says where the store was
    files += ["teach/trajectories/fused.tum", "teach/estimates.csv"]
    for cell in bench.cells:
        each, once = (tmp_path / name / "cells" / cell.id for name in ("each", "once"))
        assert all((each / file).read_bytes() == (once / file).read_bytes() for file in files), cell.label
    archives = list((tmp_path / "once" / "frames").iterdir())
    assert len(archives) == 4  # frames of the teaching, of the replay that is common to both, its gaps, and the store
    assert sum((place / "store").exists() for place in archives) == 1
