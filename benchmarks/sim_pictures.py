"""Render the simulator's pictures of the manual: every world and every sensor that can be looked at.

python benchmarks/sim_pictures.py [--out FOLDER] [--only NAME]
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import Mode
from trailmark_sim.ground.floors import FLOORS
from trailmark_sim.pictures import picture_of
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds import build_world
from trailmark_sim.worlds.base import WorldOptions

Picture = npt.NDArray[np.uint8]
Day = tuple[str, dict[str, Any], Mode]


@dataclass(frozen=True)
class Shot:
    """A picture: what takes it, and from where: a pose [m, m, deg], or how far along the route [m]."""

    world: str
    sensor: str
    at: tuple[float, float, float] | float
    route: str | None = None
    options: dict[str, Any] = field(default_factory=dict)
    twist: Twist2 = Twist2()
    stamp_s: float = 1.0
    mode: Mode = "teach"


_WALKERS = {"people": 3}
_FAST = Twist2(0.3, 0.0, 1.2)
_SLOW_SHUTTER = {"exposure_ms": 12, "readout_ms": 45, "people": 2}
SHOTS = {
    "corridor_front": Shot("corridor", "front", 3.0, options={"people": 2}),
    "corridor_bends": Shot("corridor", "front", 13.5, "bends", {"people": 2}),
    "corridor_rolling": Shot("corridor", "front", 3.0, options=_SLOW_SHUTTER, twist=_FAST),
    "ground_course_floor": Shot("ground_course", "floor", 25.0, "outdoor"),
    "hallway_rgbd": Shot("hallway", "rgbd", 0.5),
    "lab_rgbd": Shot("lab", "rgbd", 0.3, options={"people": 2}),
    "street_bends": Shot("street", "front", 13.0, "bends", _WALKERS),
    "street_front_afternoon": Shot("street", "front", 2.0, options={"time": "afternoon", **_WALKERS}),
    "street_front_morning": Shot("street", "front", 2.0, options={"time": "morning", **_WALKERS}),
    "supermarket_floor": Shot("supermarket", "floor", (1.2, 2.0, 0.0)),
    "supermarket_front_depth": Shot("supermarket", "front_depth", (5.1, 5.9, 90.0)),
    "supermarket_laser": Shot("supermarket", "laser", (5.1, 5.6, 90.0), options={"people": 8}),
    "supermarket_omni": Shot("supermarket", "omni", (5.1, 5.6, 90.0), options={"people": 8}),
    "supermarket_rgbd": Shot("supermarket", "rgbd", (1.2, 7.6, 0.0), options=_WALKERS),
    "target_rgbd": Shot("target", "rgbd", 0.0, stamp_s=2.5),
}
#: What another day does to the paper's course: title, options, whether the vehicle has come back.
DAYS: tuple[Day, ...] = (
    ("asphalt, dirt", {"floor": "asphalt", "in_replay": {"day": 2, "dirt": 0.8}}, "replay"),
    ("asphalt, leaves", {"floor": "asphalt", "in_replay": {"day": 2, "leaves_per_m2": 60}}, "replay"),
    ("asphalt, half wet", {"floor": "asphalt", "in_replay": {"day": 2, "wet": 0.5}}, "replay"),
    ("wood, covered", {"covered": [{"from_m": 1.02, "to_m": 1.6, "floor": "carpet", "floor_yaw_deg": 20}]}, "replay"),
)


def take(shot: Shot) -> Picture:
    """Return the picture of a shot."""
    options = WorldOptions(
        seed=7, sensors=(shot.sensor,), route=shot.route, threads=2, extra=shot.options, mode=shot.mode
    )
    world = build_world(shot.world, options)
    if isinstance(shot.at, float):
        pose = next(iter(world.routes.values())).pose_at(shot.at)
    else:
        pose = Pose2(shot.at[0], shot.at[1], math.radians(shot.at[2]))
    state = VehicleState(pose, shot.twist, travelled_m=pose.x)
    return np.asarray(picture_of(world.sensors[0].render(1, shot.stamp_s, state)), np.uint8)


def floors() -> Picture:
    """Return all floors, and below them what another day does to them."""
    tiles: list[Day] = [(name, {"floor": name}, "teach") for name in sorted(FLOORS)]
    cells = []
    for title, options, mode in (*tiles, *DAYS):
        picture = take(Shot("ground_course", "floor", 1.0, options=options, mode=mode))
        small = cv2.resize(picture, (308, 288), interpolation=cv2.INTER_AREA)
        cv2.rectangle(small, (0, 0), (12 + 9 * len(title), 22), 0, -1)
        cv2.putText(small, title, (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.5, 255, 1, cv2.LINE_AA)
        cells.append(small)
    return np.vstack([np.hstack(cells[row : row + 4]) for row in range(0, len(cells), 4)])


def write(path: Path, picture: Picture) -> None:
    """Write a picture as JPEG."""
    if not cv2.imwrite(str(path), picture, [cv2.IMWRITE_JPEG_QUALITY, 85]):
        raise SystemExit(f"cannot write {path}")
    print(path)


def main() -> None:
    """Render and write."""
    here = Path(__file__).parents[1]
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=here / "docs" / "assets" / "sim", help="folder to write to")
    parser.add_argument("--only", choices=[*SHOTS, "ground"], help="this one only")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for name, shot in SHOTS.items():
        if given.only in (None, name):
            write(given.out / f"{name}.jpg", take(shot))
    if given.only in (None, "ground"):
        write(given.out / "ground.jpg", floors())


if __name__ == "__main__":
    main()
