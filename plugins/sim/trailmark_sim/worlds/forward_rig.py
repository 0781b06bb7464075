"""A differential drive that looks forward (Perroni Filho & Ohya 2014, Sec. V), for corridor and street."""

from __future__ import annotations

import math
from collections.abc import Sequence

from trailmark.frames import Pinhole
from trailmark.geometry import Pose2, Pose3
from trailmark_sim.actors import Crowd, Walk
from trailmark_sim.render.lenses import PinholeLens
from trailmark_sim.rng import frame_rng
from trailmark_sim.routes import Route, trace
from trailmark_sim.sensors.camera import CameraRig
from trailmark_sim.sensors.shutter import Imaging, Shaking
from trailmark_sim.vehicles import Differential
from trailmark_sim.worlds.base import World, WorldOptions
from trailmark_sim.worlds.scene_options import CorridorOptions, StreetOptions
from trailmark_sim.worlds.setting import Setting, imaging_of

__all__ = ["SENSORS", "forward_camera", "forward_imaging", "forward_world", "route_along", "to_and_fro"]

SENSORS = ("front_depth", "front")

#: Speed of all experiments of the paper [m/s].
_SPEED_MPS = 0.3
#: Of pictures 640 px wide [px].
_FOCAL_PX = 525.0
_MOUNTING = Pose3(x=0.15, z=0.55, pitch=math.radians(-2.0))


def route_along(pieces: Sequence[tuple[float, float]], summary: str) -> Route:
    """Return the route of pieces of line and arc that begins at the origin, along x."""
    return Route.from_poses(trace(Pose2(), pieces), _SPEED_MPS, summary)


def to_and_fro(n: int, seed: int, length_m: float, ways: Sequence[Sequence[tuple[float, float]]]) -> Crowd:
    """Return people who walk ways of about `length_m` there and back, each on one of their own."""
    rng = frame_rng(seed, "walks")
    walks = []
    for person in range(n):
        way = tuple(ways[person % len(ways)])
        speed_mps, start_m = float(rng.uniform(0.7, 1.4)), float(rng.uniform(0.0, 2.0 * length_m))
        walks.append(Walk(way + way[-2:0:-1], speed_mps, start_m))
    return Crowd(walks, seed)


def forward_world(
    setting: Setting, options: WorldOptions, given: CorridorOptions | StreetOptions, *, vibration_rad: float
) -> World:
    """Return the world of a setting with its front camera, shaken by `vibration_rad` if no option says more."""
    imaging = forward_imaging(options, given, vibration_rad)
    site = setting.site(options, imaging, {"front": forward_camera(given.width_px)})
    return setting.world(site, options.vehicle or Differential(), SENSORS, ("wheels", "front"), start=Pose2())


def forward_imaging(options: WorldOptions, given: CorridorOptions | StreetOptions, vibration_rad: float) -> Imaging:
    """Return how the cameras make pictures on a floor that shakes them by `vibration_rad` if no option says more."""
    shakes = vibration_rad if given.vibration_mrad is None else given.vibration_mrad / 1e3
    return imaging_of(given, 0.5, shaking=Shaking(shakes, shakes * 0.3, options.seed))


def forward_camera(width_px: int) -> CameraRig:
    """Return the front camera for pictures of a width: always the same view, 4:3."""
    return CameraRig(_lens(width_px), _MOUNTING)


def _lens(width_px: int) -> PinholeLens:
    height_px = width_px * 3 // 4
    focal_px = _FOCAL_PX * width_px / 640.0
    middle = (width_px - 1) / 2.0, (height_px - 1) / 2.0
    return PinholeLens(width_px, height_px, Pinhole(focal_px, focal_px, *middle))
