"""A robot, and parts that stand still or hang where a test wants it; loaded as a plugin of one file.

What happens to the robot is written to the file that ``log`` names, a line each, at once.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from trailmark import hookimpl
from trailmark.clock import live_stamp_s
from trailmark.commands import Command, Stop, Velocity
from trailmark.config import OutputPath, PluginConfig, Sensor, SourceConfig
from trailmark.estimates import Belief, Estimate, Motion, information_from_sigmas
from trailmark.frames import Frame, Image, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Controller, Drivable, Localizer, Session

GOOD = information_from_sigmas(1e-3, 1e-3, 1e-3)
_ENDLESS_S = 600.0


class ToyConfig(SourceConfig):
    """Where to write what happens, and what to do badly."""

    log: OutputPath = Path("robot.log")
    n: int = 1_000_000
    rate_hz: float = 20.0
    live: bool = True
    slow_start_s: float = 0.0
    drives_itself: bool = False
    hangs: Literal["", "drive", "close", "close stubbornly"] = ""


class ToyRobot(Drivable):
    """Gives pictures, and writes down what it is told."""

    config: ToyConfig

    @property
    def is_live(self) -> bool:
        return self.config.live

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        return {"eye": SensorInfo("eye", "image")}

    @property
    def accepts(self) -> frozenset[type[Command]]:
        return frozenset({Velocity, Stop})

    def start(self, session: Session) -> None:
        self.drives_itself = self.config.drives_itself
        self._is_closed = False
        self._n_commands = 0
        self.write("start")
        time.sleep(self.config.slow_start_s)

    def frames(self) -> Iterator[Frame]:
        picture = np.random.default_rng(7).integers(0, 255, (60, 80)).astype(np.uint8)
        for i in range(self.config.n):
            if self._is_closed:
                return
            stamp_s = live_stamp_s() if self.config.live else i / self.config.rate_hz
            yield Frame("eye", stamp_s, Image(np.roll(picture, round(100 * stamp_s))))
            if self.config.live:
                time.sleep(1.0 / self.config.rate_hz)

    def drive(self, command: Command) -> None:
        self.write(f"drive {type(command).__name__} {getattr(command, 'reason', '')}".rstrip())
        self._n_commands += not isinstance(command, Stop)
        if self.config.hangs == "drive" and self._n_commands == 5 and not isinstance(command, Stop):
            time.sleep(_ENDLESS_S)

    def close(self) -> None:
        self._is_closed = True
        self.write("close")
        if self.config.hangs == "close":
            time.sleep(_ENDLESS_S)
        while self.config.hangs == "close stubbornly":
            try:
                time.sleep(_ENDLESS_S)
            except KeyboardInterrupt:
                continue

    def write(self, line: str) -> None:
        with open(self.config.log, "a", encoding="utf-8") as log:
            log.write(f"{time.monotonic():.3f} {line}\n")


class MoverConfig(PluginConfig):
    """What the localizer does badly, at which frame."""

    eye: Sensor["image"]
    at: int = 20
    sleeps_s: float = 0.0
    hangs: Literal["", "observe", "finish", "stubbornly"] = ""


class ToyMover(Localizer):
    """Says that base moves on by a centimetre a frame."""

    config: MoverConfig

    def start(self, session: Session) -> None:
        self._last_s: float | None = None
        self._n = 0

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        self._n += 1
        if self._n == self.config.at:
            print("here", flush=True)
            time.sleep(self.config.sleeps_s)
            if self.config.hangs == "observe":
                time.sleep(_ENDLESS_S)
            while self.config.hangs == "stubbornly":
                try:
                    time.sleep(_ENDLESS_S)
                except KeyboardInterrupt:
                    continue
        since_s, self._last_s = self._last_s, frame.stamp_s
        return () if since_s is None else (Motion(since_s, frame.stamp_s, Pose2(0.01), GOOD),)

    def finish(self) -> None:
        if self.config.hangs == "finish":
            print("here", flush=True)
            time.sleep(_ENDLESS_S)


class ToyController(Controller):
    """Drives on."""

    @property
    def gives(self) -> frozenset[type[Command]]:
        return frozenset({Velocity, Stop})

    def step(self, belief: Belief) -> Command:
        return Velocity(0.2)


@hookimpl
def trailmark_register(registry: Any) -> None:
    registry.source("toy_robot", ":ToyRobot", config=":ToyConfig", summary="A robot that writes down what it is told")
    registry.localizer("toy_mover", ":ToyMover", config=":MoverConfig", summary="Moves on", gives=("motion",))
    registry.controller("toy_driver", ":ToyController", summary="Drives on")
