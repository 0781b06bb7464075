"""A robot on a Raspberry Pi: a camera by picamera2 and two motors by GPIO, as one file.

trailmark --plugin ./pi_robot.py teach  pi.yaml --store place.trail      # pushed by hand
trailmark --plugin ./pi_robot.py replay pi.yaml --store place.trail      # by itself
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from trailmark import hookimpl
from trailmark.clock import live_stamp_s
from trailmark.commands import Command, Stop, Velocity
from trailmark.config import LiveSourceConfig
from trailmark.errors import SourceError
from trailmark.frames import Frame, Image, SensorInfo
from trailmark.interfaces import Drivable, Session


class PiRobotConfig(LiveSourceConfig):
    """A camera and two motors of a Raspberry Pi."""

    left_pins: tuple[int, int] = (4, 14)
    """GPIO numbers of the left motor's bridge: forward, backward."""
    right_pins: tuple[int, int] = (17, 18)
    """GPIO numbers of the right motor's bridge: forward, backward."""
    track_m: float = Field(0.15, gt=0)
    """Distance of the wheels [m]."""
    full_speed_mps: float = Field(0.5, gt=0)
    """Speed of a wheel at full power [m/s]."""
    width: int = Field(320, gt=0)
    """Width of the pictures [px]."""
    height: int = Field(240, gt=0)
    """Height of the pictures [px]."""
    rate_hz: float = Field(30.0, gt=0)
    """Pictures per second [Hz]."""
    watchdog_s: float = Field(0.3, gt=0)
    """The motors are stopped when no command has come for so long [s]."""


class PiRobot(Drivable):
    """Grey pictures of the camera, stamped when their exposure began; velocities become power of the two motors."""

    config: PiRobotConfig
    is_live: ClassVar[bool] = True

    def __init__(self, config: PiRobotConfig) -> None:
        super().__init__(config)
        self._name = ""
        self._camera: Any = None
        self._motors: Any = None
        self._lock = threading.Lock()  # Stop may come from another thread
        self._closed = threading.Event()
        self._commanded_s = 0.0

    def start(self, session: Session) -> None:
        """Switch the camera and the motors on; these stand.

        Raises
        ------
        SourceError
            If picamera2 or gpiozero is missing, or there is no camera.
        """
        self.close()
        config, self._name, self._closed = self.config, session.name, threading.Event()
        self.drives_itself = session.mode == "teach"  # a person pushes it, and nothing but a stop is sent
        try:
            from gpiozero import Motor, Robot
            from picamera2 import Picamera2
        except ModuleNotFoundError as error:
            raise SourceError(f"{error.name} is missing: apt install python3-{error.name}") from error
        try:
            self._camera = camera = Picamera2()
        except (IndexError, RuntimeError) as error:  # what picamera2 raises where it finds none
            raise SourceError(f"no camera is found: {error}") from error
        picture = {"size": (config.width, config.height), "format": "YUV420"}
        camera.configure(camera.create_video_configuration(main=picture, controls={"FrameRate": config.rate_hz}))
        camera.start()
        with self._lock:
            self._motors = Robot(left=Motor(*config.left_pins), right=Motor(*config.right_pins))
        threading.Thread(target=self._watch, args=(self._closed,), name="motor watchdog", daemon=True).start()

    def close(self) -> None:
        """Stop the motors, end the frames, switch the camera off."""
        self._closed.set()
        with self._lock:
            motors, self._motors = self._motors, None
            if motors is not None:
                motors.stop()
                motors.close()
        camera, self._camera = self._camera, None
        if camera is not None:
            camera.stop()
            camera.close()

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        """The camera, which bears the source's name."""
        size = (self.config.width, self.config.height)
        return {self._name: SensorInfo(self._name, "image", size, self.config.rate_hz)}

    def frames(self) -> Iterator[Frame]:
        """Yield pictures until `close`."""
        closed, camera, last_s = self._closed, self._camera, float("-inf")
        while not closed.is_set():
            request = camera.capture_request()
            try:
                luma = request.make_array("main")[: self.config.height, : self.config.width]
                # Nanoseconds of the clock since boot, when the first row began to be exposed.
                age_s = (time.clock_gettime_ns(time.CLOCK_BOOTTIME) - request.get_metadata()["SensorTimestamp"]) / 1e9
                stamp_s, pixels = live_stamp_s() - age_s, np.ascontiguousarray(luma)
            finally:
                request.release()
            if stamp_s > last_s and not closed.is_set():
                last_s = stamp_s
                yield Frame(self._name, stamp_s, Image(pixels))

    @property
    def accepts(self) -> frozenset[type[Command]]:
        """Velocities."""
        return frozenset({Velocity, Stop})

    def drive(self, command: Command) -> None:
        """Give the motors power; while a person drives, `Stop` alone is obeyed."""
        with self._lock:
            if self._motors is None:
                return
            self._commanded_s = time.monotonic()
            match command:
                case Velocity(forward_mps, _, yaw_radps) if not self.drives_itself:
                    turn_mps = yaw_radps * self.config.track_m / 2.0
                    self._motors.value = self._powers(forward_mps - turn_mps, forward_mps + turn_mps)
                case Stop():
                    self._motors.stop()

    def _powers(self, left_mps: float, right_mps: float) -> tuple[float, float]:
        """Return the powers of both motors, -1 to 1; too fast a command is slowed down and keeps its curve."""
        full = max(self.config.full_speed_mps, abs(left_mps), abs(right_mps))
        return left_mps / full, right_mps / full

    def _watch(self, closed: threading.Event) -> None:
        while not closed.wait(self.config.watchdog_s / 5.0):
            with self._lock:
                if self._motors is not None and time.monotonic() - self._commanded_s > self.config.watchdog_s:
                    self._motors.stop()


@hookimpl
def trailmark_register(registry: Any) -> None:
    """Register the robot."""
    registry.source("pi_robot", PiRobot, config=PiRobotConfig)
