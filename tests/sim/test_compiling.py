"""Compiling the kernels of sensors in a process beside: who reads first, who waits, and what is left behind."""

from __future__ import annotations

import signal
import subprocess
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from trailmark.geometry import Pose2
from trailmark.kernels import is_kept
from trailmark_sim import compiling
from trailmark_sim.compiling import FirstReadings
from trailmark_sim.config import SimConfig
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds import build_world
from trailmark_sim.worlds.base import World, WorldOptions

STATE = VehicleState(Pose2())
CONFIG = SimConfig(sensors=("wheels",), rates_hz={"wheels": 20})
#: Of a camera, whose kernels compile for seconds.
CAMERA = SimConfig(sensors=("floor",), options={"camera": {"width": 96, "height": 64, "field_mm": [37.5, 25.0]}})


def never_called() -> None:
    pass


@pytest.fixture(autouse=True)
def nothing_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two cores, and no kernel on disk, wherever numba would keep one here."""
    monkeypatch.setattr("trailmark.kernels.is_kept", lambda function: False)
    monkeypatch.setattr(compiling, "n_cores", lambda: 2)


@pytest.fixture(scope="module")
def world() -> World:
    """A world with wheels, and with a kernel that nobody compiles."""
    built = build_world("ground_course", WorldOptions(sensors=("wheels",)))
    return replace(built, slow_kernel=never_called)


class Other:
    """A process that only says what was done with it; it ends at once, or when it is killed."""

    def __init__(self) -> None:
        self.done: list[str] = []
        self.stdin = None
        self.error: BaseException | None = None

    def wait(self, timeout: float) -> None:
        self.done.append("wait")
        if self.error is not None and "kill" not in self.done:
            raise self.error

    def kill(self) -> None:
        self.done.append("kill")


@pytest.fixture
def other(monkeypatch: pytest.MonkeyPatch) -> Other:
    """The process beside."""
    process = Other()
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: process)
    return process


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many sensors were read, each time."""
    counts: list[int] = []
    monkeypatch.setattr(compiling, "_read_all", lambda sensors, state: counts.append(len(sensors)))
    return counts


def test_a_kernel_that_was_never_compiled_is_not_kept() -> None:
    def kernel_of(index: dict[str, str]) -> SimpleNamespace:
        return SimpleNamespace(_cache=SimpleNamespace(_cache_file=SimpleNamespace(_load_index=lambda: index)))

    assert not is_kept(kernel_of({}))
    assert is_kept(kernel_of({"(int64,)": "code.nbc"}))
    assert is_kept(len)


def test_sensors_are_read_when_the_other_process_is_done(world: World, other: Other, read: list[int]) -> None:
    readings = FirstReadings(CONFIG, world, STATE)
    assert read == []

    readings.wait()
    readings.wait()
    readings.close()

    assert other.done[0] == "wait"
    assert read == [1]


def test_a_process_that_hangs_is_ended_and_all_is_read_here(
    world: World, other: Other, read: list[int], caplog: pytest.LogCaptureFixture
) -> None:
    other.error = subprocess.TimeoutExpired("compiling", 60.0)

    FirstReadings(CONFIG, world, STATE).wait()

    assert other.done == ["wait", "kill", "wait"]
    assert read == [1]
    assert "is not done in 60 s" in caplog.text


def test_an_interrupted_wait_ends_the_other_process(world: World, other: Other, read: list[int]) -> None:
    other.error = KeyboardInterrupt()

    with pytest.raises(KeyboardInterrupt):
        FirstReadings(CONFIG, world, STATE).wait()

    assert other.done == ["wait", "kill", "wait"]
    assert read == []


def test_a_process_that_nobody_waited_for_is_ended(world: World, other: Other, read: list[int]) -> None:
    FirstReadings(CONFIG, world, STATE).close()

    assert other.done == ["kill", "wait"]
    assert read == []


@pytest.mark.parametrize("cores", [1, 2])
def test_without_a_second_core_or_a_slow_kernel_all_is_read_here(
    world: World, other: Other, read: list[int], monkeypatch: pytest.MonkeyPatch, cores: int
) -> None:
    monkeypatch.setattr(compiling, "n_cores", lambda: cores)

    FirstReadings(CONFIG, world if cores == 1 else replace(world, slow_kernel=None), STATE).wait()

    assert read == [1]
    assert other.done == []


def test_what_does_not_start_is_done_here(world: World, read: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError("no more processes")

    monkeypatch.setattr(subprocess, "Popen", refuse)

    FirstReadings(CONFIG, world, STATE)

    assert read == [1]


def test_the_other_process_builds_the_same_sensors(read: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    arguments: list[list[str]] = []

    def note(command: list[str], **_: object) -> Other:
        arguments.append(command)
        return Other()

    monkeypatch.setattr(subprocess, "Popen", note)
    beside = compiling._compile_beside(CONFIG)
    assert beside is not None
    beside.close()

    compiling._compile_for(arguments[0][-2])

    assert read == [1]


@pytest.fixture
def real(world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[FirstReadings]:
    """Readings with a real process beside, which finds no kernel on disk and compiles for seconds."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "0")
    readings = FirstReadings(CAMERA, world, STATE)
    yield readings
    readings.close()


def process_of(readings: FirstReadings) -> subprocess.Popen[bytes]:
    assert readings._process is not None
    return readings._process._process


def test_ctrl_c_while_the_real_process_compiles_leaves_none_behind(real: FirstReadings) -> None:
    process, before = process_of(real), signal.signal(signal.SIGINT, signal.default_int_handler)
    main = threading.main_thread().ident
    assert main is not None
    timer = threading.Timer(0.5, signal.pthread_kill, (main, signal.SIGINT))
    try:
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            real.wait()
        real.close()
        assert process.poll() == -signal.SIGKILL
    finally:
        signal.signal(signal.SIGINT, before)
        process.kill()


def test_the_real_process_ends_when_this_one_is_gone(real: FirstReadings) -> None:
    process = process_of(real)
    assert process.stdin is not None
    assert real._process is not None
    folder = real._process._folder
    assert folder.exists()

    process.stdin.close()  # as the system does for a process that was killed

    assert process.wait(30.0) == -signal.SIGTERM
    assert not folder.exists()
