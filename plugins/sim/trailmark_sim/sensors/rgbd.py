"""A colour camera with a structured-light depth camera beside it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from trailmark.arrays import Float32s
from trailmark.frames import RGBD, DepthCamera, Pinhole, SensorInfo
from trailmark.geometry import Pose3
from trailmark_sim.render.develop import Film
from trailmark_sim.render.lenses import PinholeLens
from trailmark_sim.render.rays import ray_table
from trailmark_sim.render.view import SceneView
from trailmark_sim.render.viewpoints import Moment
from trailmark_sim.rng import stream_key
from trailmark_sim.sensors.depth import DepthErrors, Echoes, measure_depth
from trailmark_sim.sensors.shutter import Imaging
from trailmark_sim.sensors.sight import Sight, pose_map_sensor
from trailmark_sim.sensors.site import SensorSite
from trailmark_sim.stage import Stage
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.workers import in_bands

__all__ = ["RgbdRig", "RgbdSensor", "build"]


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
    rig : RgbdRig
        Its cameras.
    stage : Stage
        What it sees.
    imaging : Imaging
        How the colour camera sees; depth is measured at the stamp.
    seed : int
        Of the noise.

    Raises
    ------
    ConfigError
        If it takes longer to expose or to read a picture than until the next.
    """

    def __init__(self, name: str, rig: RgbdRig, stage: Stage, *, imaging: Imaging | None = None, seed: int = 0) -> None:
        imaging = imaging or Imaging()
        imaging.shutter.refuse_at(name, rig.rate_hz)
        self.rig, self.rate_hz = rig, rig.rate_hz
        size = (rig.width, rig.height)
        self._lens = rig.colour if rig.is_registered else rig.depth
        self._beside_m = 0.0 if rig.is_registered else rig.baseline_m
        calibration = DepthCamera(
            rig.colour, None if rig.is_registered else rig.depth, Pose3(y=self._beside_m), depth_kind="z"
        )
        self.info = SensorInfo(name, "rgbd", size, rig.rate_hz, rig.mounting, calibration)
        self._scene, self._moment_at, self._threads = stage.build_scene(), stage.moment_at, stage.threads
        self._seed = seed
        self._sight = Sight(stage, PinholeLens(*size, rig.colour), rig.mounting, shutter=imaging.shutter)
        self._depth_rays = ray_table(*PinholeLens(*size, self._lens).directions())
        self._film = Film(imaging.response, (rig.height, rig.width), seed, name)

    def render(self, k: int, stamp_s: float, state: VehicleState) -> RGBD:
        """Return pictures number `k`."""
        moment = self._moment_at(stamp_s, state.pose_map_base)
        pose = pose_map_sensor(state, self.rig.mounting)
        view = self._sight.view(stamp_s, state)
        bgr = self._film.develop(self._sight.radiance(view, stamp_s, state), k, 1.0, self._threads)
        return RGBD(bgr, self._depth(k, pose, moment))

    def _depth(self, k: int, pose: Pose3, moment: Moment) -> Float32s:
        rig, table = self.rig, self._depth_rays
        eye = pose @ Pose3(y=self._beside_m)
        view = SceneView(self._scene, table, eye, moment, self._threads)
        echoes = Echoes(view.ranges_m, *view.facing())
        lit_m = self._projector_depths(eye, moment)
        out = np.full((rig.height, rig.width), np.nan, np.float32)
        seed = np.uint64(stream_key(self._seed, f"{self.info.name}/depth/{k}"))
        holes, noise = (rig.grazing, rig.shiny, rig.dropout), (rig.disparity_noise_px, rig.disparity_step_px)
        errors = DepthErrors(self._lens.fx, rig.projector_m, *rig.limits_m, *holes, *noise)

        def measure(first: int, last: int) -> None:
            measure_depth(first, last, table, echoes, lit_m, errors, seed, out)

        in_bands(measure, table.n_tiles, self._threads)
        return self._within_the_field(out)

    def _projector_depths(self, eye: Pose3, moment: Moment) -> Float32s:
        """Return the depths at which the projector's light ends, on a picture as the camera's; empty without one."""
        if self.rig.projector_m == 0.0:
            return np.empty((0, 0), np.float32)
        table = self._depth_rays
        view = SceneView(self._scene, table, eye @ Pose3(y=-self.rig.projector_m), moment, self._threads)
        return table.picture(view.ranges_m * table.rays[:, 0], math.inf)

    def _within_the_field(self, depth: Float32s) -> Float32s:
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


def build(name: str, site: SensorSite) -> RgbdSensor:
    """Return the colour and depth camera of a vehicle in a world with walls."""
    rig: RgbdRig = site.rigs.get(name, RgbdRig())
    rig = replace(rig, rate_hz=site.rate_hz(name, rig.rate_hz))
    return RgbdSensor(name, rig, site.stage_for(name), imaging=site.imaging, seed=site.options.seed)
