"""A corridor of 32 m with doors, boards and pipes, and windows with the sun in them.

After the "indoors" of Perroni Filho & Ohya 2014, Sec. V: a smooth floor, light that changes, windows too bright for
the camera, people who walk by.
"""

from __future__ import annotations

from functools import lru_cache, partial

import numpy as np

from trailmark.geometry import Pose2
from trailmark_sim.actors import Crowd
from trailmark_sim.render import lettering, textures
from trailmark_sim.render.bake import Lighting
from trailmark_sim.render.scene import Scene, SceneBuilder, Surface
from trailmark_sim.rng import frame_rng
from trailmark_sim.worlds.base import World, WorldOptions, parse_options
from trailmark_sim.worlds.forward_rig import SENSORS, forward_world, straight, to_and_fro
from trailmark_sim.worlds.furnishing import Room, add_room, hang, lamp_panels, show_lamps
from trailmark_sim.worlds.scene_options import CorridorOptions
from trailmark_sim.worlds.solids import Solids

__all__ = ["ROUTES", "SENSORS", "build"]

ROUTES = ("straight",)

_ROOM = Room(-2.0, 30.0, -1.2, 1.2, 2.7)
_ROUTE_M = 20.0
_LAMPS = {"all": 1.0, "half": 1.0, "off": 0.0}
#: Windows are so wide, their sill so high, and they end there [m].
_WINDOW_M, _SILL_M, _LINTEL_M = 1.5, 0.9, 2.2
_WINDOWS = (3.0, 6.0, 9.0, 15.0, 18.0, 21.0, 26.0)
_DOORS = (1.2, 5.0, 8.7, 12.9, 16.6, 20.8, 24.4)
#: Direction to the sun, and what colour its light has.
_SUN = {"morning": ((-0.55, 0.65, 0.45), (3.6, 3.2, 2.5)), "afternoon": ((0.5, 0.75, 0.6), (4.2, 4.0, 3.7))}


def build(options: WorldOptions) -> World:
    """Build the corridor."""
    given = parse_options(CorridorOptions, "corridor", options.extra)
    crowd = _crowd(given, options.seed)
    solids = Solids(_ROOM.west, _ROOM.east, _ROOM.south, _ROOM.north)
    for x in (4.0, 11.5, 19.4):
        solids.box("a bench", x, -1.0, 1.2, 0.36)
    solids.pole("a plant", 13.4, 0.95, 0.2)
    lux = {"all": 320.0, "half": 200.0, "off": 90.0}[given.lamps]
    return forward_world(
        "corridor",
        options,
        given,
        partial(_scene, given.scenery(), options.world_seed, options.seed if given.people else 0, options.threads),
        crowd,
        solids,
        straight(_ROUTE_M, "20 m along the corridor"),
        partial(_light_lux, lux),
        vibration_rad=4e-4,
    )


def _crowd(given: CorridorOptions, seed: int) -> Crowd:
    return to_and_fro(given.people, seed, -1.0, 29.0, (0.75, -0.7, 0.55, -0.5, 0.3, -0.2))


def _light_lux(level: float, pose: Pose2, stamp_s: float) -> float:
    nearest = min(abs(pose.x - x - _WINDOW_M / 2.0) for x in _WINDOWS)
    return level * (1.0 + 0.8 / (1.0 + nearest * nearest))


@lru_cache(maxsize=1)
def _scene(given: CorridorOptions, world_seed: int, seed: int, threads: int) -> Scene:
    rng = frame_rng(world_seed, "corridor")
    lamps = lamp_panels(np.arange(0.0, 29.0, 3.2).tolist(), (0.0,), _ROOM.height_m, (1.2, 0.25), 1.5)
    lit = lamps[::2] if given.lamps == "half" else lamps if given.lamps == "all" else ()
    direction, sunlight = _SUN[given.time]
    ambient = (0.20, 0.21, 0.23) if lit else (0.15, 0.16, 0.18)
    builder = SceneBuilder(Lighting(lit, ambient, direction, sunlight, texel_m=0.25))
    _add_shell(builder, rng)
    _add_windows(builder, rng)
    show_lamps(builder, lit, 6.0)
    _add_doors(builder, rng)
    _add_things(builder, rng)
    _crowd(given, seed).add_to(builder)
    return builder.build(threads)


