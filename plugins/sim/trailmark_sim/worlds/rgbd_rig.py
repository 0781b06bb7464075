"""A skid-steered robot with a colour and depth camera and a light sensor (Toth et al. 2015), for lab and hallway."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial

from trailmark.geometry import Pose2
from trailmark_sim.props import Troupe
from trailmark_sim.render.scene import Scene
from trailmark_sim.routes import Route
from trailmark_sim.sensors.imu import ImuSensor
from trailmark_sim.sensors.laser import LaserRig, LaserSensor
from trailmark_sim.sensors.light import LightSensor
from trailmark_sim.sensors.odometry import WheelOdometry
from trailmark_sim.sensors.rgbd import RgbdRig, RgbdSensor
from trailmark_sim.vehicles import SkidSteer
from trailmark_sim.worlds.base import SensorModel, World, WorldOptions, choose_sensors
from trailmark_sim.worlds.furnishing import response, shutter
from trailmark_sim.worlds.scene_options import HallwayOptions, LabOptions
from trailmark_sim.worlds.solids import Solids

__all__ = ["SENSORS", "rgbd_world"]

SENSORS = ("wheels", "imu", "light", "laser", "rgbd")


def rgbd_world(
    name: str,
    options: WorldOptions,
    given: LabOptions | HallwayOptions,
    build_scene: Callable[[], Scene],
    crowd: Troupe,
    solids: Solids,
    routes: Mapping[str, Route],
    level_lux: Callable[[Pose2, float], float],
) -> World:
    """Return the world with its sensors."""
    vehicle = options.vehicle or SkidSteer()
    plain = RgbdRig()
    rig = RgbdRig(
        is_registered=given.registered,
        rate_hz=options.rate_of("rgbd", plain.rate_hz),
        disparity_noise_px=plain.disparity_noise_px * given.depth_noise,
        disparity_step_px=plain.disparity_step_px if given.depth_noise > 0 else 0.0,
    )
    film = response(given.exposure, given.noise, given.blur_px, 0.7)
    dims_s = math.inf if given.dims_s is None else given.dims_s

    def light_at(stamp_s: float) -> float:
        return given.dims_to if stamp_s >= dims_s else 1.0

    def lux_at(pose: Pose2, stamp_s: float) -> float:
        return level_lux(pose, stamp_s) * light_at(stamp_s)

    builders: Mapping[str, Callable[[], SensorModel]] = {
        "wheels": partial(WheelOdometry, rate_hz=options.rate_of("wheels", 50.0)),
        "imu": partial(ImuSensor, rate_hz=options.rate_of("imu", 100.0), seed=options.seed),
        "light": partial(LightSensor, lux_at, rate_hz=options.rate_of("light", 10.0), seed=options.seed),
        "laser": lambda: LaserSensor(
            "laser", build_scene(), LaserRig(rate_hz=options.rate_of("laser", 10.0)), crowd.at, options.seed
        ),
        "rgbd": lambda: RgbdSensor(
            "rgbd",
            build_scene(),
            rig,
            film,
            crowd.at,
            options.seed,
            options.threads,
            light_at,
            shutter(given.exposure_ms, given.readout_ms),
        ),
    }
    return World(
        name=name,
        vehicle=vehicle,
        sensors=choose_sensors(name, options, builders, default=("wheels", "light", "rgbd")),
        routes=routes,
        start=next(iter(routes.values())).start,
        collides=partial(solids.touched, vehicle),
        area=solids.area,
    )
