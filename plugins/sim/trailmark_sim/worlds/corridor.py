"""A corridor of 32 m with doors, boards and pipes, and windows with the sun in them; or one with two bends.

After the "indoors" of Perroni Filho & Ohya 2014, Sec. V: a smooth floor, light that changes, windows too bright for
the camera, people who walk by. The route chooses the floor plan.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, partial

import numpy as np

from trailmark.geometry import Pose2
from trailmark_sim.actors import Crowd, add_cloth
from trailmark_sim.render import lettering, textures
from trailmark_sim.render.bake import Lamp, Lighting
from trailmark_sim.render.scene import Scene, SceneBuilder, Surface
from trailmark_sim.rng import frame_rng
from trailmark_sim.routes import arc, line
from trailmark_sim.worlds.base import World, WorldOptions, choose_route, parse_options
from trailmark_sim.worlds.corridor_wings import PLANS, WINDOW_M, Wing, add_wings
from trailmark_sim.worlds.forward_rig import SENSORS, forward_world, route_along, to_and_fro
from trailmark_sim.worlds.furnishing import hang, lamp_panels, show_lamps
from trailmark_sim.worlds.scene_options import CorridorOptions
from trailmark_sim.worlds.setting import Setting
from trailmark_sim.worlds.solids import Solids

__all__ = ["ROUTES", "SENSORS", "build"]

ROUTES = ("straight", "bends")

_ROUTES = {
    "straight": route_along([line(20.0)], "20 m along the corridor"),
    "bends": route_along([line(17.2), arc(1.6, 90), line(13.6), arc(1.6, -90), line(14.2)], "50 m through three wings"),
}
_HEIGHT_M = 2.7
#: Direction to the sun, and what colour its light has.
_SUN = {"morning": ((-0.55, 0.65, 0.45), (3.6, 3.2, 2.5)), "afternoon": ((0.5, 0.75, 0.6), (4.2, 4.0, 3.7))}


def build(options: WorldOptions) -> World:
    """Build the corridor of the chosen route."""
    given = parse_options(CorridorOptions, "corridor", options.extra)
    plan = choose_route("corridor", options, ROUTES)
    setting = Setting(
        name="corridor",
        build_scene=partial(_stage, plan, given.scenery(), options.world_seed, options.threads),
        movers=_crowd(plan, given, options.seed),
        solids=_solids(plan),
        routes={plan: _ROUTES[plan]} | _ROUTES,
        level_lux=partial(_light_lux, plan, {"all": 320.0, "half": 200.0, "off": 90.0}[given.lamps]),
    )
    return forward_world(setting, options, given, vibration_rad=4e-4)


def _solids(plan: str) -> Solids:
    wings = PLANS[plan]
    solids = Solids(wings[0].room.west, 30.0, -1.2, 1.2)
    if plan == "bends":
        solids = Solids(-2.0, 37.0, -1.2, 18.0)
        # What lies between the wings.
        solids.box("a wall", 7.8, 9.6, 19.6, 16.8)
        solids.box("a wall", 28.5, 7.2, 17.0, 16.8)
    for wing in wings:
        for x in wing.benches:
            bench = wing.pose @ Pose2(x, -1.0, 0.0)
            solids.box("a bench", bench.x, bench.y, 1.2, 0.36, bench.theta)
        for x in wing.plants:
            plant = wing.pose @ Pose2(x, 0.95, 0.0)
            solids.pole("a plant", plant.x, plant.y, 0.2)
    return solids


def _crowd(plan: str, given: CorridorOptions, seed: int) -> Crowd:
    def way(left_m: float) -> list[tuple[float, float]]:
        if plan == "straight":
            return [(-1.0, left_m), (29.0, left_m * 0.9)]
        return [(-1.0, left_m), (18.8 - left_m, left_m), (18.8 - left_m, 16.8 + left_m), (36.0, 16.8 + left_m)]

    length_m = 30.0 if plan == "straight" else 53.8
    return to_and_fro(given.people, seed, length_m, [way(left_m) for left_m in (0.75, -0.7, 0.55, -0.5, 0.3, -0.2)])


def _light_lux(plan: str, level: float, pose: Pose2, stamp_s: float) -> float:
    nearest = 9.0
    for wing in PLANS[plan]:
        here = wing.pose.inverse() @ pose
        if abs(here.y) <= wing.room.north:
            nearest = min(nearest, *(abs(here.x - x - WINDOW_M / 2.0) for x in wing.windows))
    return level * (1.0 + 0.8 / (1.0 + nearest * nearest))


def _lamps(plan: str) -> tuple[Lamp, ...]:
    if plan == "straight":
        return lamp_panels(np.arange(0.0, 29.0, 3.2).tolist(), (0.0,), _HEIGHT_M, (1.2, 0.25), 1.5)
    first = lamp_panels(np.arange(0.0, 19.5, 3.2).tolist(), (0.0,), _HEIGHT_M, (1.2, 0.25), 1.5)
    second = lamp_panels((18.8,), np.arange(3.2, 15.0, 3.2).tolist(), _HEIGHT_M, (0.25, 1.2), 1.5)
    return first + second + lamp_panels(np.arange(19.2, 36.0, 3.2).tolist(), (16.8,), _HEIGHT_M, (1.2, 0.25), 1.5)


@lru_cache(maxsize=2)
def _stage(plan: str, given: CorridorOptions, world_seed: int, threads: int) -> Scene:
    rng = frame_rng(world_seed, "corridor")
    wings, lamps = PLANS[plan], _lamps(plan)
    lit = lamps[::2] if given.lamps == "half" else lamps if given.lamps == "all" else ()
    direction, sunlight = _SUN[given.time]
    ambient = (0.20, 0.21, 0.23) if lit else (0.15, 0.16, 0.18)
    builder = SceneBuilder(Lighting(lit, ambient, direction, sunlight, texel_m=0.25))
    add_wings(builder, rng, wings)
    show_lamps(builder, lit, 6.0)
    _add_doors(builder, rng, wings)
    _add_things(builder, rng, wings)
    add_cloth(builder)
    return builder.build(threads)


def _along(wings: Sequence[Wing], what: str) -> list[tuple[Wing, float]]:
    """Return where something stands, wing after wing."""
    return [(wing, x) for wing in wings for x in getattr(wing, what)]


def _add_doors(builder: SceneBuilder, rng: np.random.Generator, wings: Sequence[Wing]) -> None:
    colours = ((150, 112, 78), (96, 110, 122), (150, 112, 78), (128, 60, 48))
    for number, (wing, x) in enumerate(_along(wings, "doors")):
        here, east = builder.at_pose(wing.pose), wing.room.east
        look = Surface(builder.texture(textures.door(rng, colours[number % len(colours)])))
        hang(here, wing.room, "south", east - x - 0.95, 0.0, (0.95, 2.1), look)
        plate = lettering.sign(f"3D4{number:02d}", (235, 235, 228), (30, 30, 34), 128, 64)
        hang(here, wing.room, "south", east - x - 1.35, 1.5, (0.26, 0.13), Surface(builder.texture(plate)))


def _add_pictures(builder: SceneBuilder, rng: np.random.Generator, wing: Wing) -> None:
    room = wing.room
    for x in wing.posters:
        if any(abs(x - 0.4 - door - 0.475) < 1.0 for door in wing.doors):
            continue
        size_m = float(rng.uniform(0.45, 0.8))
        picture = lettering.poster(rng) if rng.random() < 0.4 else lettering.notice(rng)
        surface = Surface(builder.texture(picture))
        hang(builder, room, "south", room.east - x, float(rng.uniform(1.05, 1.4)), (size_m * 0.8, size_m), surface)
    for x in wing.sheets:
        sheet = Surface(builder.texture(lettering.notice(rng)))
        hang(builder, room, "north", x - room.west, 1.2, (0.5, 0.7), sheet)


def _add_things(builder: SceneBuilder, rng: np.random.Generator, wings: Sequence[Wing]) -> None:
    for wing in wings:
        _add_pictures(builder.at_pose(wing.pose), rng, wing)
    for wing, x in _along(wings, "benches"):
        wood = Surface(builder.texture(textures.boards(rng, (168, 120, 72), 128, 3)), (2.0, 1.0))
        builder.at_pose(wing.pose).box((x, -1.0, 0.0), (1.2, 0.36, 0.45), wood)
    pot, leaves = Surface(tint=(0.35, 0.2, 0.13)), Surface(builder.texture(textures.foliage(rng)), (2.0, 2.0))
    pipe = Surface(builder.texture(textures.plaster(rng, (176, 172, 160), 64, 0.05)), (10.0, 1.0))
    words = lettering.sign("EXIT", (20, 120, 60), (245, 245, 245), 256, 128)
    sign = Surface(builder.texture(words), emission=0.6)
    for wing in wings:
        _add_fittings(builder.at_pose(wing.pose), wing, (pot, leaves), pipe, sign)


def _add_fittings(
    builder: SceneBuilder, wing: Wing, plant: tuple[Surface, Surface], pipe: Surface, sign: Surface
) -> None:
    red = Surface(tint=(0.55, 0.05, 0.04), shine=0.1)
    for x in wing.extinguishers:
        builder.cylinder(x, -1.1, 0.75, 0.075, 0.5, red)
    for x in wing.plants:
        builder.cylinder(x, 0.95, 0.0, 0.18, 0.4, plant[0])
        builder.ellipsoid((x, 0.95, 0.85), (0.26, 0.24, 0.5), plant[1])
    length = wing.south_end - wing.room.west
    for z, size in ((2.45, 0.10), (2.28, 0.07)):
        builder.box((wing.room.west + length / 2.0, -1.1, z), (length - 0.1, 0.1, size), pipe)
    for x in wing.pipes:
        builder.cylinder(x, 1.16, 0.0, 0.04, wing.room.height_m, pipe)
    for x in wing.exits:
        builder.rectangle((x, 0.3, 2.25), (0.0, -0.6, 0.0), (0.0, 0.0, 0.3), sign)
