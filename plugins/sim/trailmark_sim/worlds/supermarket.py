"""A supermarket of 10 x 10 m: shelves of equal shape with different goods and signs, a refrigerator, a checkout.

After the mock supermarket of Tasaki et al., Sec. IV: a holonomic robot 0.65 m wide, an omnidirectional camera 1.2 m
high at 15 Hz and a laser. The wall at x = 0 is white and bare. One robot may carry every kind of sensor here: also a
ground camera, a camera that looks forward, colour and depth.
"""

from __future__ import annotations

import math
from functools import lru_cache, partial

import numpy as np

from trailmark.frames import Pinhole
from trailmark.geometry import Pose2, Pose3
from trailmark_sim.actors import Crowd, Walk, add_cloth
from trailmark_sim.render import lettering, textures
from trailmark_sim.render.bake import Lighting
from trailmark_sim.render.lenses import Catadioptric, PinholeLens
from trailmark_sim.render.scene import Scene, SceneBuilder, Surface
from trailmark_sim.rng import frame_rng
from trailmark_sim.routes import Route
from trailmark_sim.sensors.camera import CameraRig
from trailmark_sim.sensors.floor import camera_over
from trailmark_sim.sensors.laser import LaserRig
from trailmark_sim.sensors.rgbd import RgbdRig
from trailmark_sim.vehicles import Holonomic
from trailmark_sim.worlds.base import World, WorldOptions, parse_options
from trailmark_sim.worlds.furnishing import (
    RoomExtent,
    add_room,
    hang,
    lamp_panels,
    show_lamps,
)
from trailmark_sim.worlds.scene_options import SupermarketOptions
from trailmark_sim.worlds.setting import Setting, imaging_of
from trailmark_sim.worlds.solids import Solids

__all__ = ["ROUTES", "SENSORS", "build"]

SENSORS = ("floor", "laser", "front_depth", "front", "rgbd", "omni")
ROUTES = ("wall", "round", "goal")

_ROOM = RoomExtent(0.0, 10.0, 0.0, 10.0, 3.0)
_SPEED_MPS = 0.4
_CAMERA_M = 1.2
_FRONT = PinholeLens(640, 480, Pinhole(525.0, 525.0, 319.5, 239.5))
_FRONT_MOUNTING = Pose3(x=0.30, z=0.60)
#: Middle, length, depth and height of the shelves, all alike [m].
_SHELVES = tuple((x, y) for y in (4.6, 6.6, 8.6) for x in (3.2, 7.0))
_SHELF_M = (2.4, 0.8, 1.8)
_BOARDS = 4
#: Middle, length and depth [m].
_FRIDGE = (7.4, 0.4, 2.8, 0.8)
_CHECKOUT = (9.35, 2.6, 0.8, 1.0)
#: What polished stone mirrors where it is met squarely, and the four faces of two panes.
_POLISHED_FLOOR, _GLASS = 0.05, 0.15
#: Middle and radius [m].
_POLES = ((0.35, 9.65, 0.15), (9.6, 6.6, 0.15))
_GOODS = ("CEREALS", "COFFEE", "PASTA", "SOAP", "WINE", "SNACKS")
_SIGN_COLOURS = ((25, 70, 150), (140, 35, 30), (30, 110, 60), (200, 130, 20), (100, 40, 110), (20, 120, 130))
_WALKS = (
    ((1.0, 5.6), (9.0, 5.6)),
    ((5.1, 3.6), (5.1, 9.5)),
    ((1.2, 3.3), (8.0, 3.3), (8.0, 1.4), (1.2, 1.4)),
    ((1.0, 7.6), (9.0, 7.6)),
    ((1.1, 3.8), (1.1, 9.3), (4.9, 9.3), (4.9, 3.8)),
    ((8.9, 4.2), (8.9, 9.4)),
    ((5.4, 7.7), (8.8, 7.7), (8.8, 5.5), (5.4, 5.5)),
    ((1.4, 5.4), (4.8, 5.4), (4.8, 7.4), (1.4, 7.4)),
)


def build(options: WorldOptions) -> World:
    """Build the supermarket."""
    given = parse_options(SupermarketOptions, "supermarket", options.extra)
    setting = Setting(
        name="supermarket",
        build_scene=partial(_stage, given.scenery(), options.world_seed, options.threads),
        movers=_crowd(given, options.seed),
        solids=_solids(),
        routes=_routes(),
        level_lux=partial(_light_lux, given.lighting),
    )
    rigs = {
        "front": CameraRig(_FRONT, _FRONT_MOUNTING),
        "omni": CameraRig(Catadioptric(), Pose3(z=_CAMERA_M), 15.0),
        "rgbd": RgbdRig(mounting=_FRONT_MOUNTING),
        "laser": LaserRig(range_max_m=given.laser_m),
    }
    imaging = imaging_of(given, 0.62, vignette=0.3)
    site = setting.site(options, imaging, rigs, floor_camera=partial(camera_over, "terrazzo", "supermarket", options))
    return setting.world(
        site,
        options.vehicle or Holonomic(),
        SENSORS,
        ("wheels", "laser", "omni"),
        start=Pose2(1.0, 2.0, 0.0),
        truth={"shelves": np.array(_SHELVES), "goal": np.array([5.55, 3.11])},
    )


