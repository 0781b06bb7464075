"""omni_surf on unwrapped panoramas beside the circular pictures that they were made of, in simulated supermarkets.

    python benchmarks/omni_panorama.py [--places 3]

Each place (1, 2, ...) is taught along 6 m of the route `wall` with exact poses, a picture every 5 cm; then driven again
5 cm and 3 deg beside it with other noise, not told where, with exact odometry. The panoramas are 720 x 168 px.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np

from trailmark.arrays import Floats, Grey8
from trailmark.estimates import Belief, Fix
from trailmark.frames import Frame, Image, Omni, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.testing import MemoryMap
from trailmark_omni_surf.config import OmniSurfConfig
from trailmark_omni_surf.localizer import OmniSurf
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds import build_world
from trailmark_sim.worlds.base import WorldOptions

_SIZE = (720, 168)
_LENGTH_M, _STEP_M = 6.0, 0.05
_ASIDE = Pose2(0.0, 0.05, math.radians(3.0))
Change = Callable[[Grey8], Grey8]


def unwrapping(calibration: Omni) -> Change:
    """Return what unwraps the circular pictures of a camera: forward in the middle, left to the left."""
    assert calibration.centre_u is not None
    assert calibration.centre_v is not None
    inner, outer = calibration.radius_inner_px, calibration.radius_outer_px
    assert inner is not None
    assert outer is not None
    v, u = np.mgrid[0 : _SIZE[1], 0 : _SIZE[0]].astype(np.float64)
    bearing = math.pi - (u + 0.5) / _SIZE[0] * 2.0 * math.pi
    sign = -1.0 if calibration.turns == "counterclockwise" else 1.0
    direction = math.radians(calibration.forward_deg) + sign * bearing
    distance = outer - 2.0 - (v + 0.5) / _SIZE[1] * (outer - inner - 4.0)
    map_u = (calibration.centre_u + distance * np.cos(direction)).astype(np.float32)
    map_v = (calibration.centre_v + distance * np.sin(direction)).astype(np.float32)
    return lambda picture: np.asarray(cv2.remap(picture, map_u, map_v, cv2.INTER_LINEAR), np.uint8)


def pictures(place: int, seed: int, poses: list[Pose2]) -> tuple[SensorInfo, list[Grey8]]:
    """Return what the camera of a supermarket sees from poses."""
    world = build_world("supermarket", WorldOptions(seed=seed, world_seed=place, sensors=("omni",), threads=1))
    sensor = world.sensors[0]
    seen = [sensor.render(k, k / 15.0, VehicleState(pose)) for k, pose in enumerate(poses)]
    return sensor.info, [_grey(payload) for payload in seen]


def _grey(payload: Any) -> Grey8:
    assert isinstance(payload, Image)
    pixels = payload.pixels
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY) if pixels.ndim == 3 else pixels, np.uint8)


def route_poses(place: int) -> list[Pose2]:
    """Return the taught poses."""
    world = build_world("supermarket", WorldOptions(world_seed=place, sensors=("omni",), route="wall"))
    return [world.routes["wall"].pose_at(s) for s in np.arange(0.0, _LENGTH_M, _STEP_M).tolist()]


def errors(info: SensorInfo, taught: Any, seen: Any, *, unwrapped: bool) -> Floats:
    """Return how far every answer is off and its NEES of one degree of freedom, NaN where there was none, (N, 3)."""
    config, localizer_map = OmniSurfConfig(camera="omni", unwrapped=unwrapped), MemoryMap()
    localizer = OmniSurf(config)
    localizer.start(Session(name="omni", mode="teach", sensors={"omni": info}, map=localizer_map))
    for k, (pose, picture) in enumerate(zip(*taught, strict=True)):
        belief = Belief(k / 15.0, pose, pose_odom_base=pose, travelled_m=_STEP_M * k)
        localizer.observe(Frame("omni", k / 15.0, Image(picture)), belief)
    localizer.finish()
    localizer = OmniSurf(config)
    localizer.start(Session(name="omni", mode="replay", sensors={"omni": info}, map=localizer_map))
    return np.array(list(_off(localizer, *seen)))


def _off(localizer: OmniSurf, poses: list[Pose2], seen: list[Grey8]) -> Iterator[tuple[float, float, float]]:
    for k, (pose, picture) in enumerate(zip(poses, seen, strict=True)):
        belief = Belief(k / 15.0, pose_odom_base=poses[0].between(pose), travelled_m=_STEP_M * k)
        (answer,) = localizer.observe(Frame("omni", k / 15.0, Image(picture)), belief)
        if isinstance(answer, Fix):
            told = answer.pose_map_base
            error = np.array([told.x - pose.x, told.y - pose.y, pose.between(told).theta])
            nees = float(error @ answer.information @ error) / 3.0
            yield math.hypot(*error[:2]), abs(math.degrees(error[2])), nees
        else:
            yield math.nan, math.nan, math.nan


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--places", type=int, default=3)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    print("| supermarket | picture | n | answered | median [mm] | mean [mm] | largest [mm] | median [deg] | NEES |")
    print("|---|---|--:|--:|--:|--:|--:|--:|--:|")
    found: dict[str, list[Floats]] = {"circular": [], "unwrapped": []}
    for place in range(1, options.places + 1):
        poses = route_poses(place)
        again = [pose @ _ASIDE for pose in poses]
        (info, first), (_, second) = pictures(place, 1, poses), pictures(place, 2, again)
        found["circular"].append(errors(info, (poses, first), (again, second), unwrapped=False))
        assert isinstance(info.calibration, Omni)
        change = unwrapping(info.calibration)
        plain = SensorInfo("omni", "image", _SIZE, info.rate_hz, info.pose_base_sensor)
        taught, seen = (poses, list(map(change, first))), (again, list(map(change, second)))
        found["unwrapped"].append(errors(plain, taught, seen, unwrapped=True))
        for name, runs in found.items():
            print(_row(f"{place} | {name}", runs[-1]), flush=True)
    for name, runs in found.items():
        print(_row(f"all | {name}", np.concatenate(runs)))


def _row(name: str, off: Floats) -> str:
    is_told = ~np.isnan(off[:, 0])
    off_m, off_deg, nees = off[is_told].T
    cells = (
        f"{len(off)}",
        f"{100.0 * is_told.mean():.1f} %",
        f"{1e3 * np.median(off_m):.1f}",
        f"{1e3 * off_m.mean():.1f}",
        f"{1e3 * off_m.max():.0f}",
        f"{np.median(off_deg):.2f}",
        f"{nees.mean():.2f}",
    )
    return f"| {name} | {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
