"""Driving by hand."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator

import numpy as np
import pytest

from trailmark.commands import Steer4WS, Stop, Velocity
from trailmark.errors import ConfigError
from trailmark.interfaces import Session
from trailmark_sim.config import SimConfig
from trailmark_sim.keyboard import KeyboardPilot, Terminal
from trailmark_sim.source import SimSource
from trailmark_sim.vehicles import Differential, FourWheelSteering, VehicleState

pty = pytest.importorskip("pty", reason="no terminals of this kind on this system")


@pytest.fixture
def keys() -> Iterator[tuple[int, Terminal]]:
    """Give the far end of a terminal, to type at, and the terminal."""
    far, near = pty.openpty()
    terminal = Terminal(near)
    yield far, terminal
    terminal.close()
    os.close(far)
    os.close(near)


def test_keys_come_without_enter_and_once(keys: tuple[int, Terminal]) -> None:
    far, terminal = keys
    os.write(far, b"wwa")

    assert terminal.read_keys() == "wwa"
    assert terminal.read_keys() == ""


def test_a_closed_terminal_is_as_it_was_and_gives_no_keys() -> None:
    import termios

    far, near = pty.openpty()
    before = termios.tcgetattr(near)
    terminal = Terminal(near)
    assert termios.tcgetattr(near) != before
    os.write(far, b"w")

    terminal.close()
    terminal.close()

    assert termios.tcgetattr(near) == before
    assert terminal.read_keys() == ""


def test_keys_change_speed_and_steering_step_by_step(keys: tuple[int, Terminal]) -> None:
    far, terminal = keys
    pilot = KeyboardPilot(FourWheelSteering(max_speed_mps=0.5), terminal)

    os.write(far, b"wwwaa")
    command = pilot.step(VehicleState())

    assert isinstance(command, Steer4WS)
    assert command.speed_mps == pytest.approx(0.15)
    assert command.front_rad == pytest.approx(np.arctan(0.2 * FourWheelSteering().wheelbase_m / 2))
    assert command.rear_rad == -command.front_rad
    os.write(far, b"sc")
    assert pilot.step(VehicleState()) == Steer4WS(0.0, -0.0, pytest.approx(0.10))
    os.write(far, b" ")
    assert pilot.step(VehicleState()) == Steer4WS(0.0, -0.0, 0.0)


def test_speed_and_steering_end_somewhere(keys: tuple[int, Terminal]) -> None:
    far, terminal = keys
    pilot = KeyboardPilot(Differential(), terminal)

    os.write(far, b"s" * 30 + b"d" * 40)
    command = pilot.step(VehicleState())

    assert command == Velocity(-0.3, 0.0, pytest.approx(1.3 * 0.3))


def test_a_vehicle_that_can_turns_on_the_spot(keys: tuple[int, Terminal]) -> None:
    far, terminal = keys
    os.write(far, b"aaa")

    command = KeyboardPilot(Differential(), terminal).step(VehicleState())

    assert command == Velocity(0.0, 0.0, pytest.approx(0.3 * 0.3 * 0.3))


def test_q_ends_the_run(keys: tuple[int, Terminal]) -> None:
    far, terminal = keys
    os.write(far, b"q")

    assert KeyboardPilot(Differential(), terminal).step(VehicleState()) == Stop("q was pressed", done=True)


def test_what_is_no_terminal_is_refused(tmp_path: object) -> None:
    reading, writing = os.pipe()
    try:
        with pytest.raises(ConfigError, match="needs a terminal to read keys from"):
            Terminal(reading)
    finally:
        os.close(reading)
        os.close(writing)


def test_the_source_can_be_driven_by_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    far, near = pty.openpty()
    monkeypatch.setattr(sys, "stdin", os.fdopen(near, "r", closefd=False))
    source = SimSource(SimConfig(driver="keyboard", sensors=("wheels",)))

    source.start(Session(name="robot", mode="teach"))
    os.write(far, b"wwww")
    for frame in source.frames():
        if frame.stamp_s == 2.0:
            os.write(far, b"q")
    source.close()

    assert source.drives_itself
    assert source.ground_truth().length_m() == pytest.approx(0.2 * 2.0, abs=0.03)
    os.close(far)
    os.close(near)
