"""A small room, rendered by casting rays: exact poses, exact depth."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from trailmark.estimates import Belief, Estimate
from trailmark.frames import RGBD, DepthCamera, Frame, Pinhole, Scalar, SensorInfo
from trailmark.geometry import Pose2, Pose3
from trailmark.interfaces import Localizer, Session

LENS = Pinhole(525.0, 525.0, 319.5, 239.5)
SENSORS = {
    "kinect": SensorInfo("kinect", "rgbd", size=(640, 480), rate_hz=30.0, calibration=DepthCamera(LENS)),
    "light": SensorInfo("light", "scalar"),
}
_PX_PER_M = 120


class Room:
    """A wall with coloured boards 3 m ahead, and a box before it that can be moved."""

    def __init__(self, seed: int = 5) -> None:
        rng = np.random.default_rng(seed)
        self._wall = self._boards(rng, 1200, 600, 220)
        self._box = self._boards(rng, 72, 96, 14)
        columns, rows = np.meshgrid(np.arange(640), np.arange(480))
        ahead = np.ones((480, 640))
        self._look = lru_cache(maxsize=64)(self._render)  # tests drive the same way
        self._rays = np.stack([ahead, -(columns - LENS.cx) / LENS.fx, -(rows - LENS.cy) / LENS.fy], axis=-1)

    @staticmethod
    def _boards(rng: np.random.Generator, width: int, height: int, n: int) -> npt.NDArray[np.uint8]:
        pixels = np.full((height, width, 3), 150, np.uint8)
        for _ in range(n):
            u, v = rng.integers(0, (width, height))
            w, h = rng.integers(8, 40, 2)
            cv2.rectangle(pixels, (int(u), int(v)), (int(u + w), int(v + h)), rng.integers(0, 256, 3).tolist(), -1)
        return pixels

    def look(
        self, pose: Pose2, light: float = 1.0, box_left_m: float = 0.0, tilt_rad: tuple[float, float] = (0.0, 0.0)
    ) -> RGBD:
        """Return what is seen from a pose; the box is moved to the left, and the camera is rolled and pitched."""
        seen = self._look(pose, box_left_m, tilt_rad)
        return seen if light == 1.0 else RGBD((seen.bgr * light).astype(np.uint8), seen.depth_m)

    def _render(self, pose: Pose2, box_left_m: float, tilt_rad: tuple[float, float]) -> RGBD:
        roll, pitch = tilt_rad
        rays = self._rays @ Pose3(roll=roll, pitch=pitch, yaw=pose.theta).rotation().T
        bgr, depth = np.zeros((480, 640, 3), np.uint8), np.full((480, 640), np.nan, np.float32)
        middle = 5.0, 2.5
        panels = ((self._wall, 3.0, middle), (self._box, 2.2, (0.9 + box_left_m, 0.4)))  # the nearer one last
        for texture, x, (left, top) in panels:
            way = (x - pose.x) / np.maximum(rays[..., 0], 1e-6)
            u = (left - (pose.y + way * rays[..., 1])) * _PX_PER_M
            v = (top - way * rays[..., 2]) * _PX_PER_M
            inside = (u >= 0) & (v >= 0) & (u <= texture.shape[1] - 1) & (v <= texture.shape[0] - 1)
            seen = cv2.remap(texture, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)
            bgr[inside], depth[inside] = seen[inside], way[inside]
        return RGBD(bgr, depth)


def arc(n: int = 30) -> list[Pose2]:
    """Return a gentle way with turns, 0.3 m/s at 30 Hz."""
    return [Pose2(0.01 * i, 0.15 * math.sin(0.1 * i), 0.1 * math.sin(0.15 * i)) for i in range(n)]


Drive = Callable[..., list[Estimate]]


@pytest.fixture(scope="session")
def room() -> Room:
    return Room()


@pytest.fixture
def drive(room: Room) -> Drive:
    """Drive a localizer along poses; returns the first estimate of every picture after the first."""

    def _drive(
        localizer: Localizer,
        poses: Sequence[Pose2],
        light: Callable[[int], float] = lambda _: 1.0,
        box_left_m: Callable[[int], float] = lambda _: 0.0,
        tilt_rad: Callable[[int], tuple[float, float]] = lambda _: (0.0, 0.0),
        **session: object,
    ) -> list[Estimate]:
        settings = {"sensors": SENSORS, "start_pose": poses[0], "rng": np.random.default_rng(7)} | session
        localizer.start(Session(**settings))  # type: ignore[arg-type]
        answers: list[Estimate] = []
        for i, pose in enumerate(poses):
            stamp_s = i / 30.0
            believed = poses[0] if settings["start_pose"] is not None else None
            belief = Belief(stamp_s, believed)
            if getattr(localizer.config, "light", None):
                localizer.observe(Frame("light", stamp_s, Scalar(light(i))), belief)
            frame = Frame("kinect", stamp_s, room.look(pose, light(i), box_left_m(i), tilt_rad(i)))
            answers += localizer.observe(frame, belief)
        return answers

    return _drive
