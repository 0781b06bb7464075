"""Compiling the kernels of sensors in a process beside: who reads first, who waits, and what is left behind."""

from __future__ import annotations

import sys
from dataclasses import replace

import pytest

from trailmark.geometry import Pose2
from trailmark.kernels import is_kept, kernel
from trailmark_sim import compiling
from trailmark_sim.compiling import FirstReadings
from trailmark_sim.config import SimConfig
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds import build_world
from trailmark_sim.worlds.base import World, WorldOptions

STATE = VehicleState(Pose2())
CONFIG = SimConfig(sensors=("wheels",), rates_hz={"wheels": 20})


@kernel
def never_called() -> None:
    pass


@pytest.fixture(scope="module")
def world() -> World:
    """A world with wheels, and with a kernel that nobody compiles."""
    built = build_world("ground_course", WorldOptions(sensors=("wheels",)))
    return replace(built, slow_kernel=never_called)


class Other:
    """A process that only says what was done with it."""

    def __init__(self) -> None:
        self.done: list[str] = []

    def wait(self) -> None:
        self.done.append("wait")

    def kill(self) -> None:
        self.done.append("kill")


@pytest.fixture
def other(monkeypatch: pytest.MonkeyPatch) -> Other:
    """The process beside, and two cores."""
    process = Other()
    monkeypatch.setattr(compiling, "n_cores", lambda: 2)
    monkeypatch.setattr(compiling.subprocess, "Popen", lambda *_, **__: process)
    return process


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many sensors were read, each time."""
    counts: list[int] = []
    monkeypatch.setattr(compiling, "_read_all", lambda sensors, state: counts.append(len(sensors)))
    return counts


def test_a_kernel_that_was_never_compiled_is_not_kept() -> None:
    assert not is_kept(never_called)
    assert is_kept(len)


def test_sensors_are_read_when_the_other_process_is_done(world: World, other: Other, read: list[int]) -> None:
    readings = FirstReadings(CONFIG, world, STATE)
    assert read == []

    readings.wait()
    readings.wait()
    readings.close()

    assert other.done == ["wait"]
    assert read == [1]


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

    monkeypatch.setattr(compiling, "n_cores", lambda: 2)
    monkeypatch.setattr(compiling.subprocess, "Popen", refuse)

    FirstReadings(CONFIG, world, STATE)

    assert read == [1]


def test_the_other_process_builds_the_same_sensors(read: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    arguments: list[list[str]] = []

    def note(command: list[str], **_: object) -> Other:
        arguments.append(command)
        return Other()

    monkeypatch.setattr(compiling.subprocess, "Popen", note)
    compiling._compile_beside(CONFIG)
    monkeypatch.setattr(sys, "argv", ["compiling", arguments[0][-1]])

    compiling.main()

    assert read == [1]
