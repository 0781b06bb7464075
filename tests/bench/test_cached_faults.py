"""Faults that are applied once: what a run gets is the same to the byte, and never what is of another run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from trailmark.commands import Command, Stop
from trailmark.config import SourceConfig, load_run_config
from trailmark.config.base import PluginConfig
from trailmark.frames import RGBD, Frame, SensorInfo
from trailmark.interfaces import Drivable, Fault, Session
from trailmark.pipeline.sources.perturbing import Perturber
from trailmark.plugins import load_plugins
from trailmark_bench.cached_fault import CachedFault
from trailmark_bench.cached_run import with_cached_frames
from trailmark_bench.cached_source import CachedSource
from trailmark_bench.frame_cache import FrameCache


class Dirt(Fault):
    """Leaves frames as they are, delays them, loses them, or draws on them."""

    kinds = frozenset({"rgbd"})
    n_applied = 0

    def __init__(self) -> None:
        super().__init__(PluginConfig())
        self._counts: Counter[str] = Counter()

    def start(self, session) -> None:
        self._grey = int(session.rng.integers(255))

    def counters(self):
        return self._counts

    def apply(self, frame: Frame, rng: np.random.Generator, since_s: float) -> Frame | None:
        type(self).n_applied += 1
        draw = rng.random()
        if draw < 0.3:
            return frame
        self._counts["lost" if draw < 0.5 else "drawn"] += 1
        if draw < 0.5:
            return None
        assert isinstance(frame.payload, RGBD)
        worse = np.minimum(frame.payload.bgr, np.uint8(self._grey))
        return Frame(frame.sensor, frame.stamp_s + 0.15 * draw, RGBD(worse, frame.payload.depth_m))


class Robot(Drivable):
    """Draws pictures, enough of them for a fault to do all that it can."""

    def __init__(self, drives_itself: bool) -> None:
        super().__init__(SourceConfig())
        self._drives_itself = drives_itself

    def start(self, session: Session) -> None:
        self.drives_itself = self._drives_itself
        self._rng = np.random.default_rng(session.rng.bit_generator.random_raw())

    @property
    def sensors(self) -> dict[str, SensorInfo]:
        return {"rgbd": SensorInfo("rgbd", "rgbd", size=(4, 3))}

    @property
    def accepts(self) -> frozenset[type[Command]]:
        return frozenset({Stop})

    def drive(self, command: Command) -> None:
        pass

    def frames(self) -> Iterator[Frame]:
        for n in range(60):
            picture = self._rng.integers(0, 255, (3, 4, 3), dtype=np.uint8)
            yield Frame("rgbd", 0.1 * n, RGBD(picture, self._rng.random((3, 4), dtype=np.float32)))


def session(seed: int = 0) -> Session:
    return Session(name="robot", rng=np.random.default_rng(seed))


@pytest.fixture
def cache(tmp_path: Path) -> FrameCache:
    return FrameCache(tmp_path / "frames", limit_mb=1.0)


def taken(cache: FrameCache | None, told=None, n: int = 99, facts=None, *, drives_itself: bool = True) -> list[object]:
    """Return what a run gets of a robot with dirt on its lens, in bytes; with a cache, from there if it is there."""
    told = told or session()
    robot = Robot(drives_itself)
    source = robot if cache is None else CachedSource(robot, cache, {})
    made = Dirt if cache is None else lambda: CachedFault(Dirt(), source, cache, facts or {})
    perturber = Perturber("robot", {"dirt": made}, ["rgbd"])
    source.start(told)
    perturber.start(told, source.sensors)
    found: list[object] = []
    stream = perturber.frames(source.frames())
    for frame in stream:
        found.append((frame.sensor, frame.stamp_s, frame.payload.bgr.tobytes(), frame.payload.depth_m.tobytes()))
        if len(found) == n:
            break
    stream.close()
    source.close()
    perturber.close()
    return [*found, perturber.counters()]


def applied_by(run) -> int:
    before = Dirt.n_applied
    run()
    return Dirt.n_applied - before


def test_what_is_played_is_what_the_fault_made(cache: FrameCache) -> None:
    plain = taken(None)

    first = taken(cache)
    n_applied = applied_by(lambda: plain.append(taken(cache)))

    again = plain.pop()
    assert plain == first == again
    assert n_applied == 0
    assert {"perturb.dirt.lost", "perturb.dirt.drawn"} == set(first[-1])
    assert len(first) < 60


@pytest.mark.parametrize("n", [1, 7, 20])
def test_a_run_that_ends_early_gets_what_it_would_have_got_and_counts_no_more(cache: FrameCache, n: int) -> None:
    taken(cache)

    assert taken(cache, n=n) == taken(None, n=n)


def test_what_a_run_that_ended_early_saw_is_not_kept(cache: FrameCache, tmp_path: Path) -> None:
    taken(cache, n=5)

    assert list((tmp_path / "frames").iterdir()) == []


@pytest.mark.parametrize(
    "other",
    [{"told": session(1)}, {"told": replace(session(), mode="teach")}, {"facts": {"code": "new"}}],
    ids=["seed", "mode", "code"],
)
def test_what_is_of_another_run_config_or_code_is_not_taken(cache: FrameCache, other: dict) -> None:
    taken(cache)

    assert applied_by(lambda: taken(cache, **other)) == 60


def facts_of(sensors: list[str] | None) -> object:
    """Return what is known beforehand of the frames of a fault that befalls these sensors."""
    robot = {"plugin": "sim", "world": "ground_course", "perturb": {"dropped": 0.1, "sensors": sensors}}
    run = {"sources": {"robot": robot}, "localizers": {"wheels": {"plugin": "odometry"}}}
    config = load_run_config(run, plugins=load_plugins())
    (fault,) = with_cached_frames(config, FrameCache(Path("frames"), limit_mb=1.0), {}).sources["robot"].faults
    return fault.facts


def test_the_sensors_that_a_fault_befalls_have_a_say_in_its_time_and_so_in_its_frames() -> None:
    alone, both = facts_of(["floor"]), facts_of(["floor", "wheels"])

    assert alone == facts_of(["floor"])
    assert both == facts_of(["wheels", "floor"])
    assert len({str(facts) for facts in (alone, both, facts_of(None))}) == 3


def test_frames_that_hang_on_the_run_are_worsened_each_time(cache: FrameCache, tmp_path: Path) -> None:
    taken(cache, drives_itself=False)

    assert not (tmp_path / "frames").exists()
    assert applied_by(lambda: taken(cache, drives_itself=False)) == 60


def test_without_room_the_fault_is_applied_each_time(tmp_path: Path) -> None:
    small = FrameCache(tmp_path / "frames", limit_mb=1e-5)

    assert taken(small) == taken(small) == taken(None)
    assert list((tmp_path / "frames").iterdir()) == []
