"""Winding ways in simulated streets and corridors, driven twice: what a camera sees, what wheels say, and the truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Belief, Estimate, PathOffset
from trailmark.frames import RGBD, Frame, Image, Payload
from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import Localizer, LocalizerMap, Session
from trailmark.paths import Path as TaughtPath
from trailmark.paths import Waypoint
from trailmark.testing import MemoryMap
from trailmark_papers.perroni2014.true_shift import Eyepiece
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds import build_world
from trailmark_sim.worlds.base import WorldOptions

WIDTH_PX = 160
STEP_M = 0.015
SPEED_MPS = 0.3
_DEPTH_EVERY = 2
#: What wheels and a gyroscope say falsely: of the way, of the turn in a metre.
_WHEEL_SCALE, _GYRO_DEG_PER_M = 1.01, 0.2

Maker = Callable[[], Localizer]


@dataclass(frozen=True, slots=True, kw_only=True)
class WindingPlace:
    """A winding way through one world.

    Attributes
    ----------
    world : {"street", "corridor"}
        Kind of world.
    number : int
        Which world of that kind; its way winds by this number, too.
    length_m : float
        How far it is driven [m].
    """

    world: str
    number: int
    length_m: float = 8.0

    def poses(self) -> list[Pose2]:
        """Return the taught poses, a step apart along the way."""
        rng = np.random.default_rng(self.number)
        wide_m, long_m = (0.9, 9.0) if self.world == "street" else (0.4, 5.5)
        wide_m, long_m = wide_m * rng.uniform(0.7, 1.0), long_m * rng.uniform(0.7, 1.1)
        phase, begin_m = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(1.0, 4.0)
        x = np.arange(0.0, 1.5 * self.length_m, 1e-3)
        y = wide_m * np.sin(2.0 * math.pi * x / long_m + phase)
        way_m = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
        at = np.arange(0.0, self.length_m, STEP_M)
        heading = np.interp(at, way_m, np.arctan(np.gradient(y, x)))
        columns = np.interp(at, way_m, x) + begin_m, np.interp(at, way_m, y), heading
        return [Pose2(*row) for row in np.column_stack(columns).tolist()]


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """A drive: where it truly went, beside which poses of the path, and what was seen.

    Attributes
    ----------
    poses : list of Pose2
        True poses.
    stations_m : (N,) float64
        True place of each along the taught way, as the wheels told it in teaching [m].
    payloads : list of Payload
        Pictures.
    """

    poses: list[Pose2]
    stations_m: Floats
    payloads: list[Payload]

    def pose_at(self, stamp_s: float) -> Pose2:
        """Return where the robot was at a stamp."""
        at = min(max(stamp_s * SPEED_MPS / STEP_M, 0.0), len(self.poses) - 1.0)
        before = min(int(at), len(self.poses) - 2)
        return self.poses[before].interpolate(self.poses[before + 1], at - before)

    def beliefs(self, is_placed: bool = True) -> Iterator[Belief]:
        """Yield what dead reckoning believes; it does not know the place on the path if it is not told."""
        odom, way_m = Pose2(), 0.0
        for k, pose in enumerate(self.poses):
            if k:
                moved = self.poses[k - 1].between(pose)
                turned = moved.theta + math.radians(_GYRO_DEG_PER_M) * moved.x
                odom = odom @ Pose2(_WHEEL_SCALE * moved.x, moved.y, turned)
                way_m += _WHEEL_SCALE * math.hypot(moved.x, moved.y)
            stamp_s = k * STEP_M / SPEED_MPS
            # Others keep the place to some centimetres: what drifts is not what is measured here.
            station_m = float(self.stations_m[k]) + 0.05 * math.sin(0.7 * way_m)
            yield Belief(
                stamp_s,
                pose if is_placed else None,
                pose_odom_base=odom,
                twist=Twist2(SPEED_MPS),
                travelled_m=way_m,
                on_path=PathOffset(stamp_s, station_m, 0.0, 0.0, np.zeros((3, 3))) if is_placed else None,
                motion_age_s=0.0,
            )


@dataclass(frozen=True, eq=False)
class Taught:
    """A place, and what there was to see while it was taught."""

    place: WindingPlace
    drive: Drive
    eyepiece: Eyepiece
    points: list[Floats]
    sensors: Mapping[str, Any]
    maps: dict[str, LocalizerMap] = field(default_factory=dict)

    @cached_property
    def path(self) -> TaughtPath:
        """The taught path; its stations are the way that wheels told."""
        return TaughtPath(Waypoint(k, _WHEEL_SCALE * STEP_M * k, pose) for k, pose in enumerate(self.drive.poses))

    def session(self, mode: Any, localizer_map: LocalizerMap) -> Session:
        """Return what a localizer is told."""
        path = None if mode == "teach" else self.path
        return Session(name="bench", mode=mode, sensors=self.sensors, path=path, map=localizer_map)

    def teach(self, makers: Mapping[str, Maker]) -> None:
        """Let localizers remember the way."""
        for name, make in makers.items():
            self.maps[name], localizer = MemoryMap(), make()
            localizer.start(self.session("teach", self.maps[name]))
            for _ in shown(localizer, self.drive):
                pass
            localizer.finish()

    def replayer(self, name: str, make: Maker) -> Localizer:
        """Return a localizer that has started to replay."""
        localizer = make()
        localizer.start(self.session("replay", self.maps[name]))
        return localizer

    def true_columns(self, offset: PathOffset, drive: Drive) -> float:
        """Return by how much the picture of an answer is truly displaced against that at its station [columns].

        The median over what the upper half showed at the station, between the taught pose there and the true one.
        """
        taught, seen = self.path.pose_at(offset.station_m), drive.pose_at(offset.stamp_s)
        k = min(max(round(offset.station_m / (_WHEEL_SCALE * STEP_M * _DEPTH_EVERY)), 0), len(self.points) - 1)
        moved_px = self.eyepiece.u_px(self.points[k], seen) - self.eyepiece.u_px(self.points[k], taught)
        return float(np.nanmedian(moved_px)) / self.eyepiece.column_px


def shown(localizer: Localizer, drive: Drive, is_placed: bool = True) -> Iterator[Sequence[Estimate]]:
    """Show a drive to a localizer; yield its answers."""
    for belief, payload in zip(drive.beliefs(is_placed), drive.payloads, strict=True):
        yield localizer.observe(Frame("front", belief.stamp_s, payload), belief)


def teach_way(place: WindingPlace, seed: int = 0) -> Taught:
    """Drive a place for the first time: in the morning, with nobody about."""
    sensors = _sensors(place, {"time": "morning"}, seed, ("front", "front_depth"))
    drive = _driven(sensors["front"], place.poses(), np.arange(len(place.poses())) * _WHEEL_SCALE * STEP_M)
    camera = sensors["front"].info
    eyepiece = Eyepiece(camera.calibration, camera.size, camera.pose_base_sensor)
    poses = drive.poses[::_DEPTH_EVERY]
    depths = [sensors["front_depth"].render(k, 0.0, VehicleState(pose)) for k, pose in enumerate(poses)]
    points = [eyepiece.points(depth.depth_m, pose) for depth, pose in zip(depths, poses) if isinstance(depth, RGBD)]
    return Taught(place, drive, eyepiece, points, {"front": camera})


def taught_for(place: WindingPlace, seed: int = 0) -> Taught:
    """Drive a place for the first time, without the depth that tells true shifts."""
    sensor = _sensors(place, {"time": "morning"}, seed, ("front",))["front"]
    poses = place.poses()
    drive = _driven(sensor, poses, np.arange(len(poses)) * _WHEEL_SCALE * STEP_M)
    camera = sensor.info
    eyepiece = Eyepiece(camera.calibration, camera.size, camera.pose_base_sensor)
    return Taught(place, drive, eyepiece, [], {"front": camera})


def drive_again(taught: Taught, options: Mapping[str, Any], seed: int) -> Drive:
    """Drive a place again, weaving 7 cm and some degrees about the taught way."""
    poses, stations_m = again_poses(taught.place, seed)
    return drive_poses(taught.place, poses, stations_m, options, 1000 + seed)


def again_poses(place: WindingPlace, seed: int) -> tuple[list[Pose2], Floats]:
    """Return the poses of a second drive, and their stations as the wheels of teaching told them [m]."""
    rng = np.random.default_rng((seed, place.number))
    taught = place.poses()
    stations_m = np.arange(len(taught)) * STEP_M
    wave = 2.0 * math.pi * stations_m / rng.uniform(3.0, 6.0) + rng.uniform(0.0, 2.0 * math.pi)
    aside_m = 0.1 * np.sin(wave)
    turned = np.arctan(np.gradient(aside_m, stations_m)) + math.radians(rng.uniform(-4.0, 4.0))
    poses = [pose @ Pose2(0.0, y, t) for pose, y, t in zip(taught, aside_m.tolist(), turned.tolist(), strict=True)]
    return poses, _WHEEL_SCALE * stations_m


def drive_poses(
    place: WindingPlace, poses: list[Pose2], stations_m: Floats, options: Mapping[str, Any], seed: int
) -> Drive:
    """Return what is seen at some poses of a world, whatever way that world has of its own."""
    return _driven(_sensors(place, options, seed, ("front",))["front"], poses, stations_m)


def _driven(sensor: Any, poses: list[Pose2], stations_m: Floats) -> Drive:
    payloads = []
    for k, pose in enumerate(poses):
        payload = sensor.render(k, k * STEP_M / SPEED_MPS, VehicleState(pose))
        assert isinstance(payload, Image)
        payloads.append(payload)
    return Drive(poses, stations_m, payloads)


def _sensors(place: WindingPlace, options: Mapping[str, Any], seed: int, names: tuple[str, ...]) -> dict[str, Any]:
    extra = {"width_px": WIDTH_PX, **options}
    given = WorldOptions(seed=seed, world_seed=place.number, mode="track", sensors=names, threads=1, extra=extra)
    return {sensor.info.name: sensor for sensor in build_world(place.world, given).sensors}
