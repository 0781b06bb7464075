"""A round room seen through a simple mirror: exact pictures, poses and landmarks for the camera's tests."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from trailmark.estimates import Belief
from trailmark.frames import Frame, Image, Omni, SensorInfo
from trailmark.geometry import Pose2, Pose3
from trailmark.interfaces import Session
from trailmark.testing import MemoryMap

Grey = npt.NDArray[np.uint8]


def wall_texture(seed: int, height: int = 384, width: int = 3072) -> Grey:
    """Posters on a plain wall: patches of blocks and clouds with clear borders."""
    rng = np.random.default_rng(seed)
    wall = np.full((height, width), 150.0) + cv2.resize(rng.normal(0, 12, (6, 48)), (width, height))
    for _ in range(110):
        w, h = rng.integers(40, 170), rng.integers(40, 150)
        u, v = rng.integers(0, width - w), rng.integers(0, height - h)
        cells = (int(rng.integers(2, 6)), int(rng.integers(2, 7)))
        poster = cv2.resize(rng.uniform(0, 255, cells), (int(w), int(h)), interpolation=cv2.INTER_NEAREST)
        wall[v : v + h, u : u + w] = poster
    return np.clip(cv2.GaussianBlur(wall, (0, 0), 1.5), 0, 255).astype(np.uint8)


@dataclass
class RoundRoom:
    """A cylinder of posters around the origin, and a camera that looks up into a mirror.

    The mirror is equiangular: image distance is proportional to the angle from straight down. Bearings turn
    counter-clockwise in the picture (v points down) and forward is +u.
    """

    radius_m: float = 4.0
    camera_height_m: float = 1.2
    wall_height_m: float = 2.6
    size: tuple[int, int] = (320, 240)
    centre: tuple[float, float] = (161.3, 118.6)
    rim_px: float = 115.0
    hub_px: float = 22.0
    turns: str = "counterclockwise"
    forward_deg: float = 0.0
    seed: int = 3
    texture: Grey = field(init=False)
    _fixed: tuple[Any, Any, Any, Any] | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self.texture = wall_texture(self.seed)

    def render(self, camera: Pose2, noise: float = 1.5, blank: tuple[float, float] | None = None) -> Grey:
        """Return the picture from a pose; `blank` hides the wall between two map directions [rad]."""
        ring, bearing, tangent, background = self._rays()
        shade, direction = self._wall(camera, bearing + np.float32(camera.theta), tangent)
        if blank is not None:
            shade[(direction > blank[0]) & (direction < blank[1])] = 128.0
        picture = background.copy()
        picture[ring] = shade
        small = cv2.resize(picture, self.size, interpolation=cv2.INTER_AREA)
        seed = int(1e6 * abs(camera.x) + 1e3 * abs(camera.y))
        small += np.random.default_rng(seed).normal(0, noise, small.shape)
        return np.clip(small, 0, 255).astype(np.uint8)

    def _rays(self) -> tuple[Any, Any, Any, Any]:
        """Return what no pose changes: the ring, its bearings and slopes, and all around it."""
        if self._fixed is None:
            v, u = np.mgrid[0 : 2 * self.size[1], 0 : 2 * self.size[0]].astype(np.float32) / 2.0 - 0.25
            du, dv = u - self.centre[0], v - self.centre[1]
            distance = np.hypot(du, dv)
            ring = (distance > self.hub_px) & (distance < self.rim_px)
            sign = -1.0 if self.turns == "counterclockwise" else 1.0
            bearing = sign * (np.arctan2(dv, du) - math.radians(self.forward_deg))
            elevation = (distance / self.rim_px) * math.radians(125) - math.pi / 2  # 35 deg up at the rim
            background = np.where(distance <= self.hub_px, 30.0, 6.0).astype(np.float32)
            self._fixed = (ring, bearing[ring].astype(np.float32), np.tan(elevation[ring]), background)
        return self._fixed

    def _wall(self, camera: Pose2, direction: Any, slope: Any) -> tuple[Any, Any]:
        cos, sin = np.cos(direction), np.sin(direction)
        along = -(camera.x * cos + camera.y * sin)
        reach = along + np.sqrt(along**2 + self.radius_m**2 - camera.x**2 - camera.y**2)
        height = self.camera_height_m + reach * slope
        around = np.arctan2(camera.y + reach * sin, camera.x + reach * cos)
        rows, columns = self.texture.shape
        map_u = ((around + np.pi) / (2 * np.pi) * columns).astype(np.float32)[None]
        map_v = ((1.0 - height / self.wall_height_m) * rows).astype(np.float32)[None]
        halves = [slice(k, k + 30000) for k in range(0, map_u.shape[1], 30000)]  # remap takes 32767 columns at most
        parts = [
            cv2.remap(self.texture, map_u[:, h], map_v[:, h], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
            for h in halves
        ]
        shade = np.concatenate(parts, axis=1)[0].astype(np.float32)
        shade[height < 0] = 70.0
        shade[height > self.wall_height_m] = 210.0
        return shade, around

    def sensor(self, knows_centre: bool = False, mounting: Pose2 | None = None) -> SensorInfo:
        """Return the camera as a source would describe it."""
        centre = self.centre if knows_centre else (None, None)
        calibration = Omni(*centre, turns=self.turns, forward_deg=self.forward_deg)  # type: ignore[arg-type]
        pose = Pose3.from_planar(mounting or Pose2(), self.camera_height_m)
        return SensorInfo("omni", "image", self.size, 15.0, pose, calibration)


def drive(poses: list[Pose2], stamps_from: float = 0.0) -> Iterator[tuple[float, Pose2, Belief]]:
    """Yield stamp, true pose of base and a belief that knows it, for every pose."""
    travelled = 0.0
    for k, pose in enumerate(poses):
        travelled += poses[k - 1].distance_to(pose) if k else 0.0
        yield stamps_from + k / 15.0, pose, Belief(k / 15.0, pose, None, pose, travelled_m=travelled)


def loop(n: int = 90, radius_m: float = 1.5) -> list[Pose2]:
    """Return a closed drive around the origin."""
    angles = np.linspace(0.0, 2 * math.pi, n)
    return [Pose2(radius_m * math.cos(a), 0.8 * radius_m * math.sin(a), a + math.pi / 2) for a in angles]


def frame_of(image: Grey, stamp_s: float) -> Frame:
    return Frame("omni", stamp_s, Image(image))


def taught_map(room: RoundRoom, config: Any, mounting: Pose2 | None = None) -> MemoryMap:
    """Drive the loop in teach mode with exact poses, finish, and return what was remembered."""
    from trailmark_omni_surf.localizer import OmniSurf

    localizer_map, localizer = MemoryMap(), OmniSurf(config)
    localizer.start(Session("omni", "teach", {"omni": room.sensor(mounting=mounting)}, map=localizer_map))
    for stamp_s, pose, belief in drive(loop()):
        assert localizer.observe(frame_of(room.render(pose @ (mounting or Pose2())), stamp_s), belief) == ()
    localizer.finish()
    return localizer_map


@dataclass
class OmniTools:
    """What tests of the camera's localizer use."""

    room: Any = RoundRoom
    localizer_map: Any = MemoryMap
    drive: Any = staticmethod(drive)
    loop: Any = staticmethod(loop)
    frame: Any = staticmethod(frame_of)
    taught: Any = staticmethod(taught_map)


@pytest.fixture(scope="session")
def omni() -> OmniTools:
    return OmniTools()
