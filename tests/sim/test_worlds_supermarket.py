"""The supermarket and its sensors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.errors import ConfigError
from trailmark.frames import Image, Scan, payload_kind
from trailmark.geometry import Pose2
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds import build_world, supermarket
from trailmark_sim.worlds.base import World, WorldOptions
from trailmark_sim.worlds.scene_options import SupermarketOptions


def _world(threads: int = 1, **extra: object) -> World:
    return build_world("supermarket", WorldOptions(seed=3, sensors=("laser", "omni"), threads=threads, extra=extra))


@pytest.fixture(scope="module")
def world() -> World:
    return _world()


def test_the_same_bytes_come_from_one_and_two_threads(world: World) -> None:
    state = VehicleState(Pose2(1.2, 2.0, 0.3))
    two = _world(2)

    for sensor, other in zip(world.sensors, two.sensors):
        first, second = sensor.render(4, 0.4, state), other.render(4, 0.4, state)
        if isinstance(first, Image) and isinstance(second, Image):
            np.testing.assert_array_equal(first.pixels, second.pixels)
        if isinstance(first, Scan) and isinstance(second, Scan):
            np.testing.assert_array_equal(first.ranges_m, second.ranges_m)


def test_the_laser_measures_the_walls_within_its_noise(world: World) -> None:
    laser = world.sensors[0]
    pose = Pose2(1.5, 2.5, math.pi)  # looks at the white wall at x = 0 from 1.5 - 0.28 m
    errors = []

    for k in range(20):
        scan = laser.render(k, k / 10, VehicleState(pose))
        assert isinstance(scan, Scan)
        angles = scan.angles()
        seen = (np.abs(angles) < 0.8) & np.isfinite(scan.ranges_m)
        errors.append(scan.ranges_m[seen] - (1.5 - 0.28) / np.cos(angles[seen]))

    error = np.concatenate(errors)
    assert abs(error.mean()) < 5e-4
    assert error.std() == pytest.approx(0.0085, rel=0.1)


def test_shelves_look_alike_to_the_laser_and_different_to_the_camera(world: World) -> None:
    laser, omni = world.sensors
    before = [VehicleState(Pose2(x, 5.6, math.pi / 2)) for x in (3.2, 7.0)]

    scans = [laser.render(0, 0.0, state) for state in before]
    pictures = [omni.render(0, 0.0, state) for state in before]

    ahead = slice(300, 381)
    first, second = (scan.ranges_m[ahead] for scan in scans if isinstance(scan, Scan))
    assert np.nanmedian(np.abs(first - second)) < 0.02
    top = [picture.pixels[20:80, 120:200].astype(float) for picture in pictures if isinstance(picture, Image)]
    assert np.abs(top[0] - top[1]).mean() > 15.0


def test_the_wall_at_x_0_is_bare(world: World) -> None:
    picture = world.sensors[1].render(0, 0.0, VehicleState(Pose2(1.0, 2.0, math.pi)))

    assert isinstance(picture, Image)
    wall, other = picture.pixels[20:60, 130:190], picture.pixels[180:220, 130:190]
    assert (
        np.abs(np.diff(wall.astype(float), axis=1)).mean() < 0.7 * np.abs(np.diff(other.astype(float), axis=1)).mean()
    )


def test_people_walk_and_make_room(world: World) -> None:
    crowded = _world(people=8)
    state = VehicleState(Pose2(5.1, 5.6, 0.0))

    scans = [crowded.sensors[0].render(0, stamp_s, state) for stamp_s in np.arange(0.0, 20.0, 0.5)]

    nearest = [float(np.nanmin(scan.ranges_m)) for scan in scans if isinstance(scan, Scan)]
    assert min(nearest) > 0.15
    assert len(np.unique(np.round(nearest, 2))) > 10


def test_a_vehicle_in_a_shelf_or_a_wall_is_noticed(world: World) -> None:
    assert world.collides(Pose2(3.2, 4.6, 0.0)) == "a shelf"
    assert world.collides(Pose2(0.2, 5.0, 0.0)) == "a wall"
    assert world.collides(world.start) is None
    for route in world.routes.values():
        stations = np.linspace(0.0, route.length_m, 120)
        assert {world.collides(route.pose_at(float(s))) for s in stations} == {None}


def test_nine_people_are_too_many() -> None:
    with pytest.raises(ConfigError, match=r"people.*8"):
        _world(people=9)


def test_half_of_the_lamps_give_other_light() -> None:
    state = VehicleState(Pose2(1.2, 2.0, 0.0))

    pictures = [_world(lighting=light, exposure=0.5).sensors[1].render(0, 0.0, state) for light in ("all", "half")]

    bright, dim = (float(p.pixels.mean()) for p in pictures if isinstance(p, Image))
    assert dim < 0.95 * bright


def test_other_people_in_the_same_place_look_as_in_a_place_built_for_them() -> None:
    """What stands is built once; whoever moves is added for each run."""
    state = VehicleState(Pose2(1.2, 2.0, 0.3))
    extra = {"people": 5}

    _world(people=2)
    second = build_world("supermarket", WorldOptions(seed=8, sensors=("omni",), extra=extra)).sensors[0]
    supermarket._stage.cache_clear()
    alone = build_world("supermarket", WorldOptions(seed=8, sensors=("omni",), extra=extra)).sensors[0]

    pictures = [sensor.render(3, 0.2, state) for sensor in (second, alone)]
    assert isinstance(pictures[0], Image)
    assert isinstance(pictures[1], Image)
    np.testing.assert_array_equal(pictures[0].pixels, pictures[1].pixels)


def test_one_robot_carries_every_kind_of_sensor() -> None:
    names = ("wheels", "imu", "light", "floor", "laser", "front", "rgbd", "omni")
    whole = build_world("supermarket", WorldOptions(seed=3, sensors=names))
    state = VehicleState(whole.start)

    readings = {sensor.info.name: payload_kind(sensor.render(0, 0.0, state)) for sensor in whole.sensors}

    assert tuple(readings) == names
    assert set(readings.values()) == {"odometry", "imu", "scalar", "image", "scan", "rgbd"}
    assert {sensor.info.name: sensor.info.kind for sensor in whole.sensors} == readings


@pytest.fixture(scope="module")
def alike() -> World:
    return _world(alike=True, laser_m=4.0)


def _goods_before_shelf(world: World, x: float) -> np.ndarray:
    """Return the row of pixels that shows the middle boards of a shelf, from the aisle before it."""
    picture = world.sensors[1].render(0, 0.0, VehicleState(Pose2(x, 5.6, math.pi / 2)))
    assert isinstance(picture, Image)
    return picture.pixels[60:80, 140:180].astype(float)


def test_alike_shelves_hold_the_same_goods(world: World, alike: World) -> None:
    first, second = (_goods_before_shelf(alike, x) for x in (3.2, 7.0))
    one, other = (_goods_before_shelf(world, x) for x in (3.2, 7.0))

    assert np.abs(first - second).mean() < 0.5 * np.abs(one - other).mean()


def test_alike_shelves_have_signs_of_their_own_and_walls_are_bare(world: World, alike: World) -> None:
    plain, bare = (supermarket._stage(SupermarketOptions(alike=is_alike), 3, 1) for is_alike in (False, True))

    assert len(bare.kinds) == len(plain.kinds) - 10  # seven posters, two doors and a clock
    textures = [set(scene.surfaces["texture"].tolist()) for scene in (plain, bare)]
    assert len(textures[0]) - len(textures[1]) > 5 * 8  # each board of each side of five shelves had its own goods


def test_a_short_laser_reaches_no_farther_and_the_place_is_the_same(world: World, alike: World) -> None:
    state = VehicleState(Pose2(5.1, 5.6, 0.0))

    near, far = (one.sensors[0].render(0, 0.0, state).ranges_m for one in (alike, world))

    assert np.nanmax(near) <= 4.0 < np.nanmax(far)
    both = np.isfinite(near) & np.isfinite(far)
    np.testing.assert_array_equal(near[both], far[both])
