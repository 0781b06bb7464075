"""A colour camera with a structured-light depth camera beside it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trailmark.frames import RGBD, DepthCamera, Pinhole, SensorInfo
from trailmark.geometry import Pose2, Pose3
from trailmark_sim.render.develop import Film, Sensitometry
from trailmark_sim.render.lenses import PinholeLens
from trailmark_sim.render.rays import ray_table
from trailmark_sim.render.scene import Scene
from trailmark_sim.render.view import View
from trailmark_sim.render.viewpoints import Moment
from trailmark_sim.rng import stream_key
from trailmark_sim.sensors.depth import DepthErrors, Echoes, measure_depth
from trailmark_sim.sensors.shutter import GLOBAL_SHUTTER, Shutter
from trailmark_sim.sensors.sight import Sight, pose_map_sensor
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.workers import in_bands

__all__ = ["RgbdRig", "RgbdSensor"]


@dataclass(frozen=True, slots=True)
class RgbdRig:
    """Size, errors and place of a colour and depth camera; the defaults are those of a Kinect of the first kind.

    Attributes
    ----------
    width, height : int
        Of both pictures [px].
    colour, depth : Pinhole
        The two cameras; depth sees the smaller field.
    baseline_m : float
        How far left of the colour camera the depth camera stands [m].
    projector_m : float
        How far right of the depth camera the projector stands [m].
    limits_m : (float, float)
        Depths that are measured [m].
    grazing : float
        Cosine between ray and normal below which nothing comes back.
    shiny : float
        Surfaces that mirror so much are seen only when met squarely.
    dropout : float
        Share of pixels that are lost for no reason.
    disparity_noise_px, disparity_step_px : float
        Deviation of the disparity, and what it is rounded to [px].
    is_registered : bool
        Depth on the pixels of the colour camera.
    rate_hz : float
        Pictures per second [Hz].
    mounting : Pose3
        ``point_base = mounting @ point_sensor``; of the colour camera.
    """

    width: int = 640
    height: int = 480
    colour: Pinhole = Pinhole(525.0, 525.0, 319.5, 239.5)
    depth: Pinhole = Pinhole(585.0, 585.0, 319.5, 239.5)
    baseline_m: float = 0.025
    projector_m: float = 0.075
    limits_m: tuple[float, float] = (0.5, 6.5)
    grazing: float = 0.10
    shiny: float = 0.2
    dropout: float = 0.002
    disparity_noise_px: float = 0.045
    disparity_step_px: float = 0.125
    is_registered: bool = False
    rate_hz: float = 30.0
    mounting: Pose3 = Pose3(x=0.20, z=0.60)


class RgbdSensor:
    """Colour and depth of a scene.

    Parameters
    ----------
    name : str
        Name of the sensor.
    scene : Scene
        What it sees.
    rig : RgbdRig
        Its cameras.
    response : Sensitometry
        How the colour camera sees.
    moment_at : callable
        Takes a stamp [s] and the pose of the vehicle and returns where people are.
    seed : int
        Of the noise.
    threads : int
        Threads that render; no byte depends on it.
    light_at : callable
        Takes a stamp [s] and returns the light as a share of that in the scene.
    shutter : Shutter
        When the colour camera sees each row, and for how long; depth is measured at the stamp.

    Raises
    ------
    ConfigError
        If it takes longer to expose or to read a picture than until the next.
    """

    def __init__(
        self,
        name: str,
        scene: Scene,
        rig: RgbdRig,
        response: Sensitometry,
        moment_at: Callable[[float, Pose2], Moment],
        seed: int,
        threads: int = 1,
        light_at: Callable[[float], float] = lambda _: 1.0,
        shutter: Shutter = GLOBAL_SHUTTER,
    ) -> None:
        shutter.refuse_at(name, rig.rate_hz)
        self.rig, self.rate_hz = rig, rig.rate_hz
        size = (rig.width, rig.height)
        self._lens = rig.colour if rig.is_registered else rig.depth
        self._beside_m = 0.0 if rig.is_registered else rig.baseline_m
        calibration = DepthCamera(
            rig.colour, None if rig.is_registered else rig.depth, Pose3(y=self._beside_m), depth_kind="z"
        )
        self.info = SensorInfo(name, "rgbd", size, rig.rate_hz, rig.mounting, calibration)
        self._scene, self._moment_at, self._seed, self._threads = scene, moment_at, seed, threads
        self._light_at = light_at
        colour = PinholeLens(*size, rig.colour)
        self._sight = Sight(scene, colour, rig.mounting, moment_at, shutter, threads=threads)
        self._depth_rays = ray_table(*PinholeLens(*size, self._lens).directions())
        self._film = Film(response, (rig.height, rig.width), seed, name)

    def render(self, k: int, stamp_s: float, state: VehicleState) -> RGBD:
        """Return pictures number `k`."""
        moment = self._moment_at(stamp_s, state.pose_map_base)
        pose = pose_map_sensor(state, self.rig.mounting)
        view = self._sight.view(stamp_s, state)
        # Light adds up: less of all lamps is less of every pixel.
        radiance = self._sight.radiance(view, stamp_s, state) * np.float32(self._light_at(stamp_s))
        bgr = self._film.develop(radiance, k, 1.0, self._threads)
        return RGBD(bgr, self._depth(k, pose, moment))

    def _depth(self, k: int, pose: Pose3, moment: Moment) -> npt.NDArray[np.float32]:
        rig, table = self.rig, self._depth_rays
        eye = pose @ Pose3(y=self._beside_m)
        view = View(self._scene, table, eye, moment, self._threads)
        echoes = Echoes(view.ranges_m, *view.facing())
        lit_m = self._lit(eye, moment)
        out = np.full((rig.height, rig.width), np.nan, np.float32)
        seed = np.uint64(stream_key(self._seed, f"{self.info.name}/depth/{k}"))
        holes, noise = (rig.grazing, rig.shiny, rig.dropout), (rig.disparity_noise_px, rig.disparity_step_px)
        errors = DepthErrors(self._lens.fx, rig.projector_m, *rig.limits_m, *holes, *noise)

        def measure(first: int, last: int) -> None:
            measure_depth(first, last, table, echoes, lit_m, errors, seed, out)

        in_bands(measure, table.n_tiles, self._threads)
        return self._within_the_field(out)

    def _lit(self, eye: Pose3, moment: Moment) -> npt.NDArray[np.float32]:
        """Return the depths at which the projector's light ends, on a picture as the camera's; empty without one."""
        if self.rig.projector_m == 0.0:
            return np.empty((0, 0), np.float32)
        table = self._depth_rays
        view = View(self._scene, table, eye @ Pose3(y=-self.rig.projector_m), moment, self._threads)
        return table.picture(view.ranges_m * table.rays[:, 0], math.inf)

    def _within_the_field(self, depth: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Leave of registered depth only what the depth camera's smaller field covers."""
        if not self.rig.is_registered:
            return depth
        lens, narrow = self._lens, self.rig.depth
        u, v = np.arange(self.rig.width), np.arange(self.rig.height)
        across = (u - lens.cx) / lens.fx * narrow.fx + narrow.cx
        down = (v - lens.cy) / lens.fy * narrow.fy + narrow.cy
        depth[:, (across < 0) | (across > self.rig.width - 1)] = np.nan
        depth[(down < 0) | (down > self.rig.height - 1)] = np.nan
        return depth
