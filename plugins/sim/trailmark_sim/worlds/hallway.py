"""A bare hallway of 14 x 3 m with a few coloured things, posters, glass and steel.

The "less structured environment" of Toth et al. 2015, for a colour and depth camera.
"""

from __future__ import annotations

import math
from functools import lru_cache, partial

import numpy as np

from trailmark.geometry import Pose2
from trailmark_sim.actors import Crowd, Walk, add_cloth
from trailmark_sim.props import Movers
from trailmark_sim.render import lettering, textures
from trailmark_sim.render.bake import Lighting
from trailmark_sim.render.scene import Scene, SceneBuilder, Surface
from trailmark_sim.rng import frame_rng
from trailmark_sim.routes import Route
from trailmark_sim.worlds.base import World, WorldOptions, parse_options
from trailmark_sim.worlds.crate import with_crate
from trailmark_sim.worlds.furnishing import (
    RoomExtent,
    Thing,
    add_room,
    block_things,
    hang,
    lamp_panels,
    show_lamps,
    show_things,
)
from trailmark_sim.worlds.rgbd_rig import SENSORS, rgbd_world
from trailmark_sim.worlds.scene_options import HallwayOptions
from trailmark_sim.worlds.setting import Setting
from trailmark_sim.worlds.solids import Solids

__all__ = ["ROUTES", "SENSORS", "build"]

ROUTES = ("straight",)

_ROOM = RoomExtent(-1.0, 13.0, -1.5, 1.5, 2.8)
_SPEED_MPS = 0.3
#: What stands on the floor.
_THINGS = (
    Thing("box", 3.2, 1.15, 0.45, (0.70, 0.06, 0.05)),
    Thing("cylinder", 5.0, -1.15, 0.16, (0.05, 0.35, 0.10)),
    Thing("ball", 7.2, 1.1, 0.24, (0.85, 0.45, 0.03)),
    Thing("box", 9.2, -1.15, 0.40, (0.05, 0.12, 0.60)),
    Thing("cylinder", 11.2, 1.1, 0.18, (0.80, 0.70, 0.05)),
)


def build(options: WorldOptions) -> World:
    """Build the hallway."""
    given = parse_options(HallwayOptions, "hallway", options.extra)
    solids = Solids(_ROOM.west, _ROOM.east, _ROOM.south, _ROOM.north)
    block_things(solids, _THINGS)
    x_m = np.arange(0.0, 10.0 + 1e-9, 0.01)
    route = np.stack([x_m, np.zeros_like(x_m), np.zeros_like(x_m)], axis=1)
    setting = Setting(
        name="hallway",
        build_scene=partial(_stage, given.scenery(), options.world_seed, options.threads),
        movers=_movers(given, options.seed),
        solids=solids,
        routes={"straight": Route.from_poses(route, _SPEED_MPS, "10 m along the hallway")},
        level_lux=partial(_light_lux, given.light_level),
    )
    return rgbd_world(setting, options, given)


def _movers(given: HallwayOptions, seed: int) -> Movers:
    rng = frame_rng(seed, "walks")
    walks = []
    for left_m in (0.5, -0.5, 0.2, -0.2)[: given.people]:
        way = ((0.0, left_m), (12.0, left_m * 0.9))
        walks.append(Walk(way, float(rng.uniform(0.7, 1.4)), float(rng.uniform(0.0, 24.0))))
    return with_crate(given, Crowd(walks, seed), 3.0, -1.0, 0.0, 6.0)


def _light_lux(level: float, pose: Pose2, stamp_s: float) -> float:
    return 300.0 * level * (1.0 + 0.2 * math.cos(2.0 * math.pi * pose.x / 3.0))


@lru_cache(maxsize=2)
def _stage(given: HallwayOptions, world_seed: int, threads: int) -> Scene:
    rng = frame_rng(world_seed, "hallway")
    level = given.light_level
    lamps = lamp_panels((0.5, 3.5, 6.5, 9.5, 12.0), (0.0,), _ROOM.height_m, (1.2, 0.3), 3.0 * level)
    builder = SceneBuilder(Lighting(lamps, (0.20 * level, 0.20 * level, 0.19 * level)))
    _add_walls(builder, rng)
    show_lamps(builder, lamps, 6.0 * level)
    show_things(builder, rng, _THINGS, 1.0)
    builder.cylinder(12.6, -1.1, 0.0, 0.22, 0.9, Surface(tint=(0.55, 0.56, 0.58), shine=0.6))
    add_cloth(builder)
    return builder.build(threads)


def _add_walls(builder: SceneBuilder, rng: np.random.Generator) -> None:
    paint = builder.texture(textures.plaster(rng, (212, 208, 196), 1024, 0.025))
    brick = builder.texture(textures.bricks(rng, (176, 128, 104), 512, 16, 8, 0.10))
    floor = builder.texture(textures.speckle(rng, (104, 94, 82), 512, 0.18, joints=4))
    ceiling = builder.texture(textures.panels(rng, (212, 212, 206)))
    walls = {"south": (paint, 2.8), "north": (brick, 1.4), "west": (paint, 2.8), "east": (paint, 2.8)}
    add_room(builder, _ROOM, (floor, 1.6), (ceiling, 2.4), walls)
    for x in (2.0, 6.0, 10.4):
        look = Surface(builder.texture(textures.door(rng, (120, 132, 142))))
        hang(builder, _ROOM, "south", _ROOM.east - x - 0.95, 0.0, (0.95, 2.1), look)
    for side, along_m in (
        ("south", 4.4),
        ("south", 8.6),
        ("north", 3.0),
        ("north", 6.4),
        ("north", 10.0),
        ("east", 1.0),
    ):
        size_m = float(rng.uniform(0.6, 0.9))
        hang(builder, _ROOM, side, along_m, 1.1, (size_m, size_m), Surface(builder.texture(lettering.poster(rng))))
    for along_m in (3.3, 7.2, 11.6):
        size_m = float(rng.uniform(0.4, 0.6))
        look = Surface(builder.texture(lettering.notice(rng)))
        hang(builder, _ROOM, "south", along_m, 1.2, (size_m, size_m), look)
    glass = Surface(builder.texture(textures.window(rng, 256, 2)), tint=(0.3, 0.35, 0.4), shine=0.4)
    hang(builder, _ROOM, "north", 8.0, 0.2, (1.4, 2.0), glass)
    base = Surface(builder.texture(textures.boards(rng, (92, 74, 58), 64, 1)), (12.0, 1.0))
    hang(builder, _ROOM, "south", 0.0, 0.0, (14.0, 0.1), base, layer=1)
