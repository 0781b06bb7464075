"""A paved street of 60 m between houses, with trees and parked cars, in the morning or the afternoon.

After the "outdoors" of Perroni Filho & Ohya 2014, Sec. V: tiles that shake the robot, sun and shadow, people.
"""

from __future__ import annotations

from functools import lru_cache, partial

import numpy as np
import numpy.typing as npt

from trailmark.geometry import Pose2
from trailmark_sim.actors import Crowd
from trailmark_sim.render import lettering, textures
from trailmark_sim.render.bake import Lighting
from trailmark_sim.render.scene import Scene, SceneBuilder, Surface
from trailmark_sim.rng import frame_rng
from trailmark_sim.worlds.base import World, WorldOptions, parse_options
from trailmark_sim.worlds.forward_rig import SENSORS, forward_world, straight, to_and_fro
from trailmark_sim.worlds.scene_options import StreetOptions
from trailmark_sim.worlds.solids import Solids

__all__ = ["ROUTES", "SENSORS", "build"]

ROUTES = ("straight",)

_WEST_M, _EAST_M = -8.0, 62.0
#: House fronts, and the edge of the paved way, to the left and right of the route [m].
_NORTH_M, _SOUTH_M, _KERB_M = 6.0, -7.5, 2.2
_ROUTE_M = 30.0
_CARS = ((6.0, -4.4), (12.5, -4.5), (20.5, -4.3), (27.0, -4.5), (38.0, -4.4), (46.0, -4.4))
_TREES = ((4.0, 3.4), (11.0, 3.5), (18.0, 3.3), (25.0, 3.5), (33.0, 3.4), (42.0, 3.5), (15.5, -6.3), (31.0, -6.2))
_PAINTS = (
    *((0.35, 0.03, 0.03), (0.55, 0.56, 0.58), (0.04, 0.07, 0.2)),
    *((0.6, 0.6, 0.57), (0.02, 0.02, 0.025), (0.1, 0.2, 0.12)),
)
#: Direction to the sun, colour of its light, and light of the sky.
_SUN = {
    "morning": ((0.55, 0.45, 0.55), (2.6, 2.2, 1.7), (0.55, 0.60, 0.70)),
    "afternoon": ((-0.45, -0.55, 0.75), (3.0, 2.8, 2.4), (0.60, 0.66, 0.74)),
}


def build(options: WorldOptions) -> World:
    """Build the street."""
    given = parse_options(StreetOptions, "street", options.extra)
    solids = Solids(_WEST_M, _EAST_M, _SOUTH_M, _NORTH_M)
    for x, y in _CARS[: given.cars]:
        solids.box("a car", x, y, 4.2, 1.7)
    for x, y in _TREES:
        solids.pole("a tree", x, y, 0.16)
    return forward_world(
        "street",
        options,
        given,
        partial(_scene, given.scenery(), options.world_seed, options.seed if given.people else 0, options.threads),
        _crowd(given, options.seed),
        solids,
        straight(_ROUTE_M, "30 m along the street"),
        partial(_light_lux, given.time),
        vibration_rad=2e-3,
    )


def _crowd(given: StreetOptions, seed: int) -> Crowd:
    return to_and_fro(given.people, seed, 1.0, 50.0, (1.3, -1.5, 1.8, -2.0, 0.9, -1.0))


def _light_lux(time: str, pose: Pose2, stamp_s: float) -> float:
    level = 22000.0 if time == "morning" else 48000.0
    return level * (0.7 if int(pose.x / 7.0) % 2 else 1.0)


@lru_cache(maxsize=1)
def _scene(given: StreetOptions, world_seed: int, seed: int, threads: int) -> Scene:
    rng = frame_rng(world_seed, "street")
    direction, sunlight, ambient = _SUN[given.time]
    lighting = Lighting((), ambient, direction, sunlight, reach_m=4.0, texel_m=0.5)
    builder = SceneBuilder(lighting, _sky(rng, np.array(direction)))
    _add_ground(builder, rng)
    _add_houses(builder, rng)
    bark = Surface(builder.texture(textures.boards(rng, (92, 74, 58), 128, 8)), (1.0, 3.0))
    leaf = builder.texture(textures.foliage(rng, (74, 98, 46), 256))
    for x, y in _TREES:
        _add_tree(builder, rng, x, y, bark, leaf)
    paints = [_PAINTS[n] for n in rng.permutation(len(_PAINTS))]
    for (x, y), paint in list(zip(_CARS, paints))[: given.cars]:
        _add_car(builder, rng, x, y, paint)
    _add_signs(builder, rng)
    _crowd(given, seed).add_to(builder)
    return builder.build(threads)


