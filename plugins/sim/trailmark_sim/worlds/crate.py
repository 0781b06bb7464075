"""A crate beside the route that is carried away, or covered, while the robot looks at it."""

from __future__ import annotations

import math

from trailmark.geometry import Pose3
from trailmark_sim.actors import Crowd
from trailmark_sim.props import Movers, Prop, Props, rises, walks_off
from trailmark_sim.render import textures
from trailmark_sim.render.scene import SceneBuilder, Surface
from trailmark_sim.rng import frame_rng
from trailmark_sim.worlds.scene_options import HallwayOptions, LabOptions

__all__ = ["with_crate"]

_SIZE_M = (0.5, 0.5, 0.7)
_SPEED_MPS = 0.5


def with_crate(
    given: LabOptions | HallwayOptions, people: Crowd, x: float, y: float, away_rad: float, way_m: float
) -> Movers:
    """Return who and what moves: people, and the crate of the options at a place; nothing stands in its way there.

    Parameters
    ----------
    x, y : float
        Where the crate stands [m].
    away_rad, way_m : float
        Where to it is carried, and how far [rad, m].
    """
    if given.crate == "none":
        return people
    stands = Pose3(x, y, _SIZE_M[2] / 2.0, yaw=math.pi)  # its front towards the robot
    is_carried = given.crate == "walks_off"
    at = walks_off(stands, given.crate_s if is_carried else math.inf, away_rad, _SPEED_MPS, way_m)
    props = [Prop(_SIZE_M, at, _print)]
    if given.crate == "covered":
        cloth = Pose3(x - _SIZE_M[0] / 2.0 - 0.08, y, _SIZE_M[2] / 2.0 + 0.05, yaw=math.pi)
        props.append(Prop((0.02, 0.8, 0.8), rises(cloth, given.crate_s, 0.9), _cloth))
    return Props(props, people)


def _print(builder: SceneBuilder) -> tuple[Surface, Surface]:
    rng = frame_rng(0, "crate")
    front, others = (Surface(builder.texture(textures.products(rng, 256, 256, 5))) for _ in range(2))
    return front, others


def _cloth(builder: SceneBuilder) -> tuple[Surface, Surface]:
    cloth = Surface(builder.texture(textures.plaster(frame_rng(0, "cover"), (120, 116, 110), 128, 0.03)))
    return cloth, cloth
