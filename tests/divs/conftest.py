"""A corridor to drive in: flat walls with patches on them, seen by a level camera."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from trailmark.estimates import Belief, PathOffset
from trailmark.frames import Frame, Image, Pinhole, SensorInfo
from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import LocalizerMap, Session
from trailmark.paths import Path, Waypoint
from trailmark_divs.config import DivsConfig
from trailmark_divs.localizer import Divs
from trailmark_divs.taught_stream import TaughtStream
from trailmark_divs.warm_up import compile_kernels


@pytest.fixture(scope="session", autouse=True)
def compiled_kernels():
    """Compile before the first test, so that no property test is charged for it."""
    compile_kernels()


class DictMap(LocalizerMap):
    """A localizer map that forgets with the process."""

    def __init__(self):
        self.rows, self.named, self.offset_m = [], {}, 0.0

    def add(self, keyframe):
        self.rows.append(replace(keyframe, station_m=keyframe.station_m + self.offset_m))

    def keyframes(self):
        return tuple(self.rows)

    def save(self, name, arrays):
        self.named[name] = dict(arrays)

    def load(self, name):
        return self.named.get(name)


#: Walls y = +-1.5 m and an end wall at x = 16 m; a corner to the left at x = 8 m.
STRAIGHT_WALLS = ((-3.0, 1.5, 16.0, 1.5), (-3.0, -1.5, 16.0, -1.5), (16.0, -1.5, 16.0, 1.5))
CORNER_WALLS = (
    (-3.0, 1.5, 6.5, 1.5),
    (6.5, 1.5, 6.5, 16.0),
    (-3.0, -1.5, 9.5, -1.5),
    (9.5, -1.5, 9.5, 16.0),
    (6.5, 16.0, 9.5, 16.0),
)


class Corridor:
    """Walls seen by a camera of 160 x 120 px and 60 deg."""

    size = (160, 120)
    focal_px = 80 / math.tan(math.radians(30))

    def __init__(self, walls=STRAIGHT_WALLS, seed=1):
        self.walls = walls
        rng = np.random.default_rng(seed)
        self.textures = [self._texture(rng, math.hypot(b[2] - b[0], b[3] - b[1])) for b in self.walls]

    @staticmethod
    def _texture(rng, length_m):
        texture = np.full((300, int(length_m * 100)), 150.0)
        for _ in range(int(length_m * 14)):
            width, height = int(rng.uniform(3, 90)), int(rng.uniform(5, 200))
            u, v = rng.integers(0, texture.shape[1]), rng.integers(0, 300)
            texture[v : v + height, u : u + width] = rng.uniform(30, 230)
        return texture

    def sensor(self):
        width, height = self.size
        lens = Pinhole(self.focal_px, self.focal_px, (width - 1) / 2, (height - 1) / 2)
        return SensorInfo("front", "image", size=self.size, calibration=lens)

    def picture(self, pose, rng, gamma=1.0, noise=2.0):
        """The upper half of what the camera sees; the rest is black."""
        width, height = self.size
        bearings = -np.arctan((np.arange(width) - (width - 1) / 2) / self.focal_px)
        angles = bearings + pose.theta
        ray_x, ray_y = np.cos(angles), np.sin(angles)
        ranges, seen = np.full(width, np.inf), np.zeros((height // 2, width))
        rows = (height - 1) / 2 - np.arange(height // 2)[:, None]
        for (x0, y0, x1, y1), texture in zip(self.walls, self.textures):
            wall_x, wall_y = x1 - x0, y1 - y0
            cross = ray_x * wall_y - ray_y * wall_x
            cross = np.where(np.abs(cross) < 1e-12, 1e-12, cross)
            distance = ((x0 - pose.x) * wall_y - (y0 - pose.y) * wall_x) / cross
            share = ((x0 - pose.x) * ray_y - (y0 - pose.y) * ray_x) / cross
            hit = (distance > 0.05) & (share >= 0) & (share <= 1) & (distance < ranges)
            ranges[hit] = distance[hit]
            depth = distance * np.cos(bearings)
            v = np.clip((60 + 100 * rows * depth / self.focal_px).astype(int), 0, 299)
            u = np.clip((share * texture.shape[1]).astype(int), 0, texture.shape[1] - 1)
            seen[:, hit] = texture[v[:, hit], u[hit]]
        grey = 255 * (seen / 255) ** gamma + rng.normal(0, noise, seen.shape)
        full = np.zeros((height, width), dtype=np.uint8)
        full[: height // 2] = np.clip(grey, 0, 255)
        return full


def straight(length_m):
    return Path([Waypoint(k, 0.1 * k, Pose2(0.1 * k, 0.0, 0.0)) for k in range(round(length_m * 10) + 1)])


def run(corridor, config, session, n, y_m=0.0, heading_rad=0.0, start_m=0.0, has_path=True, seed=0, **light):
    """Drive straight for n steps of 1.5 cm with exact odometry; return localizer, poses and answers."""
    localizer, rng = Divs(config), np.random.default_rng(seed)
    localizer.start(session)
    poses, answers = [], []
    for k in range(n):
        way_m, stamp_s = 0.015 * k, 0.05 * k
        moved = Pose2(way_m, 0.0, 0.0)
        pose = Pose2(start_m, y_m, heading_rad) @ moved
        on_path = PathOffset(stamp_s, pose.x, 0.0, 0.0, np.zeros((3, 3))) if has_path else None
        belief = Belief(
            stamp_s,
            pose if has_path else None,
            pose_odom_base=moved,
            twist=Twist2(0.3),
            travelled_m=way_m,
            on_path=on_path,
            motion_age_s=0.0,
        )
        picture = Image(corridor.picture(pose, rng, **light))
        answers.append(localizer.observe(Frame("front", stamp_s, picture), belief))
        poses.append(pose)
    return localizer, poses, answers


@pytest.fixture(scope="session")
def corridor():
    return Corridor()


@pytest.fixture(scope="session")
def corner():
    return Corridor(CORNER_WALLS, seed=2)


@pytest.fixture
def localizer_map():
    return DictMap()


@pytest.fixture
def drive():
    return run


@pytest.fixture(scope="session")
def taught(corridor):
    """A localizer map in which 6 m of the corridor are taught, and the path."""
    localizer_map, path = DictMap(), straight(6.0)
    session = Session(name="divs", mode="teach", sensors={"front": corridor.sensor()}, map=localizer_map)
    localizer, _, _ = run(corridor, DivsConfig(camera="front"), session, 401, seed=5)
    localizer.finish()
    return localizer_map, path


@pytest.fixture
def replaying(corridor, taught):
    localizer_map, path = taught
    return Session(name="divs", mode="replay", sensors={"front": corridor.sensor()}, map=localizer_map, path=path)


@pytest.fixture(scope="session")
def picture_stream():
    """Return what makes a taught stream of pictures alone: of each, from and until which station it was taken."""

    def stream_of(pictures, stations_m, pixels=None):
        pictures = np.array(list(pictures), np.float32)
        n = len(pictures)
        nothing = np.zeros((n, 50))
        return TaughtStream(
            nothing.astype(np.int64),
            nothing,
            np.zeros(n, np.int64),
            stations_m,
            stations_m,
            np.zeros(n),
            pictures,
            np.arange(n),
            *([] if pixels is None else [np.array(list(pixels))]),
        )

    return stream_of
