"""Laboratory and hallway, and the colour and depth camera in them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.frames import RGBD, DepthCamera
from trailmark.geometry import Pose2
from trailmark_sim.sensors.rgbd import RgbdSensor
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds import build_world
from trailmark_sim.worlds.base import World, WorldOptions


def _world(name: str = "hallway", threads: int = 1, **extra: object) -> World:
    return build_world(name, WorldOptions(seed=5, sensors=("rgbd",), threads=threads, extra=extra))


def _frame(world: World, pose: Pose2, k: int = 0) -> RGBD:
    payload = world.sensors[0].render(k, k / 30.0, VehicleState(pose))
    assert isinstance(payload, RGBD)
    return payload


@pytest.fixture(scope="module")
def hallway() -> World:
    return _world(depth_noise=0)


def test_depth_of_a_wall_ahead_is_its_distance_along_the_axis(hallway: World) -> None:
    depth = _frame(hallway, Pose2(8.0, 0.0, 0.0)).depth_m

    wall = depth[150:180, 280:330]  # beside the poster on the wall at x = 13
    assert np.isfinite(wall).mean() > 0.98
    np.testing.assert_allclose(np.nanmedian(wall), 13.0 - 8.2, atol=0.007)  # a poster is 6 mm before the wall
    assert np.nanstd(wall) < 0.004


def test_depth_of_the_floor_follows_from_the_height_of_the_camera(hallway: World) -> None:
    depth = _frame(hallway, Pose2(0.0, 0.0, 0.0)).depth_m
    rows = np.arange(400, 480)

    expected = 0.6 * 585.0 / (rows - 239.5)

    np.testing.assert_allclose(np.nanmedian(depth[400:480, 300:340], axis=1), expected, atol=1e-3)


def test_the_noise_of_depth_grows_with_its_square() -> None:
    world = _world()
    walls = {}
    for x in (8.0, 11.0):
        frames = [_frame(world, Pose2(x, 0.0, 0.0), k).depth_m[100:140, 60:110] for k in range(2)]
        walls[x] = float(np.nanstd(frames[0] - frames[1]))
    near_m, far_m = 13.0 - 11.2, 13.0 - 8.2

    assert walls[8.0] / walls[11.0] == pytest.approx((far_m / near_m) ** 2, rel=0.35)


def test_steel_and_glass_leave_holes(hallway: World) -> None:
    depth = _frame(hallway, Pose2(9.5, -0.6, math.radians(-8))).depth_m
    band = depth[200:330]  # the steel bin stands ahead
    unseen = np.isnan(band).mean(axis=0)

    assert (unseen > 0.9).sum() > 20


def test_something_near_shades_what_the_projector_would_light(hallway: World) -> None:
    depth = _frame(hallway, Pose2(1.4, 0.9, 0.0)).depth_m
    row = depth[300]
    edges = np.flatnonzero(np.diff(np.nan_to_num(row, nan=-1.0)) < -1.0)

    assert len(edges) > 0
    assert np.isnan(row).sum() > 5


def test_registered_depth_covers_less_than_the_colour_picture() -> None:
    world = _world(registered=True, depth_noise=0)
    depth = _frame(world, Pose2(8.0, 0.0, 0.0)).depth_m

    assert np.isnan(depth[:, :20]).all()
    assert np.isnan(depth[:20]).all()
    assert np.isfinite(depth[150:180, 280:330]).mean() > 0.98
    assert isinstance(world.sensors[0].info.calibration, DepthCamera)
    assert world.sensors[0].info.calibration.depth is None


def test_colour_and_depth_do_not_depend_on_the_number_of_threads() -> None:
    one, two = (_frame(_world("lab", threads, people=1), Pose2(2.0, 2.6, 0.2), 3) for threads in (1, 2))

    np.testing.assert_array_equal(one.bgr, two.bgr)
    np.testing.assert_array_equal(one.depth_m, two.depth_m)


def test_less_light_makes_a_fixed_exposure_darker_and_the_light_sensor_tells() -> None:
    pose = Pose2(1.0, 0.0, 0.0)
    bright, dim = (_frame(_world(light_level=level, exposure=0.4), pose).bgr.mean() for level in (1.0, 0.4))
    sensors = (
        build_world("hallway", WorldOptions(sensors=("light",), extra={"light_level": level})).sensors[0]
        for level in (1.0, 0.4)
    )
    readings = [sensor.render(0, 0.0, VehicleState(pose)) for sensor in sensors]

    assert dim < 0.75 * bright
    assert readings[1].value == pytest.approx(0.4 * readings[0].value, rel=0.1)  # type: ignore[union-attr]


@pytest.mark.parametrize("name", ["lab", "hallway"])
def test_routes_are_free(name: str) -> None:
    world = build_world(name, WorldOptions(sensors=("wheels",)))

    for route in world.routes.values():
        stations = np.linspace(0.0, route.length_m, 80)
        assert {world.collides(route.pose_at(float(s))) for s in stations} == {None}


def test_the_rate_can_be_chosen() -> None:
    world = build_world("lab", WorldOptions(sensors=("rgbd",), rates_hz={"rgbd": 10.0}))

    assert isinstance(world.sensors[0], RgbdSensor)
    assert world.sensors[0].rate_hz == world.sensors[0].info.rate_hz == 10.0