def _add_shell(builder: SceneBuilder, rng: np.random.Generator) -> None:
    paint = builder.texture(textures.plaster(rng, (206, 203, 190), 1024, 0.035))
    floor = builder.texture(textures.speckle(rng, (122, 116, 104), 512, 0.18, joints=4))
    ceiling = builder.texture(textures.panels(rng, (205, 205, 200)))
    walls = {"south": (paint, 2.7), "west": (paint, 2.7), "east": (paint, 2.7)}
    add_room(builder, _ROOM, (floor, 1.8), (ceiling, 2.4), walls)
    # The wall with the windows: below, above and between them.
    length = _ROOM.east - _ROOM.west
    edges = [_ROOM.west, *(x + side for x in _WINDOWS for side in (0.0, _WINDOW_M)), _ROOM.east]
    bands = [(_ROOM.west, length, 0.0, _SILL_M), (_ROOM.west, length, _LINTEL_M, _ROOM.height_m - _LINTEL_M)]
    bands += [(a, b - a, _SILL_M, _LINTEL_M - _SILL_M) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    for x, wide, z, high in bands:
        surface = Surface(paint, (wide / 2.7, high / 2.7))
        builder.rectangle((x, _ROOM.north, z), (wide, 0, 0), (0, 0, high), surface)
    board = Surface(builder.texture(textures.boards(rng, (92, 74, 58), 64, 1)), (20.0, 1.0))
    hang(builder, _ROOM, "south", 0.0, 0.0, (length, 0.12), board, layer=1)
    hang(builder, _ROOM, "north", 0.0, 0.0, (length, 0.12), board, layer=1)
    dado = Surface(builder.texture(textures.plaster(rng, (96, 108, 100), 512, 0.05)), (20.0, 0.5))
    for side in ("south", "north"):
        hang(builder, _ROOM, side, 0.0, 0.12, (length, 0.73), dado, layer=1)
    rail = Surface(builder.texture(textures.boards(rng, (150, 110, 70), 64, 1)), (20.0, 1.0))
    hang(builder, _ROOM, "south", 0.0, 0.85, (length, 0.10), rail, layer=1)


def _add_windows(builder: SceneBuilder, rng: np.random.Generator) -> None:
    for number, x in enumerate(_WINDOWS):
        picture = builder.texture(textures.window(rng, 256, 2 + number % 2))
        # The sun shines from this side: what is behind the panes is too bright for the camera.
        pane = Surface(picture, emission=3.5, blocks_light=False)
        builder.rectangle((x, _ROOM.north + 0.12, _SILL_M), (_WINDOW_M, 0, 0), (0, 0, _LINTEL_M - _SILL_M), pane)
        sill = Surface(tint=(0.75, 0.74, 0.7))
        builder.rectangle((x, _ROOM.north, _SILL_M), (_WINDOW_M, 0, 0), (0, 0.12, 0), sill)
        high = _LINTEL_M - _SILL_M
        builder.rectangle((x, _ROOM.north + 0.12, _LINTEL_M), (_WINDOW_M, 0, 0), (0, -0.12, 0), sill)
        builder.rectangle((x, _ROOM.north, _SILL_M), (0, 0.12, 0), (0, 0, high), sill)
        builder.rectangle((x + _WINDOW_M, _ROOM.north + 0.12, _SILL_M), (0, -0.12, 0), (0, 0, high), sill)
    glass = Surface(builder.texture(textures.window(rng, 256, 2)), emission=2.5, blocks_light=False)
    hang(builder, _ROOM, "east", 0.45, 0.9, (1.5, 1.4), glass)


def _add_doors(builder: SceneBuilder, rng: np.random.Generator) -> None:
    colours = ((150, 112, 78), (96, 110, 122), (150, 112, 78), (128, 60, 48))
    for number, x in enumerate(_DOORS):
        look = Surface(builder.texture(textures.door(rng, colours[number % len(colours)])))
        hang(builder, _ROOM, "south", _ROOM.east - x - 0.95, 0.0, (0.95, 2.1), look)
        plate = lettering.sign(f"3D4{number:02d}", (235, 235, 228), (30, 30, 34), 128, 64)
        hang(builder, _ROOM, "south", _ROOM.east - x - 1.35, 1.5, (0.26, 0.13), Surface(builder.texture(plate)))


def _add_things(builder: SceneBuilder, rng: np.random.Generator) -> None:
    for x in np.arange(2.75, 29.0, 1.62):
        if any(abs(x - 0.4 - door - 0.475) < 1.0 for door in _DOORS):
            continue
        size_m = float(rng.uniform(0.45, 0.8))
        picture = lettering.poster(rng) if rng.random() < 0.4 else lettering.notice(rng)
        surface = Surface(builder.texture(picture))
        hang(builder, _ROOM, "south", _ROOM.east - x, float(rng.uniform(1.05, 1.4)), (size_m * 0.8, size_m), surface)
    for x in (1.7, 5.6, 13.2, 17.0, 23.2):
        sheet = Surface(builder.texture(lettering.notice(rng)))
        hang(builder, _ROOM, "north", x - _ROOM.west, 1.2, (0.5, 0.7), sheet)
    for x in (4.0, 11.5, 19.4):
        wood = Surface(builder.texture(textures.boards(rng, (168, 120, 72), 128, 3)), (2.0, 1.0))
        builder.box((x, -1.0, 0.0), (1.2, 0.36, 0.45), wood)
    red = Surface(tint=(0.55, 0.05, 0.04), shine=0.1)
    for x in (7.7, 15.7, 23.4):
        builder.cylinder(x, -1.1, 0.75, 0.075, 0.5, red)
    pot, leaves = Surface(tint=(0.35, 0.2, 0.13)), Surface(builder.texture(textures.foliage(rng)), (2.0, 2.0))
    builder.cylinder(13.4, 0.95, 0.0, 0.18, 0.4, pot)
    builder.ellipsoid((13.4, 0.95, 0.85), (0.26, 0.24, 0.5), leaves)
    pipe = Surface(builder.texture(textures.plaster(rng, (176, 172, 160), 64, 0.05)), (10.0, 1.0))
    for z, size in ((2.45, 0.10), (2.28, 0.07)):
        builder.box((14.0, -1.1, z), (31.9, 0.1, size), pipe)
    for x in (5.2, 8.2, 12.0, 17.2, 24.0):
        builder.cylinder(x, 1.16, 0.0, 0.04, _ROOM.height_m, pipe)
    sign = Surface(builder.texture(lettering.sign("EXIT", (20, 120, 60), (245, 245, 245), 256, 128)), emission=0.6)
    for x in (10.5, 22.0):
        builder.rectangle((x, 0.3, 2.25), (0.0, -0.6, 0.0), (0.0, 0.0, 0.3), sign)
