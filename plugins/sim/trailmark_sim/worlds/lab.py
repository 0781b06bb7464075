"""A laboratory of 8 x 6 m full of things: coloured boxes, cylinders and balls, posters, shiny objects.

The "more structured environment" of Toth et al. 2015, for a colour and depth camera.
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
from trailmark_sim.worlds.scene_options import LabOptions
from trailmark_sim.worlds.setting import Setting
from trailmark_sim.worlds.solids import Solids

__all__ = ["ROUTES", "SENSORS", "build"]

ROUTES = ("straight", "loop")

_ROOM = RoomExtent(0.0, 8.0, 0.0, 6.0, 2.8)
_SPEED_MPS = 0.2
#: Middle, length, width, height [m], heading [rad].
_TABLES = (
    (4.0, 5.55, 6.0, 0.8, 0.75, 0.0),
    (7.55, 3.2, 0.8, 3.0, 0.75, 0.0),
    (3.2, 0.4, 3.0, 0.7, 0.75, 0.0),
)
#: What stands on the floor.
_THINGS = (
    Thing("box", 6.3, 1.1, 0.45, (0.75, 0.06, 0.05)),
    Thing("cylinder", 6.6, 2.1, 0.16, (0.05, 0.45, 0.10)),
    Thing("ball", 5.9, 4.6, 0.22, (0.85, 0.45, 0.03)),
    Thing("box", 6.4, 4.3, 0.35, (0.05, 0.12, 0.60)),
    Thing("cylinder", 4.4, 4.85, 0.14, (0.80, 0.70, 0.05)),
    Thing("ball", 5.1, 1.0, 0.16, (0.55, 0.05, 0.45)),
    Thing("box", 2.2, 4.75, 0.40, (0.05, 0.50, 0.50)),
    Thing("cylinder", 0.5, 4.6, 0.18, (0.70, 0.20, 0.05)),
)
_WALKS = (
    ((1.2, 3.9), (5.6, 3.9)),
    ((5.4, 1.6), (5.4, 4.0)),
    ((1.0, 1.3), (4.6, 1.3)),
    ((6.0, 2.9), (2.0, 2.9)),
)


def build(options: WorldOptions) -> World:
    """Build the laboratory."""
    given = parse_options(LabOptions, "lab", options.extra)
    solids = Solids(_ROOM.west, _ROOM.east, _ROOM.south, _ROOM.north)
    for x, y, length, width, _, yaw in _TABLES:
        solids.box("a table", x, y, length, width, yaw)
    block_things(solids, _THINGS)
    setting = Setting(
        name="lab",
        build_scene=partial(_stage, given.scenery(), options.world_seed, options.threads),
        movers=_movers(given, options.seed),
        solids=solids,
        routes=_routes(),
        level_lux=partial(_light_lux, given.light_level),
    )
    return rgbd_world(setting, options, given)


def _movers(given: LabOptions, seed: int) -> Movers:
    rng = frame_rng(seed, "walks")
    walks = [Walk(way, float(rng.uniform(0.4, 1.0)), float(rng.uniform(0, 8))) for way in _WALKS[: given.people]]
    return with_crate(given, Crowd(walks, seed), 3.5, 3.5, math.pi / 2, 1.2)


def _routes() -> dict[str, Route]:
    x = np.arange(0.8, 4.8 + 1e-9, 0.01)
    ahead = np.stack([x, np.full_like(x, 2.6), np.zeros_like(x)], axis=1)
    angle = np.linspace(-math.pi / 2, 1.5 * math.pi, 700)
    circle = np.stack([3.3 + 1.5 * np.cos(angle), 2.8 + 1.1 * np.sin(angle)], axis=1)
    return {
        "straight": Route.from_poses(ahead, _SPEED_MPS, "4 m towards the middle of the things"),
        "loop": Route.through(circle, _SPEED_MPS, "once around the room"),
    }


def _light_lux(level: float, pose: Pose2, stamp_s: float) -> float:
    return 420.0 * level * (1.0 + 0.12 * math.cos(2.0 * math.pi * pose.x / 2.6))


@lru_cache(maxsize=2)
def _stage(given: LabOptions, world_seed: int, threads: int) -> Scene:
    rng = frame_rng(world_seed, "lab")
    level = given.light_level
    lamps = lamp_panels((1.6, 4.0, 6.4), (1.6, 4.4), _ROOM.height_m, (1.2, 0.3), 3.0 * level)
    builder = SceneBuilder(Lighting(lamps, (0.22 * level, 0.22 * level, 0.21 * level), texel_m=0.15))
    _add_walls(builder, rng)
    show_lamps(builder, lamps, 6.0 * level)
    for table in _TABLES:
        _add_table(builder, rng, table)
    show_things(builder, rng, _THINGS, 0.9)
    _add_clutter(builder, rng)
    add_cloth(builder)
    return builder.build(threads)


def _add_walls(builder: SceneBuilder, rng: np.random.Generator) -> None:
    paint = builder.texture(textures.plaster(rng, (214, 212, 204), 1024, 0.02))
    floor = builder.texture(textures.speckle(rng, (104, 110, 118), 512, 0.22, joints=2))
    ceiling = builder.texture(textures.panels(rng, (215, 215, 210)))
    walls = dict.fromkeys(("south", "north", "west", "east"), (paint, 2.8))
    add_room(builder, _ROOM, (floor, 1.2), (ceiling, 2.4), walls)
    places = [("east", a) for a in (0.4, 1.6, 3.5, 4.8)] + [("north", a) for a in (0.5, 2.0, 3.6, 5.6)]
    places += [("south", a) for a in (0.6, 2.2, 6.3)] + [("west", a) for a in (0.8, 4.6)]
    for side, along_m in places:
        size_m = float(rng.uniform(0.55, 1.0))
        picture = lettering.poster(rng) if rng.random() < 0.6 else lettering.notice(rng)
        look = Surface(builder.texture(picture))
        hang(builder, _ROOM, side, along_m, float(rng.uniform(1.1, 1.5)), (size_m, size_m), look)
    hang(builder, _ROOM, "west", 2.4, 0.0, (0.95, 2.1), Surface(builder.texture(textures.door(rng, (150, 112, 78)))))
    mirror = Surface(tint=(0.25, 0.27, 0.3), shine=0.6)
    hang(builder, _ROOM, "east", 2.6, 0.9, (0.7, 1.2), mirror)


def _add_table(
    builder: SceneBuilder, rng: np.random.Generator, table: tuple[float, float, float, float, float, float]
) -> None:
    x, y, length, width, height, yaw = table
    wood = Surface(builder.texture(textures.boards(rng, (176, 140, 96), 256, 2)), (3.0, 1.0))
    body = Surface(builder.texture(textures.products(rng, 1024, 128, 20)))
    builder.box((x, y, 0.0), (length, width, height), body, yaw, top=wood)
    along = max(length, width)
    for place in np.arange(-along / 2.0 + 0.3, along / 2.0 - 0.25, 0.42):
        dx, dy = (place, 0.0) if length > width else (0.0, place)
        _add_thing_on_table(builder, rng, x + dx, y + dy, height)


def _add_thing_on_table(builder: SceneBuilder, rng: np.random.Generator, x: float, y: float, z: float) -> None:
    kind = int(rng.integers(5))
    r, g, b = rng.uniform(0.03, 0.7, 3).tolist()
    yaw = float(rng.uniform(0.0, 2.0 * math.pi))
    if kind <= 1:
        picture = Surface(builder.texture(textures.products(rng, 128, 128, 3)))
        size = (float(rng.uniform(0.15, 0.35)), float(rng.uniform(0.15, 0.3)), float(rng.uniform(0.15, 0.45)))
        builder.box((x, y, z), size, picture, yaw)
    elif kind == 2:
        screen = Surface(builder.texture(lettering.notice(rng)), emission=0.3, shine=0.25, blocks_light=False)
        away = math.atan2(3.0 - y, 4.0 - x)
        dark = Surface(tint=(0.03, 0.03, 0.035))
        builder.box((x, y, z + 0.08), (0.05, 0.55, 0.36), dark, away, front=screen)
    elif kind == 3:
        builder.cylinder(x, y, z, 0.07, float(rng.uniform(0.15, 0.35)), Surface(tint=(r, g, b), shine=0.3))
    else:
        builder.ellipsoid((x, y, z + 0.12), (0.12, 0.12, 0.12), Surface(tint=(r, g, b)))


def _add_clutter(builder: SceneBuilder, rng: np.random.Generator) -> None:
    steel = Surface(tint=(0.55, 0.56, 0.58), shine=0.6)
    builder.cylinder(7.0, 0.5, 0.0, 0.22, 1.3, steel)
    builder.ellipsoid((5.0, 5.5, 1.0), (0.2, 0.2, 0.22), steel)
    books = [Surface(builder.texture(textures.products(rng, 512, 128, 24))) for _ in range(3)]
    for shelf, surface in enumerate(books):
        hang(builder, _ROOM, "south", 4.6, 0.3 + 0.45 * shelf, (1.4, 0.36), surface)
    for x in (2.9, 5.3):
        builder.box((x, 5.2 - 0.35, 0.0), (0.42, 0.42, 0.48), Surface(tint=(0.08, 0.09, 0.12)), 0.4)
