"""Starts of `omni_surf` and `kinect_landmarks` in places that were taught, of the same plan, and of another.

A way is taught with exact poses. Then the robot is put down beside it, not told where, and drives on with exact
odometry, 5 cm a picture. Supermarkets, laboratories and hallways of two worlds have the same walls, furniture and
lamps, and other goods, posters and boards.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

import numpy as np

from trailmark.estimates import Belief, Fix
from trailmark.frames import Frame, Payload, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, LocalizerMap, Session
from trailmark.testing import MemoryMap
from trailmark_kinect_landmarks.config import KinectLandmarksConfig
from trailmark_kinect_landmarks.localizer import KinectLandmarks
from trailmark_omni_surf.config import OmniSurfConfig
from trailmark_omni_surf.localizer import OmniSurf
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds import build_world
from trailmark_sim.worlds.base import WorldOptions

__all__ = ["SightStart", "sight_places"]

_OWN, _CHANGED = "its own", "its own; people, fewer lamps"
_STEP_M, _PICTURES_HZ = 0.05, 6.0
_FIRSTS, _DRIVEN = (0, 24, 44), 8  # pictures
_RIGHT_M, _RIGHT_RAD = 0.25, math.radians(5.0)
_TAUGHT = (61, 62, 63, 64, 65)  # parameters were chosen on 41 to 46
_TWINS = (10, 50)


@dataclass(frozen=True, slots=True)
class SightStart:
    """A start, and what became of it.

    Attributes
    ----------
    place, put_down : str
        What was taught; where the robot was put.
    is_right : bool or None
        Whether the first pose that was told is right; None where none was.
    """

    place: str
    put_down: str
    is_right: bool | None


@dataclass(frozen=True)
class _Place:
    """A simulated world, and who goes about in it."""

    world: str
    number: int
    extra: Mapping[str, Any] = field(default_factory=dict)

    def route(self, sensor: str) -> list[Pose2]:
        """Return the poses of a straight way through it."""
        name = "wall" if self.world == "supermarket" else "straight"
        route = build_world(self.world, WorldOptions(world_seed=self.number, sensors=(sensor,), route=name)).routes[
            name
        ]
        return [route.pose_at(s) for s in np.arange(0.0, 3.5, _STEP_M).tolist()]

    def see(self, sensor: str, poses: Sequence[Pose2], seed: int) -> tuple[SensorInfo, list[Payload]]:
        """Return what a sensor sees from poses."""
        options = WorldOptions(seed=seed, world_seed=self.number, sensors=(sensor,), threads=1, extra=self.extra)
        eye = next(one for one in build_world(self.world, options).sensors if one.info.name == sensor)
        return eye.info, [eye.render(k, k / _PICTURES_HZ, VehicleState(pose)) for k, pose in enumerate(poses)]


@dataclass(frozen=True)
class _Method:
    """A localizer, its sensor, the worlds that it is put into, and what changes in its own one.

    `besides` are the poses in which it starts, seen from the taught ones.
    """

    sensor: str
    worlds: tuple[str, ...]
    extra: Mapping[str, Any]
    changed: Mapping[str, Mapping[str, Any]]
    besides: Sequence[Pose2]

    def start(self, mode: Literal["teach", "replay"], info: SensorInfo, places: LocalizerMap, seed: int) -> Localizer:
        localizer: Localizer
        if self.sensor == "omni":
            localizer = OmniSurf(OmniSurfConfig(camera="omni"))
        else:
            localizer = KinectLandmarks(KinectLandmarksConfig(camera="rgbd", adapt=False))
        rng = np.random.default_rng(seed)
        localizer.start(Session(name="sight", mode=mode, sensors={self.sensor: info}, map=places, rng=rng))
        return localizer


def _beside(left_m: float, turned_deg: float) -> Pose2:
    return Pose2(0.0, left_m, math.radians(turned_deg))


METHODS = {
    "omni_surf": _Method(
        "omni",
        ("supermarket", "street"),
        {},
        {"supermarket": {"lighting": "half", "people": 4}, "street": {"time": "afternoon", "people": 4}},
        [_beside(0.05, 3.0), _beside(-0.05, 3.0), _beside(0.25, -20.0)],
    ),
    "kinect_landmarks": _Method(
        "rgbd",
        ("lab", "hallway"),
        {"registered": True},
        {"lab": {"people": 3}, "hallway": {"people": 3}},
        [_beside(0.05, 3.0), _beside(-0.05, 3.0)],
    ),
}


def sight_places(name: str, is_quick: bool) -> dict[str, Callable[[], Iterator[SightStart]]]:
    """Return what yields the starts of a method, by place; `is_quick`: one place of each kind."""
    numbers = _TAUGHT[:1] if is_quick else _TAUGHT
    return {
        f"{world} {number}": partial(_place_starts, name, world, number)
        for world in METHODS[name].worlds
        for number in numbers
    }


def _place_starts(name: str, world: str, number: int) -> Iterator[SightStart]:
    method = METHODS[name]
    other = next(one for one in method.worlds if one != world)
    own = _Place(world, number, method.extra)
    poses = own.route(method.sensor)
    places = _taught(method, own, poses)
    put_downs = [
        (_OWN, own),
        (_CHANGED, _Place(world, number, {**method.extra, **method.changed[world]})),
        *(("same plan, another place", _Place(world, number + apart, method.extra)) for apart in _TWINS),
        ("another place", _Place(other, number, method.extra)),
    ]
    for put_down, place in put_downs:
        for is_right in _starts(method, places, place, poses if place.world == world else None):
            is_own = put_down in (_OWN, _CHANGED)
            yield SightStart(world, put_down, None if is_right is None else is_right and is_own)


def _starts(
    method: _Method, places: LocalizerMap, place: _Place, poses: Sequence[Pose2] | None
) -> Iterator[bool | None]:
    """Yield what becomes of the starts in a place, beside some poses; left out: those of its own route."""
    way = place.route(method.sensor) if poses is None else poses
    for k, beside in enumerate(method.besides):
        for first in _FIRSTS:
            part = [pose @ beside for pose in way[first : first + _DRIVEN]]
            yield _first_told(method, places, (place, part), 100 * (k + 1) + first)


def _taught(method: _Method, place: _Place, poses: Sequence[Pose2]) -> LocalizerMap:
    info, seen = place.see(method.sensor, poses, 0)
    places = MemoryMap()
    localizer = method.start("teach", info, places, 0)
    for k, (pose, payload) in enumerate(zip(poses, seen, strict=True)):
        belief = Belief(k / _PICTURES_HZ, pose, pose_odom_base=pose, travelled_m=_STEP_M * k, motion_age_s=0.0)
        localizer.observe(Frame(method.sensor, k / _PICTURES_HZ, payload), belief)
    localizer.finish()
    return places


def _first_told(method: _Method, places: LocalizerMap, drive: tuple[_Place, list[Pose2]], seed: int) -> bool | None:
    """Return whether the first pose that is told is right; None: none is."""
    place, poses = drive
    info, seen = place.see(method.sensor, poses, seed)
    localizer = method.start("replay", info, places, seed)
    for k, (pose, payload) in enumerate(zip(poses, seen, strict=True)):
        stamp_s = k / _PICTURES_HZ
        belief = Belief(stamp_s, pose_odom_base=poses[0].between(pose), travelled_m=_STEP_M * k, motion_age_s=0.0)
        for answer in localizer.observe(Frame(method.sensor, stamp_s, payload), belief):
            if isinstance(answer, Fix):
                off = pose.between(answer.pose_map_base)
                return math.hypot(off.x, off.y) <= _RIGHT_M and abs(off.theta) <= _RIGHT_RAD
    return None
