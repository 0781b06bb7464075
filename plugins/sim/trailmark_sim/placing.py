"""Where the vehicle is put down."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.errors import ConfigError
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark_sim.config import SimConfig
from trailmark_sim.rng import frame_rng
from trailmark_sim.routes import Route
from trailmark_sim.worlds.base import World

__all__ = ["VehicleStart", "place_vehicle"]

#: A random start is so far from everything, and in a world without walls so far beside its route at most [m].
_MARGIN_M, _BESIDE_M = 0.1, 0.5
_TRIES = 1000
#: By what share the length of a taught path may be wrong.
_WRONGLY_MEASURED = 0.15


@dataclass(frozen=True, slots=True)
class VehicleStart:
    """Where the vehicle stands at the beginning.

    Attributes
    ----------
    pose : Pose2
        In the map of the world: the truth.
    station_m : float
        Where on the route that is [m].
    """

    pose: Pose2
    station_m: float


def place_vehicle(config: SimConfig, session: Session, world: World, route: Route, seed: int = 0) -> VehicleStart:
    """Return where the vehicle stands; `seed` says where that is for ``start: random``.

    In replay the run says where on the taught path it believes to start. The taught poses have drifted from the
    truth, so that not the pose counts but the place on the path: as far along the route, and as far beside it.

    Raises
    ------
    ConfigError
        If no free place is found for ``start: random``.
    """
    if config.start == "random":
        pose = _anywhere(world, route, seed)
    elif config.start is not None:
        x, y, theta_deg = config.start
        pose = Pose2(x, y, math.radians(theta_deg))
    elif session.mode == "replay":
        pose = _on_route(session, route)
    else:
        pose = world.start if config.driver == "commands" and config.route is None else route.start
    if session.mode == "replay":
        forward_m, left_m, turn_deg = config.put_off
        pose = pose @ Pose2(forward_m, left_m, math.radians(turn_deg))
    return VehicleStart(pose, route.path.locate(pose).station_m)


def _on_route(session: Session, route: Route) -> Pose2:
    path, believed = session.path, session.start_pose
    if path is None or believed is None or path.length_m == 0.0:
        return route.start
    on_path = path.locate(believed)
    # A taught path of about the route's length is the whole route, measured wrongly; a shorter one is a part of it.
    stretched = route.length_m / path.length_m
    scale = stretched if abs(stretched - 1.0) < _WRONGLY_MEASURED else 1.0
    taught = route.pose_at((on_path.station_m - path[0].station_m) * scale)
    return taught @ Pose2(0.0, on_path.lateral_m, on_path.heading_rad)


def _anywhere(world: World, route: Route, seed: int) -> Pose2:
    """Return a pose at which nothing is touched, not even `_MARGIN_M` further on to any side."""
    west, east, south, north = world.area or _around(route)
    rng = frame_rng(seed, "start")
    around = [Pose2(_MARGIN_M * math.cos(a), _MARGIN_M * math.sin(a)) for a in np.arange(8) * math.pi / 4.0]
    for _ in range(_TRIES):
        pose = Pose2(rng.uniform(west, east), rng.uniform(south, north), rng.uniform(-math.pi, math.pi))
        if all(world.collides(pose @ aside) is None for aside in (Pose2(), *around)):
            return pose
    raise ConfigError(f"sim: no free place found in world {world.name!r} for start: random; give x, y and heading")


def _around(route: Route) -> tuple[float, float, float, float]:
    xy = route.path.positions
    (west, south), (east, north) = xy.min(axis=0) - _BESIDE_M, xy.max(axis=0) + _BESIDE_M
    return float(west), float(east), float(south), float(north)
