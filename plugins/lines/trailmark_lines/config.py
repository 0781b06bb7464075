"""Config of the source of lines."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from trailmark.config import LiveSourceConfig

__all__ = ["LinesConfig"]

SensorKind = Literal["image", "scan", "odometry", "imu", "scalar", "pose"]


class LinesConfig(LiveSourceConfig):
    """Frames as lines of JSON, live."""

    sensors: dict[str, SensorKind] = Field(min_length=1)
    """Sensors that the lines name, and their kinds: `{wheels: odometry, front: image}`."""
    over: Literal["stdin", "tcp", "udp", "device"] = "stdin"
    """Where lines come from: standard input (commands go to standard output), a TCP connection that the robot's program
    opens, UDP packets, or a device such as a serial port."""
    host: str = "127.0.0.1"
    """Where tcp and udp listen; another address than this one lets every program that reaches it drive the belief."""
    port: int = Field(default=7447, ge=0, le=65535)
    """Where tcp and udp listen; 0: any that is free."""
    device: Path | None = None
    """The device: `/dev/ttyACM0`."""
    baud: Literal[9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600] = 115200
    """Speed of a serial device [bit/s]."""
    pictures: Path | None = None
    """Folder of the pictures that lines name as files; left out: pictures come in the lines alone."""
    command: Literal["velocity", "steer_4ws"] | None = None
    """What drives the robot; left out: it drives itself, and gets no command."""
    on_bad_frame: Literal["error", "skip"] = "skip"
    """A line that cannot be used: counted and skipped, or ends the run."""

    @model_validator(mode="after")
    def _device_is_named(self) -> Self:
        if (self.over == "device") != (self.device is not None):
            raise ValueError(f"over: {self.over} and device: {self.device}: a device goes with over: device, only")
        return self
