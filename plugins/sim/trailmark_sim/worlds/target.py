"""A room in which a board is moved before a colour and depth camera, to calibrate one to the other.

After the calibration of Toth et al. 2015; the robot all but stands.
"""

from __future__ import annotations

import math
from functools import lru_cache, partial

import numpy as np

from trailmark.geometry import Pose3
from trailmark_sim.props import Prop, Props
from trailmark_sim.render import lettering, textures
from trailmark_sim.render.bake import Lighting
from trailmark_sim.render.scene import Scene, SceneBuilder, Surface
from trailmark_sim.rng import frame_rng
from trailmark_sim.routes import Route
from trailmark_sim.worlds.base import World, WorldOptions, parse_options
from trailmark_sim.worlds.furnishing import RoomExtent, add_room, hang, lamp_panels, show_lamps
from trailmark_sim.worlds.rgbd_rig import SENSORS, rgbd_world
from trailmark_sim.worlds.scene_options import LabOptions
from trailmark_sim.worlds.setting import Setting
from trailmark_sim.worlds.solids import Solids

__all__ = ["BOARD_M", "ROUTES", "SENSORS", "build"]

ROUTES = ("creep",)

#: Width and height of the board [m].
BOARD_M = (0.60, 0.45)

_ROOM = RoomExtent(-1.0, 4.5, -2.5, 2.5, 2.6)
#: The camera, as `RgbdRig` mounts it.
_EYE_M = (0.2, 0.6)


def build(options: WorldOptions) -> World:
    """Build the room."""
    given = parse_options(LabOptions, "target", options.extra)
    props = Props([Prop((0.01, *BOARD_M), _board_at, _white)])
    way = np.stack([np.linspace(0.0, 0.05, 6), np.zeros(6), np.zeros(6)], axis=1)
    setting = Setting(
        name="target",
        build_scene=partial(_scene, given.scenery(), options.world_seed, options.threads),
        movers=props,
        solids=Solids(_ROOM.west, _ROOM.east, _ROOM.south, _ROOM.north),
        routes={"creep": Route.from_poses(way, 0.001, "5 cm in 50 s, while the board is moved")},
        level_lux=lambda pose, stamp_s: 350.0,
    )
    return rgbd_world(setting, options, given)


def _board_at(stamp_s: float) -> Pose3:
    """Return where the board is: to all sides of the picture, near and far, turned and tilted."""
    ahead_m = 1.45 + 0.45 * math.sin(0.73 * stamp_s)
    left_m = ahead_m * 0.35 * math.sin(1.31 * stamp_s + 0.4)
    up_m = ahead_m * 0.24 * math.sin(2.17 * stamp_s + 1.1)
    yaw, pitch = 0.55 * math.sin(1.77 * stamp_s), 0.45 * math.sin(2.71 * stamp_s + 0.7)
    return Pose3(_EYE_M[0] + ahead_m, left_m, _EYE_M[1] + up_m, pitch=pitch, yaw=math.pi + yaw)


def _white(builder: SceneBuilder) -> tuple[Surface, Surface]:
    card = builder.texture(textures.plaster(frame_rng(0, "board"), (240, 240, 236), 128, 0.01))
    return Surface(card), Surface(card)


@lru_cache(maxsize=1)
def _scene(given: LabOptions, world_seed: int, threads: int) -> Scene:
    rng = frame_rng(world_seed, "target")
    lamps = lamp_panels((0.5, 2.5), (-1.0, 1.0), _ROOM.height_m, (1.2, 0.3), 3.0 * given.light_level)
    builder = SceneBuilder(Lighting(lamps, tuple(0.2 * given.light_level for _ in range(3))))  # type: ignore[arg-type]
    paint = builder.texture(textures.plaster(rng, (92, 104, 112), 512, 0.03))
    floor = builder.texture(textures.speckle(rng, (96, 92, 88), 512, 0.2, joints=4))
    ceiling = builder.texture(textures.panels(rng, (190, 190, 186)))
    add_room(
        builder, _ROOM, (floor, 1.6), (ceiling, 2.4), dict.fromkeys(("south", "north", "west", "east"), (paint, 2.6))
    )
    show_lamps(builder, lamps, 6.0 * given.light_level)
    for along_m in (0.6, 2.9):
        look = Surface(builder.texture(lettering.poster(rng)))
        hang(builder, _ROOM, "east", along_m, 0.9, (0.7, 0.7), look)
    Props([Prop((0.01, *BOARD_M), _board_at, _white)]).add_to(builder)
    return builder.build(threads)
