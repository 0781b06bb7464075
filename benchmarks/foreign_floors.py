"""Starts of `ground_map` on floors that were taught, on the same kind of floor elsewhere, and on other floors.

A way of 1 m is taught. Then the robot is put down, 5 mm and 1.5 deg (1 sigma) beside one of its places, or anywhere on
ground that was not taught. Either it is not told where (`start: unknown`; it stands until all places were tried, then
drives on for 10 cm), or it is told a place of the path, and looks there once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from ground_conditions import CASES, MADE, RATE_HZ, SCALE_M, SIZE, Weather, sensor, texture_of
from ground_scenes import photographs

from trailmark.arrays import Grey8
from trailmark.estimates import Belief, Fix
from trailmark.frames import Frame, Image
from trailmark.geometry import Pose2
from trailmark.interfaces import LocalizerMap, Session
from trailmark.testing import MemoryMap
from trailmark.testing.ground import GroundCamera, MirroredFloor
from trailmark_ground_vo.config import GroundMapConfig
from trailmark_ground_vo.map_localizer import GroundMap

__all__ = ["FloorStart", "ground_map_places"]

_TAUGHT_M, _SPACING_M = 1.0, 0.05
_STANDS, _DRIVES_ON, _DRIVE_M = 2, 5, 0.02
_SPREAD_M, _SPREAD_RAD = 5e-3, math.radians(1.5)
#: Photographs of which the other half is the same ground: half a picture on they correlate by 0.75 and 0.56.
_REPEATED = ("artificial_turf_1k", "grass_1k")
_SMALL = ("tiles_1k", "warehouse_concrete_1k")
_RIGHT_M, _RIGHT_RAD = 5e-3, math.radians(1.0)


@dataclass(frozen=True, slots=True)
class FloorStart:
    """A start or a search, and what became of it.

    Attributes
    ----------
    place, put_down : str
        The floor that was taught; where the robot was put, and whether it was told where.
    is_right : bool or None
        Whether the pose that was told is right; None where none was.
    """

    place: str
    put_down: str
    is_right: bool | None


class _Eye:
    """The camera over a floor, in good light."""

    def __init__(self, texture: Grey8, seed: int) -> None:
        self._ground = MirroredFloor(texture, SCALE_M)
        self._camera = GroundCamera(SIZE, (SCALE_M, SCALE_M))
        self._rng, self._n = np.random.default_rng([21, seed]), 0

    def see(self, pose: Pose2) -> Frame:
        case = CASES["nominal"]
        at = Weather(self._n, 1, self._rng, self._rng, pose, 0.0)
        light = case.change(self._camera.view(self._ground, pose), at)
        assert light is not None
        noisy = light + np.float32(case.noise) * self._rng.standard_normal(light.shape, dtype=np.float32)
        self._n += 1
        return Frame("floor", self._n / RATE_HZ, Image(np.clip(np.rint(noisy), 0, 255).astype(np.uint8)))


def ground_map_places(is_quick: bool) -> dict[str, Callable[[], Iterator[FloorStart]]]:
    """Return what yields the starts, by floor."""
    floors = [*MADE, *(name for name in photographs() if name not in (*_SMALL, *_REPEATED))]
    n_starts, n_searches = (3, 40) if is_quick else (10, 100)
    return {
        floor: partial(_floor_starts, floors, number, n_starts, n_searches)
        for number, floor in enumerate(floors[:4] if is_quick else floors)
    }


def _floor_starts(floors: Sequence[str], number: int, n_starts: int, n_searches: int) -> Iterator[FloorStart]:
    """Yield starts on a floor; of a photograph a half is taught, and the other half is the same kind elsewhere."""
    floor = floors[number]
    own, twin = _own_and_twin(floor)
    other = texture_of(floors[(number + 4) % len(floors)])
    poses = _path(number)
    taught = _taught(_Eye(own, number), poses)
    put_downs = [("same kind, elsewhere", twin), ("another floor", other)]
    if floor in MADE:  # of a small photograph the same ground comes again, so that right places have copies
        put_downs.insert(0, ("its own", own))
    for name, texture in put_downs:
        eye, rng = _Eye(texture, 100 + number), np.random.default_rng([22, number])
        for _ in range(n_starts):
            truth = _beside(poses[int(rng.integers(len(poses)))], rng)
            yield FloorStart(floor, f"{name}, not told", _judge(_first_fix(taught, eye, truth), name))
        told = _started("replay", taught)
        for n in range(n_searches):
            place = poses[(7 * n) % len(poses)]  # a place is looked for once in a row
            truth = _beside(place, rng)
            found = _fix_when_told(told, eye, truth, _beside(place, rng))
            yield FloorStart(floor, f"{name}, told", _judge(found, name))


def _own_and_twin(floor: str) -> tuple[Grey8, Grey8]:
    if floor in MADE:
        return texture_of(floor, side_px=4096), texture_of(floor, side_px=4096, seed=1)
    whole = texture_of(floor)
    half = whole.shape[1] // 2
    return np.ascontiguousarray(whole[:, :half]), np.ascontiguousarray(whole[:, half : 2 * half])


def _path(seed: int) -> list[Pose2]:
    """Return poses of base every 5 cm along a bend, the same for every floor of a number."""
    rng = np.random.default_rng([7, seed])
    start = Pose2(0.3, 0.3, float(rng.uniform(0.2, 0.8)))
    return [start @ Pose2.exp(n * _SPACING_M, 0.0, n * _SPACING_M / 1.5) for n in range(round(_TAUGHT_M / _SPACING_M))]


def _beside(pose: Pose2, rng: np.random.Generator) -> Pose2:
    return pose @ Pose2(*rng.normal(0.0, _SPREAD_M, 2).tolist(), float(rng.normal(0.0, _SPREAD_RAD)))


def _taught(eye: _Eye, poses: Sequence[Pose2]) -> LocalizerMap:
    places = MemoryMap()
    localizer = _started("teach", places)
    for index, pose in enumerate(poses):
        frame = eye.see(pose)
        localizer.observe(frame, Belief(frame.stamp_s, pose_map_base=pose, travelled_m=index * _SPACING_M))
    localizer.finish()
    return places


def _started(mode: Literal["teach", "replay"], places: LocalizerMap) -> GroundMap:
    localizer = GroundMap(GroundMapConfig(camera="floor", max_attempts=1))
    localizer.start(Session(name="floor_map", mode=mode, sensors={"floor": sensor()}, map=places))
    return localizer


def _first_fix(places: LocalizerMap, eye: _Eye, truth: Pose2) -> Pose2 | None:
    """Return the error of the first `Fix` of a robot that is not told where it is."""
    localizer = _started("replay", places)
    for n in range(_STANDS + _DRIVES_ON):
        driven = Pose2(max(0, n - _STANDS) * _DRIVE_M, 0.0, 0.0)
        frame = eye.see(truth @ driven)
        belief = Belief(frame.stamp_s, pose_odom_base=driven, travelled_m=driven.x)
        for answer in localizer.observe(frame, belief):
            if isinstance(answer, Fix):
                return (truth @ driven).between(answer.pose_map_base)
    return None


def _fix_when_told(localizer: GroundMap, eye: _Eye, truth: Pose2, told: Pose2) -> Pose2 | None:
    """Return the error of what is found where a robot is told to be."""
    frame = eye.see(truth)
    for answer in localizer.observe(frame, Belief(frame.stamp_s, pose_map_base=told)):
        if isinstance(answer, Fix):
            return truth.between(answer.pose_map_base)
    return None


def _judge(error: Pose2 | None, put_down: str) -> bool | None:
    if error is None:
        return None
    is_near = math.hypot(error.x, error.y) <= _RIGHT_M and abs(error.theta) <= _RIGHT_RAD
    return put_down == "its own" and is_near
