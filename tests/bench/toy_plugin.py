"""A one-file plugin for tests of the bench: a wheel that turns, and localizers that do as they are told, or do not."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from trailmark import hookimpl
from trailmark.config import ConfigPath, PluginConfig, Sensor, SourceConfig
from trailmark.errors import DataError
from trailmark.estimates import Belief, Estimate, Fix, Lost, Motion, information_from_sigmas
from trailmark.frames import Frame, Odometry, SensorInfo
from trailmark.geometry import Pose2, Trajectory
from trailmark.interfaces import FrameSource, Localizer

Does = Literal[
    *("drive", "segfault", "hang", "sleep", "memory", "raise", "exit", "disk", "silent", "lost"),
    *("litter", "fork", "daemon"),
]
GOOD = information_from_sigmas(1e-3, 1e-3, 1e-3)


class WheelsConfig(SourceConfig):
    n: int = 40
    noise_m: float = 1e-3
    kind: Literal["odometry", "other"] = "odometry"
    recording: ConfigPath | None = None
    """Says how fast it goes."""


class Wheels(FrameSource):
    """Drives a circle at 1 m/s; each reading is off by noise of the seed."""

    def start(self, session) -> None:
        self._rng = session.rng
        self._speed = 1.0
        if self.config.recording is not None:
            self._speed = float(Path(self.config.recording).read_text())

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        return {"wheels": SensorInfo("wheels", self.config.kind if self.config.kind == "odometry" else "scalar")}

    def _true(self, i: int) -> Pose2:
        step = Pose2(0.1 * self._speed, 0.0, 0.02)
        pose = Pose2()
        for _ in range(i):
            pose = pose @ step
        return pose

    def frames(self) -> Iterator[Frame]:
        from trailmark.frames import Scalar

        for i in range(self.config.n):
            pose = self._true(i)
            error = self.config.noise_m * self._rng.standard_normal(2)
            seen = Pose2(pose.x + error[0], pose.y + error[1], pose.theta)
            payload = Odometry(seen) if self.config.kind == "odometry" else Scalar(0.0)
            yield Frame("wheels", 0.1 * i, payload)

    def ground_truth(self) -> Trajectory:
        return Trajectory.from_poses([(0.1 * i, self._true(i)) for i in range(self.config.n)])


class ToyConfig(PluginConfig):
    wheels: Sensor["odometry"]
    does: Does = "drive"
    scale: float = 1.0
    at_frame: int = 5
    flag: ConfigPath | None = None
    """Misbehaves only while this file is there."""


class Toy(Localizer):
    def start(self, session) -> None:
        self._last: tuple[float, Pose2] | None = None
        self._count = 0

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        self._count += 1
        is_meant = self.config.flag is None or Path(self.config.flag).exists()
        if self._count == self.config.at_frame and is_meant:
            misbehave(self.config.does)
        if self.config.does == "silent":
            return ()
        if self.config.does == "lost":
            return (Lost(frame.stamp_s, "looked and saw nothing"),)
        pose = frame.payload.pose_start_base
        last, self._last = self._last, (frame.stamp_s, pose)
        if last is None:
            return ()
        step = last[1].between(pose)
        moved = Pose2(self.config.scale * step.x, self.config.scale * step.y, step.theta)
        return (Motion(last[0], frame.stamp_s, moved, information_from_sigmas(2e-3, 2e-3, 1e-3)),)


def misbehave(how: str) -> None:
    match how:
        case "segfault":
            ctypes.string_at(0)
        case "hang":
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM, signal.SIGINT})
            while True:
                time.sleep(60)
        case "sleep":
            time.sleep(1.0)
        case "memory":
            hog = []
            while True:
                hog.append(np.zeros(1 << 23))  # 64 MB
        case "raise":
            raise RuntimeError("the toy broke")
        case "exit":
            os._exit(0)
        case "litter":
            for i in range(200):  # each file is small, and all of them are not
                Path(f"litter-{i}").write_bytes(bytes(1 << 20))
                time.sleep(0.05)
        case "fork":
            for _ in range(30):
                subprocess.Popen(["sleep", "300"])
            time.sleep(60)
        case "daemon":
            subprocess.Popen(["sleep", "298765"], start_new_session=True)
        case "disk":
            with tempfile.TemporaryFile() as file:
                file.writelines(bytes(1 << 20) for _ in range(200))
        case _:
            pass


class FixerConfig(PluginConfig):
    wheels: Sensor["odometry"]
    remembers: bool = False


class Fixer(Localizer):
    """Says where it is by a taught path: proof that teaching came before."""

    def start(self, session) -> None:
        self._session = session

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        if self._session.mode == "teach":
            moved = Motion(frame.stamp_s - 0.1, frame.stamp_s, Pose2(0.1, 0.0, 0.02), GOOD)
            return (moved,) if frame.stamp_s > 0.05 else ()
        if self._session.path is None:
            raise DataError("nothing was taught")
        return (Fix(frame.stamp_s, frame.payload.pose_start_base, information_from_sigmas(1e-2, 1e-2, 1e-2)),)


@hookimpl
def trailmark_register(registry: Any) -> None:
    registry.source("toy_wheels", ":Wheels", config=":WheelsConfig", summary="A wheel that turns")
    registry.localizer("toy", ":Toy", config=":ToyConfig", summary="Does as it is told", gives=("motion",))
    registry.localizer("toy_fixer", ":Fixer", config=":FixerConfig", summary="Was taught", gives=("fix", "motion"))
