"""A differential drive that looks forward (Perroni Filho & Ohya 2014, Sec. V), for corridor and street."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from trailmark.frames import Pinhole
from trailmark.geometry import Pose2, Pose3
from trailmark_sim.actors import Crowd, Walk
from trailmark_sim.render.lenses import PinholeLens
from trailmark_sim.render.scene import Scene
from trailmark_sim.rng import frame_rng
from trailmark_sim.routes import Route, trace
from trailmark_sim.sensors.camera import CameraSensor
from trailmark_sim.sensors.imu import ImuSensor
from trailmark_sim.sensors.light import LightSensor
from trailmark_sim.sensors.odometry import WheelOdometry
from trailmark_sim.sensors.shutter import Shaking
from trailmark_sim.sensors.true_depth import TrueDepthSensor
from trailmark_sim.vehicles import Differential
from trailmark_sim.worlds.base import SensorModel, World, WorldOptions, choose_sensors
from trailmark_sim.worlds.furnishing import response, shutter
from trailmark_sim.worlds.scene_options import CorridorOptions, StreetOptions
from trailmark_sim.worlds.solids import Solids

__all__ = ["SENSORS", "forward_world", "route_along", "to_and_fro"]

SENSORS = ("wheels", "imu", "light", "front_depth", "front")

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
    name: str,
    options: WorldOptions,
    given: CorridorOptions | StreetOptions,
    build_scene: Callable[[], Scene],
    crowd: Crowd,
    solids: Solids,
    routes: Mapping[str, Route],
    level_lux: Callable[[Pose2, float], float],
    vibration_rad: float,
) -> World:
    """Return the world with its sensors; `vibration_rad` is the floor's where the options give none [rad]."""
    vehicle = options.vehicle or Differential()
    shakes = vibration_rad if given.vibration_mrad is None else given.vibration_mrad / 1e3

    def camera(sensor: str) -> CameraSensor:
        return CameraSensor(
            sensor,
            build_scene(),
            _lens(given.width_px),
            _MOUNTING,
            options.rate_of(sensor, 20.0),
            response(given.exposure, given.noise, given.blur_px, 0.5),
            crowd.at,
            options.seed,
            Shaking(shakes, shakes * 0.3, options.seed),
            options.threads,
            shutter(given.exposure_ms, given.readout_ms),
        )

    builders: Mapping[str, Callable[[], SensorModel]] = {
        "wheels": partial(WheelOdometry, rate_hz=options.rate_of("wheels", 50.0)),
        "imu": partial(ImuSensor, rate_hz=options.rate_of("imu", 100.0), seed=options.seed),
        "light": partial(LightSensor, level_lux, rate_hz=options.rate_of("light", 10.0), seed=options.seed),
        "front_depth": lambda: TrueDepthSensor(camera("front_depth")),
        "front": lambda: camera("front"),
    }
    return World(
        name=name,
        vehicle=vehicle,
        sensors=choose_sensors(name, options, builders, default=("wheels", "front")),
        routes=routes,
        start=Pose2(),
        collides=partial(solids.touched, vehicle),
        area=solids.area,
    )


def _lens(width_px: int) -> PinholeLens:
    """Return the lens for pictures of a width: always the same view, 4:3."""
    height_px = width_px * 3 // 4
    focal_px = _FOCAL_PX * width_px / 640.0
    middle = (width_px - 1) / 2.0, (height_px - 1) / 2.0
    return PinholeLens(width_px, height_px, Pinhole(focal_px, focal_px, *middle))