def _routes() -> dict[str, Route]:
    x = np.arange(1.0, 5.0 + 1e-9, 0.01)
    wall = np.stack([x, np.full_like(x, 2.0), np.zeros_like(x)], axis=1)
    corners = [(1.0, 2.0), (5.0, 2.2), (5.1, 5.6), (8.9, 5.6), (8.9, 7.6), (5.1, 7.6), (1.0, 7.6), (1.0, 2.6)]
    return {
        "wall": Route.from_poses(wall, _SPEED_MPS, "4 m along a line beside a wall"),
        "round": Route.through(_cut_corners(corners, 0.35), _SPEED_MPS, "through all aisles"),
        "goal": Route.through(
            _cut_corners([(1.2, 7.6), (5.1, 7.6), (5.2, 3.11), (5.55, 3.11)], 0.15), _SPEED_MPS, "to the goal"
        ),
    }


def _cut_corners(corners: list[tuple[float, float]], radius_m: float) -> list[tuple[float, float]]:
    """Return corners cut off, so that a smooth way goes through."""
    points = [corners[0]]
    for before, corner, after in zip(corners[:-2], corners[1:-1], corners[2:]):
        here = np.array(corner)
        for other in (before, after):
            way = np.array(other) - here
            points.append(tuple((here + way * radius_m / np.hypot(*way)).tolist()))
    return [*points, corners[-1]]


def _crowd(given: SupermarketOptions, seed: int) -> Crowd:
    rng = frame_rng(seed, "walks")
    speeds, starts = rng.uniform(0.5, 1.2, len(_WALKS)), rng.uniform(0.0, 12.0, len(_WALKS))
    return Crowd([Walk(way, float(v), float(s)) for way, v, s in zip(_WALKS[: given.people], speeds, starts)], seed)


def _solids() -> Solids:
    solids = Solids(_ROOM.west, _ROOM.east, _ROOM.south, _ROOM.north)
    for x, y in _SHELVES:
        solids.box("a shelf", x, y, _SHELF_M[0], _SHELF_M[1])
    solids.box("the refrigerator", *_FRIDGE)
    solids.box("the checkout", *_CHECKOUT)
    for x, y, radius in _POLES:
        solids.pole("a pole", x, y, radius)
    return solids


def _light_lux(lighting: str, pose: Pose2, stamp_s: float) -> float:
    level = 520.0 if lighting == "all" else 290.0
    return level * (1.0 + 0.15 * math.cos(2.0 * math.pi * pose.x / 2.5) * math.cos(2.0 * math.pi * pose.y / 3.3))


@lru_cache(maxsize=2)
def _stage(given: SupermarketOptions, world_seed: int, threads: int) -> Scene:
    rng = frame_rng(world_seed, "supermarket")
    lamps = lamp_panels((1.25, 3.75, 6.25, 8.75), (1.7, 5.0, 8.3), _ROOM.height_m, (1.2, 0.3), 2.6)
    lit = lamps if given.lighting == "all" else lamps[::2]
    builder = SceneBuilder(Lighting(lit, (0.42, 0.42, 0.41)))
    _add_walls(builder.labelled("wall"), rng, _POLISHED_FLOOR * given.shiny)
    if not given.alike:
        _hang_posters(builder.labelled("poster"), rng)
    show_lamps(builder, lit, 6.0)
    for number, (x, y) in enumerate(_SHELVES):
        stock = frame_rng(world_seed, "stock of every shelf") if given.alike else rng
        _add_shelf(builder, stock, x, y, number)
    _add_fridge(builder, rng, _GLASS * given.shiny)
    _add_checkout(builder, rng)
    pole = Surface(builder.texture(textures.plaster(rng, (200, 196, 186), 128, 0.04)), (2.0, 4.0))
    for x, y, radius in _POLES:
        builder.labelled("pole").cylinder(x, y, 0.0, radius, _ROOM.height_m, pole)
    add_cloth(builder)
    return builder.build(threads)


def _add_walls(builder: SceneBuilder, rng: np.random.Generator, floor_mirror: float) -> None:
    white = builder.texture(textures.plaster(rng, (232, 231, 226), 512, 0.008))
    paint = builder.texture(textures.plaster(rng, (205, 200, 182), 512, 0.02))
    floor = builder.texture(textures.speckle(rng, (150, 146, 136), 512, 0.09, joints=4))
    ceiling = builder.texture(textures.panels(rng, (222, 222, 218)))
    walls = {"west": (white, 4.0), "south": (paint, 3.0), "east": (paint, 3.0), "north": (paint, 3.0)}
    add_room(builder, _ROOM, (floor, 2.4), (ceiling, 2.4), walls, floor_mirror=floor_mirror)


