"""A paved street of 60 m between houses, with trees and parked cars, in the morning or the afternoon; or two bends.

After the "outdoors" of Perroni Filho & Ohya 2014, Sec. V: tiles that shake the robot, sun and shadow, people. The
route chooses the plan of the street. The robot may also carry a ground camera, a laser, colour and depth, and an
omnidirectional camera, as in the supermarket; a real structured-light camera sees no depth in the sun.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import zip_longest

import numpy as np

from trailmark.arrays import Bgr8, Float32s, Floats
from trailmark.geometry import Pose2, Pose3
from trailmark_sim.actors import Crowd, add_cloth
from trailmark_sim.render import lettering, textures
from trailmark_sim.render.bake import Lighting
from trailmark_sim.render.lenses import Catadioptric
from trailmark_sim.render.scene import Scene, SceneBuilder, Surface
from trailmark_sim.rng import frame_rng
from trailmark_sim.routes import arc, line
from trailmark_sim.sensors.camera import CameraRig
from trailmark_sim.sensors.floor import camera_over
from trailmark_sim.sensors.laser import LaserRig
from trailmark_sim.sensors.rgbd import RgbdRig
from trailmark_sim.vehicles import Differential
from trailmark_sim.worlds.base import World, WorldOptions, choose_route, parse_options
from trailmark_sim.worlds.forward_rig import forward_camera, forward_imaging, route_along, to_and_fro
from trailmark_sim.worlds.scene_options import Season, StreetOptions
from trailmark_sim.worlds.setting import Setting
from trailmark_sim.worlds.solids import Solids
from trailmark_sim.worlds.street_legs import PLANS, HouseRow, Leg, StreetPlan

__all__ = ["ROUTES", "SENSORS", "build"]

SENSORS = ("floor", "laser", "front_depth", "front", "rgbd", "omni")
ROUTES = ("straight", "bends")

_VIBRATION_RAD = 2e-3
#: The ground camera looks down between the wheels; the others stand above the front camera's place.
_LASER_M, _EYES_M, _OMNI_M = 0.30, 0.65, 1.2

Rgb = tuple[int, int, int]

_ROUTES = {
    "straight": route_along([line(30.0)], "30 m along the street"),
    "bends": route_along([line(18.0), arc(2.0, 90), line(14.0), arc(2.0, -90), line(12.0)], "50 m around two corners"),
}
_PAINTS = (
    *((0.35, 0.03, 0.03), (0.55, 0.56, 0.58), (0.04, 0.07, 0.2)),
    *((0.6, 0.6, 0.57), (0.02, 0.02, 0.025), (0.1, 0.2, 0.12)),
)
_WORDS: tuple[tuple[str, Rgb], ...] = (
    *(("SLOW", (200, 160, 20)), ("STOP", (160, 20, 25)), ("PARK", (25, 70, 150)), ("SCHOOL", (220, 130, 20))),
)
#: House fronts to the left and right of the route [m].
_NORTH_M, _SOUTH_M = 6.0, -10.0
#: Direction to the sun, colour of its light, and light of the sky.
_SUN = {
    "morning": ((0.55, 0.45, 0.55), (2.6, 2.2, 1.7), (0.55, 0.60, 0.70)),
    "afternoon": ((-0.45, -0.55, 0.75), (3.0, 2.8, 2.4), (0.60, 0.66, 0.74)),
}


@dataclass(frozen=True, slots=True)
class _Growth:
    """The vegetation of a season: colours of leaves and grass, how full the trees are, litter."""

    leaf: Rgb
    green: Rgb
    n_crowns: int = 4
    lies_about: Rgb | None = None
    covered: float = 0.0


_GROWTH: Mapping[Season, _Growth] = {
    "summer": _Growth((74, 98, 46), (86, 104, 58)),
    "autumn": _Growth((150, 104, 38), (118, 110, 62), 2, (142, 92, 36), 0.25),
    "winter": _Growth((74, 98, 46), (216, 220, 226), 0, (226, 229, 234), 0.5),
}


def build(options: WorldOptions) -> World:
    """Build the street of the chosen route."""
    given = parse_options(StreetOptions, "street", options.extra)
    name = choose_route("street", options, ROUTES)
    setting = Setting(
        name="street",
        build_scene=partial(_stage, name, given.scenery(), options.world_seed, options.threads),
        movers=_crowd(name, given, options.seed),
        solids=_solids(PLANS[name], given.cars),
        routes={name: _ROUTES[name]} | _ROUTES,
        level_lux=partial(_light_lux, given.time),
    )
    rigs = {
        "front": forward_camera(given.width_px),
        "omni": CameraRig(Catadioptric(), Pose3(z=_OMNI_M), 15.0),
        "rgbd": RgbdRig(mounting=Pose3(x=0.15, z=_EYES_M)),
        "laser": LaserRig(mounting=Pose3(x=0.15, z=_LASER_M)),
    }
    imaging = forward_imaging(options, given, _VIBRATION_RAD)
    site = setting.site(options, imaging, rigs, floor_camera=partial(camera_over, "pavers", "street", options))
    return setting.world(site, options.vehicle or Differential(), SENSORS, ("wheels", "front"), start=Pose2())


def _poses_of_parked_cars(plan: StreetPlan, n: int) -> list[Pose2]:
    """Return where the first `n` cars stand: one in each leg, then the next in each."""
    rounds = zip_longest(*([leg.pose @ Pose2(x, y) for x, y in leg.cars] for leg in plan.legs))
    return [car for one in rounds for car in one if car is not None][:n]


def _solids(plan: StreetPlan, n_cars: int) -> Solids:
    solids = Solids(*plan.bounds)
    for block in plan.blocks:
        middle = ((block.west + block.east) / 2.0, (block.south + block.north) / 2.0)
        solids.box("a house", *middle, block.east - block.west, block.north - block.south)
    for car in _poses_of_parked_cars(plan, n_cars):
        solids.box("a car", car.x, car.y, 4.2, 1.7, car.theta)
    for leg in plan.legs:
        for x, y in leg.trees:
            tree = leg.pose @ Pose2(x, y)
            solids.pole("a tree", tree.x, tree.y, 0.16)
    return solids


def _crowd(name: str, given: StreetOptions, seed: int) -> Crowd:
    ways = [PLANS[name].lane(left_m) for left_m in (1.3, -1.5, 1.8, -2.0, 0.9, -1.0)]
    return to_and_fro(given.people, seed, 49.0 if name == "straight" else 62.0, ways)


def _light_lux(time: str, pose: Pose2, stamp_s: float) -> float:
    level = 22000.0 if time == "morning" else 48000.0
    return level * (0.7 if int(pose.x / 7.0) % 2 else 1.0)


@lru_cache(maxsize=2)
def _stage(name: str, given: StreetOptions, world_seed: int, threads: int) -> Scene:
    rng, plan, growth = frame_rng(world_seed, "street"), PLANS[name], _GROWTH[given.season]
    direction, sunlight, ambient = _SUN[given.time]
    lighting = Lighting((), ambient, direction, sunlight, reach_m=4.0, texel_m=0.5)
    builder = SceneBuilder(lighting, _sky(rng, np.array(direction)))
    _add_ground(builder, rng, plan, growth, frame_rng(world_seed, given.season))
    _add_houses(builder, rng, plan)
    bark = Surface(builder.texture(textures.boards(rng, (92, 74, 58), 128, 8)), (1.0, 3.0))
    leaf = builder.texture(textures.foliage(rng, growth.leaf, 256))
    for leg in plan.legs:
        for x, y in leg.trees:
            _add_tree(builder.at_pose(leg.pose), rng, (x, y), (bark, leaf), growth.n_crowns)
    paints = [_PAINTS[n] for n in rng.permutation(len(_PAINTS))]
    for car, paint in zip(_poses_of_parked_cars(plan, given.cars), paints):
        _add_car(builder.at_pose(car), rng, paint)
    words = iter(_WORDS)
    for leg in plan.legs:
        _add_signs(builder.at_pose(leg.pose), leg, words)
    for leg in plan.legs:
        _add_boards(builder.at_pose(leg.pose), rng, leg)
    add_cloth(builder)
    return builder.build(threads)


def _sky(rng: np.random.Generator, sun: Floats) -> Float32s:
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


def _add_ground(
    builder: SceneBuilder,
    rng: np.random.Generator,
    plan: StreetPlan,
    growth: _Growth,
    weather_rng: np.random.Generator,
) -> None:
    """Add pavement and grass; litter draws from a random generator of its own."""
    paving, tarmac = (
        textures.paving(rng, (158, 152, 140), 1024, 16, 0.13),
        textures.speckle(rng, (92, 92, 94), 512, 0.22),
    )
    slabs, tar = (builder.texture(_strewn(weather_rng, look, growth)) for look in (paving, tarmac))
    green = builder.texture(textures.foliage(rng, growth.green, 512))
    looks = {"slabs": (slabs, 3.2), "tar": (tar, 2.0), "green": (green, 1.6)}
    for strip in plan.strips:
        texture, tile_m = looks[strip.ground]
        long, wide = strip.east - strip.west, strip.north - strip.south
        surface = Surface(texture, (long / tile_m, wide / tile_m), is_floor=True)
        builder.rectangle((strip.west, strip.south, strip.z), (long, 0, 0), (0, wide, 0), surface)
    stone = Surface(builder.texture(textures.plaster(rng, (150, 148, 140), 128, 0.08)), (60.0, 1.0))
    for leg, (first, last) in zip(plan.legs, plan.kerbs, strict=True):
        builder.at_pose(leg.pose).rectangle((first, -2.5, -0.1), (last - first, 0, 0), (0, 0, 0.1), stone)
    drain = Surface(tint=(0.05, 0.05, 0.05), is_floor=True)
    for leg in plan.legs:
        for x in leg.drains:
            builder.at_pose(leg.pose).rectangle((x, 0.9, 0.003), (0.5, 0, 0), (0, 0.4, 0), drain)


def _strewn(rng: np.random.Generator, ground: Bgr8, growth: _Growth) -> Bgr8:
    """Return ground with litter on it in patches."""
    if growth.lies_about is None:
        return ground
    cover, where = textures.foliage(rng, growth.lies_about, len(ground)), textures.noise(rng, len(ground), 0.6, 2.0)
    return np.where((where > np.quantile(where, 1.0 - growth.covered))[..., None], cover, ground)


def _add_houses(builder: SceneBuilder, rng: np.random.Generator, plan: StreetPlan) -> None:
    colours = ((196, 178, 148), (172, 120, 96), (205, 200, 188), (150, 142, 130), (188, 160, 120), (160, 110, 92))
    colours_of = [colours[n] for n in rng.permutation(len(colours))]
    fronts = [builder.texture(textures.facade(rng, colour, 512, 3, 4)) for colour in colours_of]
    gables = [builder.texture(textures.plaster(rng, colour, 256, 0.05)) for colour in colours_of]
    for leg in plan.legs:
        for row in leg.houses:
            _add_row(builder.at_pose(leg.pose), rng, row, fronts, gables)
    end = Surface(fronts[2], (2.0, 4.0 / 3.0))
    x, y, wide = plan.end
    builder.box((x, y, -0.1), (6.0, wide, 12.0), end, np.pi, front=end)


def _add_row(
    builder: SceneBuilder, rng: np.random.Generator, row: HouseRow, fronts: list[int], gables: list[int]
) -> None:
    side = 1.0 if row.side == "north" else -1.0
    x, y = row.west, _NORTH_M if row.side == "north" else _SOUTH_M
    while x < row.east:
        wide, high = float(rng.uniform(9.0, 15.0)), float(rng.uniform(7.0, 12.0))
        if row.is_cut and row.east - x - wide < 5.0:  # nothing narrower than 5 m is left over
            wide = row.east - x
        kind = int(rng.integers(len(fronts)))
        # Whole windows: four to a texture's width and three to its height.
        repeat = (max(3, round(wide / 2.4)) / 4.0, max(2, round(high / 3.0)) / 3.0)
        front, gable = Surface(fronts[kind], repeat), Surface(gables[kind], (2.0, 3.0))
        set_back = float(rng.uniform(0.0, 0.8)) * side
        builder.box(
            (x + wide / 2.0, y + set_back + 3.0 * side, -0.1), (6.0, wide, high), gable, -side * np.pi / 2, front
        )
        x += wide + (float(rng.uniform(0.0, 2.5)) if rng.random() < 0.5 else 0.0)


def _add_tree(
    builder: SceneBuilder, rng: np.random.Generator, at: tuple[float, float], looks: tuple[Surface, int], n_crowns: int
) -> None:
    (x, y), (bark, leaf) = at, looks
    builder.cylinder(x, y, -0.1, 0.13, 2.6, bark)
    for crown in range(4):  # all are drawn: what comes after is the same in every season
        a, b, c = rng.uniform(0.6, 1.1, 3).tolist()
        dx, dy, dz = rng.uniform((-0.7, -0.6, -0.3), (0.7, 0.6, 0.9)).tolist()
        middle, yaw = (x + dx, y + dy, 2.9 + dz), float(rng.uniform(0, 3))
        if crown < n_crowns:
            builder.ellipsoid(middle, (a, b, c), Surface(leaf, (5.0, 2.5)), yaw)


def _add_car(builder: SceneBuilder, rng: np.random.Generator, paint: tuple[float, float, float]) -> None:
    body = Surface(builder.texture(textures.plaster(rng, (240, 240, 240), 64, 0.01)), tint=paint, shine=0.25)
    glass = Surface(builder.texture(textures.clouds(rng, (20, 25, 30), (130, 150, 165), 128, 1.5)), shine=0.35)
    builder.box((0.0, 0.0, 0.15), (4.2, 1.7, 0.6), body)
    builder.box((-0.2, 0.0, 0.75), (2.2, 1.5, 0.55), glass, top=body)
    tyre, hub = Surface(tint=(0.02, 0.02, 0.02)), Surface(tint=(0.4, 0.4, 0.42))
    for forward in (-1.3, 1.3):
        builder.ellipsoid((forward, 0.83, 0.22), (0.32, 0.06, 0.32), tyre)
        builder.ellipsoid((forward, 0.88, 0.22), (0.16, 0.04, 0.16), hub)
    lamp = Surface(tint=(0.7, 0.08, 0.05))
    builder.rectangle((-2.106, 0.75, 0.5), (0.0, -0.3, 0.0), (0.0, 0.0, 0.14), lamp)
    builder.rectangle((-2.106, -0.45, 0.5), (0.0, -0.3, 0.0), (0.0, 0.0, 0.14), lamp)
    number = lettering.sign(f"TM {rng.integers(100, 999)}", (235, 235, 225), (20, 20, 25), 256, 64)
    plate = Surface(builder.texture(number))
    builder.rectangle((-2.106, 0.26, 0.35), (0.0, -0.52, 0.0), (0.0, 0.0, 0.12), plate)


def _add_signs(builder: SceneBuilder, leg: Leg, words: Iterator[tuple[str, Rgb]]) -> None:
    post = Surface(tint=(0.3, 0.31, 0.32))
    for x in leg.signs:
        word, colour = next(words)
        builder.cylinder(x, 2.5, 0.0, 0.035, 2.6, post)
        board = Surface(builder.texture(lettering.sign(word, colour, (245, 245, 245), 256, 256)))
        builder.rectangle((x - 0.05, 2.85, 1.9), (0.0, -0.7, 0.0), (0.0, 0.0, 0.7), board)
    for x in leg.posts:
        builder.cylinder(x, -2.35, 0.0, 0.06, 0.9, Surface(tint=(0.12, 0.12, 0.13)))


def _add_boards(builder: SceneBuilder, rng: np.random.Generator, leg: Leg) -> None:
    for x in leg.boards:
        board = Surface(builder.texture(lettering.poster(rng)))
        builder.box((x, 2.9, 0.3), (0.1, 1.0, 1.4), board, np.pi)