def _sky(rng: np.random.Generator, sun: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
    """Return the sky: bright at the horizon and about the sun, with clouds."""
    rows, columns = 128, 256
    down, around = np.meshgrid(
        (np.arange(rows) + 0.5) / rows * np.pi, ((np.arange(columns) + 0.5) / columns - 0.5) * 2 * np.pi, indexing="ij"
    )
    way = np.stack([np.sin(down) * np.cos(around), np.sin(down) * np.sin(around), np.cos(down)], axis=-1)
    height = np.clip(way[..., 2], 0.0, 1.0)[..., None]
    blue = np.array([0.45, 0.65, 1.05]) * (1.0 - 0.45 * height) + np.array([0.75, 0.65, 0.45]) * (1.0 - height) ** 4
    cloud = np.clip(textures.noise(rng, 256, 1.5)[:rows] * 0.5 + 0.2, 0.0, 1.0)[..., None]
    glow = np.clip(way @ (sun / np.linalg.norm(sun)), 0.0, 1.0)[..., None]
    light = blue * (1 - cloud) + 1.5 * cloud + 2.0 * glow**32 + 40.0 * (glow > 0.9985)
    return np.asarray(2.0 * light, np.float32)


def _add_ground(builder: SceneBuilder, rng: np.random.Generator) -> None:
    long = _EAST_M - _WEST_M + 40.0
    slabs = builder.texture(textures.paving(rng, (158, 152, 140), 1024, 16, 0.13))
    tar = builder.texture(textures.speckle(rng, (92, 92, 94), 512, 0.22))
    green = builder.texture(textures.foliage(rng, (86, 104, 58), 512))

    def strip(south: float, north: float, texture: int, tile_m: float, z: float) -> None:
        surface = Surface(texture, (long / tile_m, (north - south) / tile_m), is_floor=True)
        builder.rectangle((_WEST_M - 20.0, south, z), (long, 0, 0), (0, north - south, 0), surface)

    strip(-_KERB_M - 0.3, _KERB_M, slabs, 3.2, 0.0)
    strip(_SOUTH_M - 3.0, -_KERB_M - 0.3, tar, 2.0, -0.1)
    strip(_KERB_M, _NORTH_M + 3.0, green, 1.6, 0.0)
    stone = Surface(builder.texture(textures.plaster(rng, (150, 148, 140), 128, 0.08)), (60.0, 1.0))
    builder.rectangle((_WEST_M, -_KERB_M - 0.3, -0.1), (_EAST_M - _WEST_M, 0, 0), (0, 0, 0.1), stone)
    drain = Surface(tint=(0.05, 0.05, 0.05), is_floor=True)
    for x in (3.0, 9.5, 16.0, 22.0, 36.0):
        builder.rectangle((x, 0.9, 0.003), (0.5, 0, 0), (0, 0.4, 0), drain)


def _add_houses(builder: SceneBuilder, rng: np.random.Generator) -> None:
    colours = ((196, 178, 148), (172, 120, 96), (205, 200, 188), (150, 142, 130), (188, 160, 120), (160, 110, 92))
    colours_of = [colours[n] for n in rng.permutation(len(colours))]
    fronts = [builder.texture(textures.facade(rng, colour, 512, 3, 4)) for colour in colours_of]
    gables = [builder.texture(textures.plaster(rng, colour, 256, 0.05)) for colour in colours_of]
    for side, y in (("north", _NORTH_M), ("south", _SOUTH_M - 2.5)):
        x = _WEST_M - 10.0
        while x < _EAST_M + 10.0:
            wide, high = float(rng.uniform(9.0, 15.0)), float(rng.uniform(7.0, 12.0))
            kind = int(rng.integers(len(fronts)))
            # Whole windows: four to a texture's width and three to its height.
            repeat = (max(3, round(wide / 2.4)) / 4.0, max(2, round(high / 3.0)) / 3.0)
            front, gable = Surface(fronts[kind], repeat), Surface(gables[kind], (2.0, 3.0))
            set_back = float(rng.uniform(0.0, 0.8)) * (1.0 if side == "north" else -1.0)
            middle = (x + wide / 2.0, y + set_back + (3.0 if side == "north" else -3.0), -0.1)
            heading = -np.pi / 2 if side == "north" else np.pi / 2
            builder.box(middle, (6.0, wide, high), gable, heading, front=front)
            x += wide + (float(rng.uniform(0.0, 2.5)) if rng.random() < 0.5 else 0.0)
    end = Surface(fronts[2], (2.0, 4.0 / 3.0))
    builder.box((_EAST_M + 9.0, -1.0, -0.1), (6.0, 20.0, 12.0), end, np.pi, front=end)


def _add_tree(builder: SceneBuilder, rng: np.random.Generator, x: float, y: float, bark: Surface, leaf: int) -> None:
    builder.cylinder(x, y, -0.1, 0.13, 2.6, bark)
    for _ in range(4):
        a, b, c = rng.uniform(0.6, 1.1, 3).tolist()
        dx, dy, dz = rng.uniform((-0.7, -0.6, -0.3), (0.7, 0.6, 0.9)).tolist()
        middle = (x + dx, y + dy, 2.9 + dz)
        builder.ellipsoid(middle, (a, b, c), Surface(leaf, (5.0, 2.5)), float(rng.uniform(0, 3)))


def _add_car(
    builder: SceneBuilder, rng: np.random.Generator, x: float, y: float, paint: tuple[float, float, float]
) -> None:
    body = Surface(builder.texture(textures.plaster(rng, (240, 240, 240), 64, 0.01)), tint=paint, shine=0.25)
    glass = Surface(builder.texture(textures.clouds(rng, (20, 25, 30), (130, 150, 165), 128, 1.5)), shine=0.35)
    builder.box((x, y, 0.15), (4.2, 1.7, 0.6), body)
    builder.box((x - 0.2, y, 0.75), (2.2, 1.5, 0.55), glass, top=body)
    tyre, hub = Surface(tint=(0.02, 0.02, 0.02)), Surface(tint=(0.4, 0.4, 0.42))
    for forward in (-1.3, 1.3):
        builder.ellipsoid((x + forward, y + 0.83, 0.22), (0.32, 0.06, 0.32), tyre)
        builder.ellipsoid((x + forward, y + 0.88, 0.22), (0.16, 0.04, 0.16), hub)
    lamp = Surface(tint=(0.7, 0.08, 0.05))
    builder.rectangle((x - 2.106, y + 0.75, 0.5), (0.0, -0.3, 0.0), (0.0, 0.0, 0.14), lamp)
    builder.rectangle((x - 2.106, y - 0.45, 0.5), (0.0, -0.3, 0.0), (0.0, 0.0, 0.14), lamp)
    number = lettering.sign(f"TM {rng.integers(100, 999)}", (235, 235, 225), (20, 20, 25), 256, 64)
    plate = Surface(builder.texture(number))
    builder.rectangle((x - 2.106, y + 0.26, 0.35), (0.0, -0.52, 0.0), (0.0, 0.0, 0.12), plate)


def _add_signs(builder: SceneBuilder, rng: np.random.Generator) -> None:
    post = Surface(tint=(0.3, 0.31, 0.32))
    words = (("SLOW", (200, 160, 20)), ("STOP", (160, 20, 25)), ("PARK", (25, 70, 150)), ("SCHOOL", (220, 130, 20)))
    for (word, colour), x in zip(words, (8.0, 17.5, 28.5, 40.0)):
        builder.cylinder(x, 2.5, 0.0, 0.035, 2.6, post)
        board = Surface(builder.texture(lettering.sign(word, colour, (245, 245, 245), 256, 256)))
        builder.rectangle((x - 0.05, 2.85, 1.9), (0.0, -0.7, 0.0), (0.0, 0.0, 0.7), board)
    for x in (6.5, 13.5, 23.0, 35.0):
        builder.cylinder(x, -2.35, 0.0, 0.06, 0.9, Surface(tint=(0.12, 0.12, 0.13)))
    for x in (5.0, 14.0, 21.5):
        board = Surface(builder.texture(lettering.poster(rng)))
        builder.box((x, 2.9, 0.3), (0.1, 1.0, 1.4), board, np.pi)