def _hang_posters(builder: SceneBuilder, rng: np.random.Generator) -> None:
    """Hang posters, doors and a clock on three of the walls."""
    for side, along_m in (
        ("south", 5.2),
        ("south", 7.0),
        ("north", 0.8),
        ("north", 4.3),
        ("north", 8.1),
        ("east", 1.2),
        ("east", 5.4),
    ):
        size_m = float(rng.uniform(0.7, 1.2))
        look = Surface(builder.texture(lettering.poster(rng)))
        hang(builder, _ROOM, side, along_m, float(rng.uniform(1.0, 1.5)), (size_m, size_m), look)
    hang(builder, _ROOM, "south", 8.6, 0.0, (1.0, 2.1), Surface(builder.texture(textures.door(rng, (150, 110, 75)))))
    hang(
        builder, _ROOM, "east", 3.2, 0.0, (1.8, 2.1), Surface(builder.texture(textures.door(rng, (120, 130, 140), 512)))
    )
    clock = Surface(tint=(0.9, 0.9, 0.88))
    builder.ellipsoid((6.2, 9.97, 2.4), (0.2, 0.03, 0.2), clock)


def _add_shelf(builder: SceneBuilder, rng: np.random.Generator, x: float, y: float, number: int) -> None:
    length, depth, height = _SHELF_M
    metal = Surface(builder.texture(textures.plaster(rng, (150, 150, 152), 64, 0.03)), (2.0, 2.0))
    builder.box((x, y, 0.0), _SHELF_M, metal)
    step = (height - 0.12) / _BOARDS
    for out in (1.0, -1.0):
        for board in range(_BOARDS):
            goods = Surface(builder.texture(textures.products(rng, 1024, 128, int(rng.integers(9, 16)))))
            corner = (x + out * length / 2.0, y + out * (depth / 2.0 + 0.005), 0.1 + board * step)
            builder.labelled("goods").rectangle(corner, (-out * length, 0.0, 0.0), (0.0, 0.0, step - 0.04), goods)
    colour = _SIGN_COLOURS[number]
    name = Surface(builder.texture(lettering.sign(_GOODS[number], colour, (245, 245, 240), 512, 256)))
    for out in (1.0, -1.0):
        corner = (x + out * 0.45, y + out * 0.012, height + 0.05)
        builder.labelled("sign").rectangle(corner, (-out * 0.9, 0.0, 0.0), (0.0, 0.0, 0.42), name)
        end = (x + out * (length / 2.0 + 0.006), y - out * 0.3, 0.75)
        face = Surface(builder.texture(lettering.poster(rng)))
        builder.labelled("poster").rectangle(end, (0.0, out * 0.6, 0.0), (0.0, 0.0, 0.8), face)


def _add_fridge(builder: SceneBuilder, rng: np.random.Generator, mirror: float) -> None:
    x, y, length, depth = _FRIDGE
    steel = Surface(builder.texture(textures.plaster(rng, (215, 218, 220), 64, 0.02)), (2.0, 2.0), shine=0.1)
    builder.box((x, y, 0.0), (length, depth, 2.1), steel)
    for row in range(4):
        look = builder.texture(textures.products(rng, 1024, 128, 14))
        goods = Surface(look, tint=(0.85, 0.95, 1.0), emission=0.35, shine=0.15, mirror=mirror)
        corner = (x + length / 2.0 - 0.08, y + depth / 2.0 + 0.005, 0.22 + row * 0.42)
        builder.labelled("goods").rectangle(corner, (-(length - 0.16), 0.0, 0.0), (0.0, 0.0, 0.4), goods)
    board = Surface(builder.texture(lettering.sign("FRESH DAIRY", (230, 235, 240), (20, 60, 130), 512, 64)))
    place = (x + 1.2, y + depth / 2.0 + 0.006, 1.92)
    builder.labelled("sign").rectangle(place, (-2.4, 0.0, 0.0), (0.0, 0.0, 0.16), board)


def _add_checkout(builder: SceneBuilder, rng: np.random.Generator) -> None:
    x, y, length, depth = _CHECKOUT
    body = Surface(builder.texture(textures.plaster(rng, (70, 74, 80), 64, 0.05)), (2.0, 2.0))
    builder.box((x, y, 0.0), (length, depth, 0.95), body)
    builder.box((x + 0.1, y, 0.95), (0.12, 0.5, 0.55), body, math.pi)
    screen = Surface(builder.texture(lettering.notice(rng)), emission=1.0, blocks_light=False)
    builder.rectangle((x + 0.03, y + 0.22, 1.0), (0.0, -0.44, 0.0), (0.0, 0.0, 0.42), screen)
    board = Surface(builder.texture(lettering.sign("SELF CHECKOUT", (240, 200, 30), (20, 20, 20), 512, 128)))
    place = (x - length / 2.0 - 0.006, y + 0.45, 0.45)
    builder.labelled("sign").rectangle(place, (0.0, -0.9, 0.0), (0.0, 0.0, 0.3), board)
