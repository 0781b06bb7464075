"""A camera that looks at a scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from trailmark.frames import Calibration, Image, Omni, Pinhole, SensorInfo
from trailmark.geometry import Pose2, Pose3
from trailmark_sim.render.develop import Film, Sensitometry
from trailmark_sim.render.lenses import Catadioptric, Lens, PinholeLens
from trailmark_sim.render.rays import ray_table
from trailmark_sim.render.scene import Scene
from trailmark_sim.render.view import Moment, View
from trailmark_sim.rng import frame_rng
from trailmark_sim.vehicles import VehicleState

__all__ = ["CameraSensor", "Shaking", "pose_map_sensor"]

_WAVES_M = (0.03, 0.05, 0.09, 0.16, 0.35, 0.8)
MomentAt = Callable[[float, Pose2], Moment]


@dataclass(frozen=True, slots=True)
class Shaking:
    """How the floor shakes a sensor: the same bumps at the same places of the way.

    Attributes
    ----------
    angle_rad : float
        Standard deviation of roll, pitch and (a third) yaw [rad].
    height_m : float
        Standard deviation of the height [m].
    seed : int
        Of the bumps.
    """

    angle_rad: float = 0.0
    height_m: float = 0.0
    seed: int = 0

    def at(self, travelled_m: float) -> Pose3:
        """Return the motion of the sensor's base after some way."""
        if self.angle_rad == 0.0 and self.height_m == 0.0:
            return Pose3()
        phases = frame_rng(self.seed, "bumps").uniform(0.0, 2.0 * math.pi, (4, len(_WAVES_M)))
        turns = 2.0 * math.pi * travelled_m / np.array(_WAVES_M)
        waves = np.sin(turns + phases).sum(axis=1) * math.sqrt(2.0 / len(_WAVES_M))
        roll, pitch, yaw = (self.angle_rad * float(wave) for wave in waves[:3])
        return Pose3(0.0, 0.0, self.height_m * float(waves[3]), roll, pitch, yaw / 3.0)


def pose_map_sensor(state: VehicleState, mounting: Pose3, shaking: Shaking) -> Pose3:
    """Return where a sensor looks from."""
    return Pose3.from_planar(state.pose_map_base) @ shaking.at(state.travelled_m) @ mounting


class CameraSensor:
    """Pictures of a scene, through any central lens.

    Parameters
    ----------
    name : str
        Name of the sensor.
    scene : Scene
        What it sees.
    lens : Lens
        Rays of its pixels.
    mounting : Pose3
        ``point_base = mounting @ point_sensor``.
    rate_hz : float
        Pictures per second [Hz].
    response : Sensitometry
        How it sees.
    moment_at : callable
        Takes a stamp [s] and the pose of the vehicle and returns where people are.
    seed : int
        Of the noise.
    shaking : Shaking
        How the floor shakes it.
    threads : int
        Threads that render; no byte depends on it.
    """

    def __init__(
        self,
        name: str,
        scene: Scene,
        lens: Lens,
        mounting: Pose3,
        rate_hz: float,
        response: Sensitometry,
        moment_at: MomentAt,
        seed: int,
        shaking: Shaking = Shaking(),
        threads: int = 1,
    ) -> None:
        self.rate_hz = rate_hz
        self.info = SensorInfo(name, "image", (lens.width, lens.height), rate_hz, mounting, _calibration(lens))
        self.lens = lens
        self._scene, self._moment_at, self._shaking, self._threads = scene, moment_at, shaking, threads
        directions, mask = lens.directions()
        self.table = ray_table(directions, mask)
        self._film = Film(response, (lens.height, lens.width), seed, name, None if mask.all() else mask)

    def render(self, k: int, stamp_s: float, state: VehicleState) -> Image:
        """Return picture number `k`."""
        return self.develop(self.view(stamp_s, state), k)

    def develop(self, view: View, k: int) -> Image:
        """Return picture number `k` of what is before the lens."""
        return Image(self._film.develop(view.radiance(), k, 1.0, self._threads))

    def view(self, stamp_s: float, state: VehicleState) -> View:
        """Return what is before the lens."""
        pose = pose_map_sensor(state, self.info.pose_base_sensor, self._shaking)
        return View(self._scene, self.table, pose, self._moment_at(stamp_s, state.pose_map_base), self._threads)


def _calibration(lens: Lens) -> Calibration | None:
    if isinstance(lens, PinholeLens):
        pinhole: Pinhole = lens.calibration
        return pinhole
    if isinstance(lens, Catadioptric):
        return Omni(lens.cx, lens.cy, lens.inner_px, lens.outer_px, "clockwise", -90.0)
    return None
