"""Where the vehicle is put down."""

from __future__ import annotations

import math
from dataclasses import dataclass

from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark_sim.config import SimConfig
from trailmark_sim.routes import Route
from trailmark_sim.worlds.base import World

__all__ = ["Place", "place_vehicle"]


@dataclass(frozen=True, slots=True)
class Place:
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


def place_vehicle(config: SimConfig, session: Session, world: World, route: Route) -> Place:
    """Return where the vehicle stands.

    In replay the run says where on the taught path it believes to start. The taught poses have drifted from the
    truth, so that not the pose counts but the place on the path: as far along the route, and as far beside it.
    """
    if config.start is not None:
        x, y, theta_deg = config.start
        pose = Pose2(x, y, math.radians(theta_deg))
    elif session.mode == "replay":
        pose = _on_route(session, route)
    else:
        pose = world.start if config.driver == "commands" and config.route is None else route.start
    if session.mode == "replay":
        forward_m, left_m, turn_deg = config.put_off
        pose = pose @ Pose2(forward_m, left_m, math.radians(turn_deg))
    return Place(pose, route.path.locate(pose).station_m)


def _on_route(session: Session, route: Route) -> Pose2:
    path, believed = session.path, session.start_pose
    if path is None or believed is None or path.length_m == 0.0:
        return route.start
    on_path = path.locate(believed)
    share = (on_path.station_m - path[0].station_m) / path.length_m
    taught = route.pose_at(share * route.length_m)
    return taught @ Pose2(0.0, on_path.lateral_m, on_path.heading_rad)
