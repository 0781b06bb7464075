"""The robot of `examples/raspberry_pi`, with stand-ins for picamera2 and gpiozero, which need the board."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from trailmark.clock import live_stamp_s
from trailmark.commands import Stop, Velocity
from trailmark.config import PluginConfig, load_run_config
from trailmark.errors import SourceError
from trailmark.interfaces import Drivable, Session
from trailmark.plugins import load_plugins
from trailmark.testing import source_checks

REPOSITORY = Path(__file__).parents[2]
AGE_S = 0.04
#: Rows of the camera are longer than its pictures, and below the greys lie the colours.
PADDED = np.random.default_rng(7).integers(0, 255, (360, 384), dtype=np.uint8)


class Camera:
    """Gives a picture every 10 ms, whose exposure began `AGE_S` ago."""

    instances: ClassVar[list[Camera]] = []

    def __init__(self) -> None:
        self.is_on = False
        self.asked: dict[str, Any] = {}
        Camera.instances.append(self)

    def create_video_configuration(self, **asked: Any) -> dict[str, Any]:
        return asked

    def configure(self, asked: dict[str, Any]) -> None:
        self.asked = asked

    def start(self) -> None:
        self.is_on = True

    def capture_request(self) -> SimpleNamespace:
        time.sleep(0.01)
        began_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - round(1e9 * AGE_S)
        return SimpleNamespace(
            make_array=lambda _: PADDED, get_metadata=lambda: {"SensorTimestamp": began_ns}, release=lambda: None
        )

    def stop(self) -> None:
        self.is_on = False

    def close(self) -> None:
        assert not self.is_on


class Motors:
    """Two motors, and every power that they were given."""

    instances: ClassVar[list[Motors]] = []

    def __init__(self, left: Any, right: Any) -> None:
        self.pins, self.given, self.is_closed = (left, right), [(0.0, 0.0)], False
        Motors.instances.append(self)

    @property
    def value(self) -> tuple[float, float]:
        return self.given[-1]

    @value.setter
    def value(self, powers: tuple[float, float]) -> None:
        assert not self.is_closed
        assert max(map(abs, powers)) <= 1.0
        self.given.append(powers)

    def stop(self) -> None:
        self.value = (0.0, 0.0)

    def close(self) -> None:
        self.is_closed = True


@pytest.fixture
def pi(monkeypatch: pytest.MonkeyPatch, load_script: Callable[[str], ModuleType]) -> ModuleType:
    camera, gpio = ModuleType("picamera2"), ModuleType("gpiozero")
    vars(camera)["Picamera2"] = Camera
    vars(gpio).update(Motor=lambda forward, backward: (forward, backward), Robot=Motors)
    monkeypatch.setitem(sys.modules, "picamera2", camera)
    monkeypatch.setitem(sys.modules, "gpiozero", gpio)
    return load_script("examples/raspberry_pi/pi_robot.py")


@pytest.fixture
def started(pi: ModuleType) -> Iterator[Callable[..., Any]]:
    robots: list[Any] = []

    def start(mode: str = "replay", **keys: Any) -> Any:
        robots.append(pi.PiRobot(pi.PiRobotConfig(**keys)))
        robots[-1].start(Session("floor", mode))
        return robots[-1]

    yield start
    for robot in robots:
        robot.close()


def test_pictures_bear_the_time_at_which_their_exposure_began(started: Callable[..., Any]) -> None:
    before_s = live_stamp_s()
    frame = next(started().frames())

    np.testing.assert_array_equal(frame.payload.pixels, PADDED[:240, :320])
    assert before_s <= frame.stamp_s + AGE_S <= live_stamp_s()  # between, however long the machine took
    assert Camera.instances[-1].asked["main"] == {"size": (320, 240), "format": "YUV420"}


def test_velocities_are_powers_of_two_motors(started: Callable[..., Any]) -> None:
    robot = started(track_m=0.2, full_speed_mps=0.5, watchdog_s=60.0)

    robot.drive(Velocity(0.25, 0.0, 1.0))

    motors = Motors.instances[-1]
    assert motors.pins == ((4, 14), (17, 18))
    assert motors.value == pytest.approx((0.3, 0.7))  # (0.25 -+ 1.0 x 0.2 / 2) / 0.5: to the left, right is quicker


def test_too_fast_a_command_is_slowed_down_and_keeps_its_curve(started: Callable[..., Any]) -> None:
    robot = started(track_m=0.2, full_speed_mps=0.5, watchdog_s=60.0)

    robot.drive(Velocity(1.0, 0.0, 5.0))

    assert Motors.instances[-1].value == pytest.approx((0.5 / 1.5, 1.0))


def test_motors_stop_when_commands_cease(started: Callable[..., Any]) -> None:
    robot = started(watchdog_s=0.05)
    robot.drive(Velocity(0.25))
    motors, until_s = Motors.instances[-1], time.monotonic() + 60.0  # a busy machine may let the watchdog wait

    while motors.value != (0.0, 0.0) and time.monotonic() < until_s:
        time.sleep(0.01)

    assert motors.given[-1] == (0.0, 0.0)
    assert (0.5, 0.5) in motors.given


def test_while_a_person_pushes_it_nothing_but_a_stop_is_given(started: Callable[..., Any]) -> None:
    robot = started("teach")

    robot.drive(Velocity(0.25))
    robot.drive(Stop("enough"))

    assert set(Motors.instances[-1].given) == {(0.0, 0.0)}


def test_closing_stops_the_motors_first(started: Callable[..., Any]) -> None:
    robot = started()
    robot.drive(Velocity(0.25))
    frames = robot.frames()
    next(frames)

    robot.close()

    assert Motors.instances[-1].given[-1] == (0.0, 0.0)
    assert Motors.instances[-1].is_closed
    assert list(frames) == []


def test_what_is_missing_is_said(pi: ModuleType, started: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    def none_there() -> Camera:
        raise IndexError("list index out of range")

    monkeypatch.setattr(sys.modules["picamera2"], "Picamera2", none_there)
    with pytest.raises(SourceError, match="no camera is found"):
        started()
    monkeypatch.setitem(sys.modules, "gpiozero", None)
    with pytest.raises(SourceError, match="gpiozero is missing: apt install python3-gpiozero"):
        started()


@pytest.mark.parametrize("name", sorted(source_checks(Drivable, PluginConfig())))
def test_the_contract(name: str, pi: ModuleType) -> None:
    source_checks(pi.PiRobot, pi.PiRobotConfig(rate_hz=100.0), n_frames=10)[name]()


def test_its_config_is_one() -> None:
    folder = REPOSITORY / "examples" / "raspberry_pi"

    run = load_run_config(folder / "pi.yaml", plugins=load_plugins(files=[folder / "pi_robot.py"]))

    assert run.sources["floor"].construct().drives_itself is False
