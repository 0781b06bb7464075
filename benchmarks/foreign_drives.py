"""Starts of robots that were not told where they are: in places that were taught, and in others."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from laser_floors import Floor, drive, map_of, office, store_hall, symmetric_corridor
from laser_maps import RIGHT_M, RIGHT_RAD, WITHIN_S, answers
from laser_start import started
from winding_drives import SPEED_MPS, STEP_M, Drive, Taught, WindingPlace, again_poses, drive_poses, shown, taught_for

from trailmark.estimates import Belief, Fix, PathOffset
from trailmark.frames import Frame
from trailmark.interfaces import LocalizerMap
from trailmark.testing import MemoryMap
from trailmark_divs.config import DivsConfig
from trailmark_divs.localizer import Divs
from trailmark_laser_maps.map_yaml import write_map

__all__ = ["Start", "divs_places", "laser_places"]

_OWN, _LIT, _TWIN, _OTHER = "its own", "its own, other light", "same plan or kind, another place", "another place"
_FOUND_M, _DRIVEN_S, _STARTS_S = 0.75, 10.0, (1.5, 6.0, 10.5, 15.0, 19.5)  # divs: 8 m at 0.3 m/s
_TAUGHT = (1, 2, 3, 4, 5)  # worlds; 11 to 16 and 31 to 36 were those that parameters were chosen on
_TWINS, _OTHERS = (50, 60), (70,)
_LIGHTS: Mapping[str, Mapping[str, Any]] = {
    "street": {"time": "afternoon", "people": 3},
    "corridor": {"time": "afternoon", "lamps": "half", "people": 3},
}


@dataclass(frozen=True, slots=True)
class Start:
    """A start, and what became of it.

    Attributes
    ----------
    place : str
        Kind of place that was taught.
    put_down : str
        Where the robot was put.
    is_right : bool or None
        Whether the pose that was told is right; None where none was.
    told_s : float or None
        When it was told, where that is asked [s].
    """

    place: str
    put_down: str
    is_right: bool | None
    told_s: float | None = None


def divs_places(is_quick: bool) -> dict[str, Callable[[], Iterator[Start]]]:
    """Return what yields the starts of `divs`, by winding street or corridor."""
    numbers = _TAUGHT[:1] if is_quick else _TAUGHT
    return {f"{world} {number}": partial(_divs_starts, world, number) for world in _LIGHTS for number in numbers}


def _divs_starts(world: str, number: int) -> Iterator[Start]:
    """Yield starts in a place, its twins and others: 10 s of driving each, or to the end of the way."""
    place = WindingPlace(world=world, number=number)
    taught = taught_for(place)
    taught.teach({"divs": _divs})
    morning = {"time": "morning"}
    puts = [(_OWN, number, place, morning), (_LIT, number, place, _LIGHTS[world])]
    puts += [(_TWIN, number + apart, place, morning) for apart in _TWINS]
    puts += [(_OTHER, number + apart, WindingPlace(world=world, number=number + apart), morning) for apart in _OTHERS]
    for put_down, where, way, options in puts:
        poses, stations_m = again_poses(way, seed=1)
        drive = drive_poses(WindingPlace(world=world, number=where), poses, stations_m, options, seed=1001)
        for first_s in _STARTS_S:
            told_s, off_m = _first_told(taught, drive, first_s)
            is_right = None if told_s is None else put_down in (_OWN, _LIT) and off_m <= _FOUND_M
            yield Start(world, put_down, is_right, told_s)


def _divs() -> Divs:
    return Divs(DivsConfig.model_validate({"camera": "front", "when_blind": "pictures"}))


def _first_told(taught: Taught, drive: Drive, first_s: float) -> tuple[float | None, float]:
    """Drive on from a start; return when a place is told [s], and how far off its station is [m]."""
    rows = slice(round(first_s * SPEED_MPS / STEP_M), round((first_s + _DRIVEN_S) * SPEED_MPS / STEP_M) + 2)
    part = Drive(drive.poses[rows], drive.stations_m[rows], drive.payloads[rows])
    for k, answer in enumerate(shown(taught.replayer("divs", _divs), part, is_placed=False)):
        if answer and isinstance(answer[0], PathOffset) and answer[0].information[0, 0] > 0.0:
            return k * STEP_M / SPEED_MPS, abs(answer[0].station_m - float(part.stations_m[k]))
    return None, 0.0


def laser_places(method: str, is_quick: bool) -> dict[str, Callable[[], Iterator[Start]]]:
    """Return what yields the starts of a laser, by floor: 15 s of driving each."""
    n = 3 if is_quick else 10
    return {floor.name: partial(_laser_starts, method, k, n) for k, floor in enumerate(_floors(21))}


def _laser_starts(method: str, k: int, n: int) -> Iterator[Start]:
    """Yield starts on the floor of the map and on others."""
    floor = _floors(21)[k]
    others = [(_OWN, floor), (_TWIN, _floors(31)[k]), (_OTHER, _floors(41)[(k + 1) % 3])]
    with tempfile.TemporaryDirectory() as folder:
        told = _grid_mcl(floor, Path(folder)) if method == "grid_mcl" else _laser_icp(floor)
        for put_down, met in others:
            for seed in range(n):
                is_right = told(met, 3000 + seed)
                place = floor.name.rstrip("0123456789 ")
                yield Start(place, put_down, is_right and put_down == _OWN if is_right is not None else None)


def _floors(seed: int) -> Sequence[Floor]:
    return office(seed), store_hall(seed), symmetric_corridor(3 + seed % 4)


def _grid_mcl(floor: Floor, folder: Path) -> Any:
    map_file = folder / f"{floor.name.replace(' ', '_')}.yaml"
    write_map(map_file, map_of(floor))

    def told(met: Floor, seed: int) -> bool | None:
        said = [one for one in answers(drive(met, seed, WITHIN_S), map_file, seed) if one.error is not None]
        return all(one.is_right for one in said) if said else None

    return told


def _laser_icp(floor: Floor) -> Any:
    """Teach drives of two minutes; return what says whether a start is told a right pose."""
    localizer_map: LocalizerMap = MemoryMap()
    localizer, way_m = started("teach", localizer_map), 0.0
    last = None
    for instant in drive(floor, 77, 120.0):
        way_m += 0.0 if last is None else last.distance_to(instant.truth)
        last = instant.truth
        belief = Belief(instant.stamp_s, instant.truth, travelled_m=way_m)
        localizer.observe(Frame("laser", instant.stamp_s, instant.scan), belief)
    localizer.finish()

    def told(met: Floor, seed: int) -> bool | None:
        begun = started("replay", localizer_map)
        for instant in drive(met, seed, WITHIN_S):
            belief = Belief(instant.stamp_s, pose_odom_base=instant.odometry)
            for answer in begun.observe(Frame("laser", instant.stamp_s, instant.scan), belief):
                if isinstance(answer, Fix):
                    off = instant.truth.between(answer.pose_map_base)
                    return math.hypot(off.x, off.y) <= RIGHT_M and abs(off.theta) <= RIGHT_RAD
        return None

    return told
