"""A room with patterned walls, seen exactly: pictures, depth, all-round pictures and laser scans for tests.

The room is a box around the map's origin, its floor at height 0. A ray from inside ends on the nearest wall in
closed form, so that every reading has an exact answer. ::

    run = room_run("rgbd", circle(0.3, 1.0), n_frames=20)
    run.frames, run.sensors, run.truth
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Bools, Floats
from trailmark.frames import RGBD, DepthCamera, Frame, Image, Omni, Payload, Pinhole, Scan, SensorInfo
from trailmark.frames.calibration import Calibration
from trailmark.geometry import Pose2, Pose3
from trailmark.testing.motions import MotionLaw, straight, true_poses
from trailmark.testing.runs import SyntheticRun

__all__ = ["Room", "RoomSensor", "room_run"]

RoomSensor = Literal["image", "rgbd", "omni", "scan"]


_TEXEL_M = 0.12
_N_TEXELS = 128
_PINHOLE = Pinhole(140.0, 140.0, 79.5, 59.5)
_PINHOLE_SIZE = (160, 120)
_OMNI = Omni(79.5, 79.5, 18.0, 78.0)
_OMNI_SIZE = (160, 160)
_OMNI_ELEVATION_DEG = (-35.0, 25.0)  # at the inner and at the outer rim
_N_BEAMS = 180
_MOUNTING = Pose3(z=0.8)


@dataclass(frozen=True, eq=False)
class Room:
    """A box with a pattern of coloured squares on each wall, on the floor and on the ceiling.

    Attributes
    ----------
    size_m : (float, float, float)
        Length along x, along y, and height [m].
    seed : int
        Of the pattern.
    """

    size_m: tuple[float, float, float] = (8.0, 5.0, 2.6)
    seed: int = 0

    def cast(self, origin: Floats, directions: Floats) -> tuple[Floats, npt.NDArray[np.uint8]]:
        """Return where rays end.

        Parameters
        ----------
        origin : (3,) float64
            A point inside, in the map [m].
        directions : (N, 3) float64
            Rays in the map, of any length.

        Returns
        -------
        (N,) float64, (N, 3) uint8
            How many lengths of its direction each ray goes, and the colour that it meets (BGR).
        """
        half = np.array([self.size_m[0] / 2, self.size_m[1] / 2, self.size_m[2] / 2])
        inside = origin - [0.0, 0.0, half[2]]
        with np.errstate(divide="ignore", invalid="ignore"):
            lengths = np.where(directions == 0.0, np.inf, (np.sign(directions) * half - inside) / directions)
        axis = lengths.argmin(axis=1)
        length = lengths[np.arange(len(axis)), axis]
        ends = inside + directions * length[:, None]
        face = 2 * axis + (directions[np.arange(len(axis)), axis] > 0)
        across = np.where(axis[:, None] == 0, ends[:, [1, 2]], ends[:, [0, 2]])
        across = np.where(axis[:, None] == 2, ends[:, [0, 1]], across)
        cell = np.floor(across / _TEXEL_M).astype(np.int64) % _N_TEXELS
        return length, np.asarray(self._pattern[face, cell[:, 1], cell[:, 0]], np.uint8)

    @cached_property
    def _pattern(self) -> npt.NDArray[np.uint8]:
        """Colours of the squares, (6, N, N, 3): patches of several squares under single ones."""
        rng = np.random.default_rng([self.seed, 6])
        coarse = rng.integers(40, 200, (6, _N_TEXELS // 4, _N_TEXELS // 4, 3)).repeat(4, axis=1).repeat(4, axis=2)
        fine = rng.integers(-40, 50, (6, _N_TEXELS, _N_TEXELS, 1))
        return np.asarray(np.clip(coarse + fine, 0, 255), np.uint8)


def room_run(
    kind: RoomSensor,
    motion: MotionLaw | None = None,
    n_frames: int = 20,
    *,
    rate_hz: float = 10.0,
    room: Room | None = None,
    noise_sigma: float = 2.0,
    seed: int = 0,
    sensor: str | None = None,
) -> SyntheticRun:
    """Return a drive through a room; the same arguments give the same bytes.

    Parameters
    ----------
    kind : {"image", "rgbd", "omni", "scan"}
        A forward camera of 160 x 120 pixels in colour, the same with depth, an all-round picture of 160 x 160
        pixels, or a planar laser of 180 beams all round.
    motion : callable, optional
        Pose of base at a time; 0.3 m/s straight ahead unless given. It must stay inside the room.
    noise_sigma : float
        Standard deviation of the pixel noise [grey levels]; a tenth of it in millimetres is that of ranges.
    seed : int
        Of the noise, and of the room unless one is given.
    sensor : str, optional
        Its name; the kind unless given.
    """
    room = Room(seed=seed) if room is None else room
    name = kind if sensor is None else sensor
    view = _VIEWS[kind]
    truth = true_poses(motion or straight(0.3), n_frames, rate_hz)
    frames = []
    for index, (stamp_s, pose) in enumerate(truth):
        rng = np.random.default_rng([seed, index])
        frames.append(Frame(name, stamp_s, view.payload(room, pose, noise_sigma, rng)))
    info = SensorInfo(name, view.kind, view.size, rate_hz, _MOUNTING, view.calibration)
    return SyntheticRun(tuple(frames), {name: info}, truth)


@dataclass(frozen=True)
class _RayFan:
    """One kind of sensor: what it is called, and which rays it looks along."""

    kind: str
    size: tuple[int, int] | None
    calibration: Calibration | None
    rays: Floats = field(repr=False)

    def payload(self, room: Room, pose: Pose2, noise_sigma: float, rng: np.random.Generator) -> Payload:
        origin, rays = _in_the_map(pose, self.rays)
        seen: Bools = np.asarray(np.isfinite(rays).all(axis=1))
        length = np.full(len(rays), np.nan)
        colour = np.zeros((len(rays), 3), np.uint8)
        length[seen], colour[seen] = room.cast(origin, rays[seen])
        if self.kind == "scan":
            ranges = length + 1e-4 * noise_sigma * rng.standard_normal(len(length))
            return Scan(ranges.astype(np.float32), -math.pi, 2 * math.pi / len(ranges), 0.05, 30.0)
        assert self.size is not None
        noisy = colour + noise_sigma * rng.standard_normal(colour.shape) * seen[:, None]
        bgr = np.clip(np.rint(noisy), 0, 255).astype(np.uint8).reshape(self.size[1], self.size[0], 3)
        if self.kind == "rgbd":
            return RGBD(bgr, length.astype(np.float32).reshape(bgr.shape[:2]))
        return Image(bgr)


def _in_the_map(pose: Pose2, rays: Floats) -> tuple[Floats, Floats]:
    mounted = Pose3.from_planar(pose) @ _MOUNTING
    return np.array([mounted.x, mounted.y, mounted.z]), rays @ mounted.rotation().T


def _pinhole_rays() -> Floats:
    """Return the rays of all pixels in sensor axes (x forward), of length 1 along the optical axis."""
    u, v = np.meshgrid(np.arange(_PINHOLE_SIZE[0]), np.arange(_PINHOLE_SIZE[1]))
    right, down = (u - _PINHOLE.cx) / _PINHOLE.fx, (v - _PINHOLE.cy) / _PINHOLE.fy
    return np.stack([np.ones(u.size), -right.ravel(), -down.ravel()], axis=1)


def _omni_rays() -> Floats:
    """Return the rays of all pixels; NaN outside the ring. Elevation grows evenly from rim to rim."""
    u, v = np.meshgrid(np.arange(_OMNI_SIZE[0], dtype=np.float64), np.arange(_OMNI_SIZE[1], dtype=np.float64))
    assert _OMNI.centre_u is not None
    assert _OMNI.centre_v is not None
    inner_px, outer_px = _OMNI.radius_inner_px, _OMNI.radius_outer_px
    assert inner_px is not None
    assert outer_px is not None
    right, down = (u - _OMNI.centre_u).ravel(), (v - _OMNI.centre_v).ravel()
    radius = np.hypot(right, down)
    bearing = -np.arctan2(down, right)  # v points down: the picture turns as the world does, seen from above
    low, high = np.radians(_OMNI_ELEVATION_DEG)
    elevation = low + (high - low) * (radius - inner_px) / (outer_px - inner_px)
    rays = np.stack([np.cos(bearing) * np.cos(elevation), np.sin(bearing) * np.cos(elevation), np.sin(elevation)], 1)
    rays[(radius < inner_px) | (radius > outer_px)] = np.nan
    return rays


def _scan_rays() -> Floats:
    angles = -math.pi + 2 * math.pi / _N_BEAMS * np.arange(_N_BEAMS)
    return np.stack([np.cos(angles), np.sin(angles), np.zeros(_N_BEAMS)], axis=1)


_VIEWS: dict[str, Any] = {
    "image": _RayFan("image", _PINHOLE_SIZE, _PINHOLE, _pinhole_rays()),
    "rgbd": _RayFan("rgbd", _PINHOLE_SIZE, DepthCamera(_PINHOLE), _pinhole_rays()),
    "omni": _RayFan("image", _OMNI_SIZE, _OMNI, _omni_rays()),
    "scan": _RayFan("scan", None, None, _scan_rays()),
}
