"""Courses for a ground camera: 10 m straight, 13.4 m indoors through pole gates, 243.4 m over a campus.

After the experiments of Nagai & Watanabe, Sec. IV. Every course starts at the origin, along x, on ground of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import ConfigError
from trailmark.geometry import Pose2, Pose3
from trailmark_sim.ground.camera import GroundCameraSensor, GroundRig
from trailmark_sim.ground.ground import Floor, GroundTexture, Zone
from trailmark_sim.ground.optics import Optics
from trailmark_sim.ground.warp import expose_rows
from trailmark_sim.ground.weather import Weather
from trailmark_sim.obstacles import Pole, touched_pole
from trailmark_sim.outlines import circle_outline
from trailmark_sim.rng import stream_key
from trailmark_sim.routes import Route, arc, line, trace
from trailmark_sim.sensors.catalogue import build_sensors
from trailmark_sim.sensors.site import SensorSite
from trailmark_sim.vehicles import FourWheelSteering
from trailmark_sim.worlds.base import World, WorldOptions, choose_route, parse_options
from trailmark_sim.worlds.ground_options import CameraOptions, Covered, DayOptions, FloorOptions, GroundCourseOptions

__all__ = ["ROUTES", "SENSORS", "build"]

SENSORS = ("floor",)
ROUTES = ("straight", "indoor", "outdoor")

#: Average speed outdoors, Sec. IV-D [m/s].
_SPEED_MPS = 0.26
#: Texels per pixel of the camera; below 1.5 interpolation would show.
_OVERSAMPLING = 1.5
_POLE_RADIUS_M = 0.015
#: Pairs of poles stand 0.50 m apart, Sec. IV-C.
_GATE_M = 0.50
_GATE_STATIONS_M = (1.5, 4.0, 8.05, 11.5)

_INDOOR_M = 13.4
_INDOOR = (
    *(line(2.3), arc(1.4, 50), line(0.9), arc(1.4, -50), line(1.0)),
    *(arc(1.2, -45), line(0.9), arc(1.2, 45)),
)
_OUTDOOR_M = 243.4
_OUTDOOR = (
    *(line(20), arc(30, 25), line(12), arc(15, -25), line(14), arc(3, 90), line(18), arc(20, -30), line(14)),
    *(arc(2.5, 120), line(30), arc(12, -40), line(16), arc(8, 35), line(22), arc(3, -85), line(12)),
)
#: Stretches of the campus: from station, floor, direction of its pattern [m, deg].
_OUTDOOR_FLOORS = (
    *((0.0, "concrete", 0), (22.0, "pavers", 0), (58.0, "asphalt", 0), (96.0, "pavers", 90), (118.0, "terrazzo", 0)),
    *((131.0, "concrete", 0), (160.0, "gravel", 0), (172.0, "asphalt", 0), (205.0, "soil", 0), (217.0, "pavers", 45)),
)


def build(options: WorldOptions) -> World:
    """Build the course of the chosen route."""
    course = parse_options(GroundCourseOptions, "ground_course", options.extra)
    routes = _routes()
    name = choose_route("ground_course", options, ROUTES)
    vehicle = options.vehicle or FourWheelSteering()
    poles = _gates(routes[name]) if name == "indoor" else ()
    site = SensorSite(
        world="ground_course",
        options=options,
        level_lux=partial(_light_lux, name),
        floor_camera=partial(_camera, course, options, name, routes[name]),
    )
    return World(
        name="ground_course",
        vehicle=vehicle,
        sensors=build_sensors(site, SENSORS, default=("wheels", "floor")),
        routes={name: routes[name]} | routes,
        start=Pose2(),
        collides=partial(touched_pole, poles, vehicle.length_m, vehicle.width_m),
        around=tuple(circle_outline(pole.x, pole.y, pole.radius_m) for pole in poles),
        truth={"poles": np.array([(pole.x, pole.y, pole.radius_m) for pole in poles]).reshape(-1, 3)},
        slow_kernel=expose_rows,
    )


def _routes() -> dict[str, Route]:
    start = Pose2()
    return {
        "straight": Route.from_poses(trace(start, [line(10.0)]), _SPEED_MPS, "10 m on a wooden floor"),
        "indoor": Route.from_poses(
            trace(start, _ending(_INDOOR, _INDOOR_M)), _SPEED_MPS, "13.4 m through four gates of poles"
        ),
        "outdoor": Route.from_poses(
            trace(start, _ending(_OUTDOOR, _OUTDOOR_M)), _SPEED_MPS, "243.4 m over several grounds"
        ),
    }


def _ending(pieces: Sequence[tuple[float, float]], total_m: float) -> list[tuple[float, float]]:
    """Return the pieces and a straight end that makes the whole as long as it is to be."""
    return [*pieces, line(total_m - sum(length for length, _ in pieces))]


def _gates(route: Route) -> tuple[Pole, ...]:
    side_m = _GATE_M / 2.0 + _POLE_RADIUS_M  # what is 0.50 m apart are the poles' faces
    poles = []
    for number, station_m in enumerate(_GATE_STATIONS_M, start=1):
        for side, left_m in (("left", side_m), ("right", -side_m)):
            place = route.pose_at(station_m) @ Pose2(0.0, left_m)
            poles.append(Pole(f"the {side} pole of gate {number}", place.x, place.y, _POLE_RADIUS_M))
    return tuple(poles)


def _light_lux(route: str, pose: Pose2, stamp_s: float) -> float:
    """Return the light: lamps every 3 m indoors, a cloudy sky outdoors."""
    if route == "outdoor":
        return 12000.0 * (1.0 + 0.3 * math.sin(pose.x / 17.0) * math.sin(pose.y / 13.0 + stamp_s / 200.0))
    return 350.0 * (1.0 + 0.25 * math.cos(2.0 * math.pi * pose.x / 3.0))


def _camera(
    course: GroundCourseOptions, options: WorldOptions, name: str, route: Route, sensor: str
) -> GroundCameraSensor:
    given = course.camera
    rig = GroundRig(
        given.width,
        given.height,
        (given.field_mm[0] / 1e3, given.field_mm[1] / 1e3),
        options.rate_of(sensor, 70.0),
        Pose3(x=given.x_m, yaw=math.radians(given.yaw_deg)),
    )
    day = course.in_replay if options.mode == "replay" and course.in_replay is not None else course.today
    weather = Weather(day.day, day.dirt, day.leaves_per_m2, day.wet)
    zones = [*_zones(course, name, route), *_covers(course, options, route)]
    texel_m = min(rig.metres_per_pixel) / _OVERSAMPLING
    # Every course lies on ground of its own.
    ground = GroundTexture(zones, stream_key(options.world_seed, name), weather, texel_m)
    ground.load()
    optics = _optics(given, day)
    return GroundCameraSensor(sensor, ground, rig, optics, options.seed, cap_mb=given.tiles_mb, threads=options.threads)


def _optics(given: CameraOptions, day: DayOptions) -> Optics:
    return Optics(
        psf_px=given.psf_px,
        vignette=given.vignette,
        read_noise=given.read_noise,
        shot_noise=given.shot_noise,
        gain=day.gain,
        offset=day.offset,
        exposure_s=given.exposure_ms / 1e3,
        readout_s=given.readout_ms / 1e3,
        height_jitter=given.height_jitter,
        tilt_jitter_rad=given.tilt_jitter_mrad / 1e3,
    )


def _zones(course: GroundCourseOptions, name: str, route: Route) -> list[Zone]:
    if course.floor is not None or course.texture is not None:
        return [Zone(_floor(course))]
    if name != "outdoor":
        return [Zone(Floor("wood", yaw_rad=math.radians(course.floor_yaw_deg)))]
    zones = [Zone(Floor("asphalt"))]
    stations = [station_m for station_m, _, _ in _OUTDOOR_FLOORS]
    for (first_m, kind, yaw_deg), last_m in zip(_OUTDOOR_FLOORS, [*stations[1:], _OUTDOOR_M + 5.0]):
        zones.append(Zone(Floor(kind, yaw_rad=math.radians(yaw_deg)), _box(route, first_m, last_m, 0.6)))
    return zones


def _covers(course: GroundCourseOptions, options: WorldOptions, route: Route) -> list[Zone]:
    zones = [(cover, Zone(_floor(cover), _cover_box(route, cover))) for cover in course.covered]
    return [zone for cover, zone in zones if cover.when == "always" or options.mode == "replay"]


def _cover_box(route: Route, cover: Covered) -> tuple[float, float, float, float]:
    if cover.from_m >= route.length_m:
        raise ConfigError(
            f"sim: the route is {route.length_m:.1f} m long, but is to be covered from {cover.from_m:g} m"
        )
    return _box(route, cover.from_m, cover.to_m, cover.width_m / 2.0)


def _floor(given: FloorOptions) -> Floor:
    photo = None if given.texture is None else Path(given.texture)
    return Floor(given.floor or "wood", photo, given.texture_width_m, math.radians(given.floor_yaw_deg))


def _box(route: Route, first_m: float, last_m: float, side_m: float) -> tuple[float, float, float, float]:
    """Return the box around a stretch of the route and what lies `side_m` to its left and right."""
    poses = [route.pose_at(station_m) for station_m in np.linspace(first_m, last_m, 32)]
    sides: Floats = np.concatenate([pose @ np.array([[0.0, side_m], [0.0, -side_m]]) for pose in poses])
    (west, south), (east, north) = sides.min(axis=0), sides.max(axis=0)
    return float(west), float(east), float(south), float(north)
