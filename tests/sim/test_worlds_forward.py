"""Corridor and street, and the camera that looks along them."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from trailmark.errors import ConfigError
from trailmark.frames import RGBD, DepthCamera, Image, Scan, payload_kind
from trailmark.geometry import Pose2, Pose3
from trailmark_sim.render.lenses import PinholeLens
from trailmark_sim.sensors.camera import CameraSensor
from trailmark_sim.sensors.shutter import Shaking
from trailmark_sim.sensors.true_depth import TrueDepthSensor
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds import WORLDS, build_world
from trailmark_sim.worlds.base import World, WorldOptions

NAMES = [name for name in ("corridor", "street") if name in WORLDS]


def _world(name: str, threads: int = 1, **extra: object) -> World:
    return build_world(name, WorldOptions(seed=5, sensors=("front",), threads=threads, extra=extra))


def _picture(world: World, pose: Pose2, k: int = 0, travelled_m: float = 0.0) -> npt.NDArray[np.uint8]:
    payload = world.sensors[0].render(k, k / 20.0, VehicleState(pose, travelled_m=travelled_m))
    assert isinstance(payload, Image)
    return payload.pixels


@pytest.mark.parametrize("name", NAMES)
def test_one_and_two_threads_give_the_same_bytes(name: str) -> None:
    one, two = (_picture(_world(name, threads, people=2), Pose2(1.0, 0.1, 0.05), 2) for threads in (1, 2))

    np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("name", NAMES)
def test_morning_and_afternoon_differ_in_light_and_not_in_place(name: str) -> None:
    morning, afternoon = (_world(name, time=time, noise=0, vibration_mrad=0) for time in ("morning", "afternoon"))
    pose = VehicleState(Pose2(2.0, 0.0, 0.0))

    views = [world.sensors[0].view(0.0, pose) for world in (morning, afternoon)]  # type: ignore[attr-defined]

    np.testing.assert_array_equal(views[0].ranges_m, views[1].ranges_m)
    light = [view.radiance().mean(axis=2) for view in views]
    ratio = light[1] / np.maximum(light[0], 1e-3)
    assert np.percentile(ratio, 95) > 1.5 * np.percentile(ratio, 5)


@pytest.mark.parametrize("season", [pytest.param("autumn", marks=pytest.mark.long), "winter"])
def test_seasons_change_what_grows_and_what_lies_about_but_not_the_houses(season: str) -> None:
    plain = {"noise": 0, "vibration_mrad": 0, "width_px": 160}
    summer, other = (_world("street", season=one, **plain) for one in ("summer", season))
    pose = VehicleState(Pose2(2.0, 0.0, 0.0))

    views = [world.sensors[0].view(0.0, pose) for world in (summer, other)]  # type: ignore[attr-defined]

    same_place = np.isclose(views[0].ranges_m, views[1].ranges_m)
    same_look = (np.abs(views[0].radiance() - views[1].radiance()) < 0.02).all(axis=2)
    half = len(same_look) // 2
    assert 0.9 < same_place.mean() < 1.0  # crowns of trees are thinner or gone
    assert same_look[:half].mean() > 0.8 > same_look[half:].mean()


def test_windows_of_the_corridor_are_too_bright_for_the_camera() -> None:
    picture = _picture(_world("corridor"), Pose2(0.0, 0.0, 0.0))

    assert (picture[:, :320] >= 250).all(axis=2).mean() > 0.02


def test_a_turn_of_five_degrees_shifts_the_picture_by_what_the_lens_says() -> None:
    world = _world("corridor", noise=0, vibration_mrad=0, blur_px=0)
    straight, turned = (_picture(world, Pose2(3.0, 0.0, yaw)).mean(axis=2) for yaw in (0.0, np.radians(2.0)))

    # Far things, in the middle, move to the right when the robot turns to the left.
    patch = straight[200:240, 300:340]
    scores = [np.abs(turned[200:240, 300 + d : 340 + d] - patch).mean() for d in range(40)]

    assert int(np.argmin(scores)) == pytest.approx(525.0 * np.tan(np.radians(2.0)), abs=1.0)


def test_the_floor_shakes_the_camera_at_the_same_places() -> None:
    shaking = Shaking(2e-3, 1e-3, 4)

    poses = [shaking.at(0.01 * n) for n in range(2000)]

    assert shaking.at(3.3) == shaking.at(3.3)
    assert np.std([pose.pitch for pose in poses]) == pytest.approx(2e-3, rel=0.2)
    assert np.std([pose.z for pose in poses]) == pytest.approx(1e-3, rel=0.2)
    assert Shaking().at(1.0) == Pose3()


@pytest.mark.parametrize("route", ["straight", "bends"])
@pytest.mark.parametrize("name", NAMES)
def test_the_route_is_free_and_walls_are_not(name: str, route: str) -> None:
    world = build_world(name, WorldOptions(sensors=("wheels",), route=route))
    chosen = next(iter(world.routes.values()))

    stations = np.linspace(0.0, chosen.length_m, 80)
    assert {world.collides(chosen.pose_at(float(s))) for s in stations} == {None}
    assert list(world.routes) == [route, *({"straight", "bends"} - {route})]
    assert world.collides(Pose2(5.0, 50.0, 0.0)) is not None


@pytest.mark.parametrize("name", NAMES)
def test_the_bends_turn_left_and_right_at_right_angles(name: str) -> None:
    world = build_world(name, WorldOptions(sensors=("wheels",), route="bends"))
    route = world.routes["bends"]
    headings = np.array([route.pose_at(s).theta for s in np.arange(0.0, route.length_m, 0.05)])

    assert route.length_m == pytest.approx(50.0, abs=0.5)
    assert headings.max() == pytest.approx(np.pi / 2, abs=1e-6)
    assert np.abs(headings[[0, -1]]).max() < 1e-6
    assert np.diff(headings).max() > 0.02 > np.abs(headings).min()
    # Between the wings stands a wall, between the legs a house.
    assert world.collides(Pose2(8.0, 10.0)) in {"a wall", "a house"}
    assert world.collides(Pose2(31.0, 3.0)) in {"a wall", "a house"}


@pytest.mark.parametrize("name", NAMES)
def test_the_camera_sees_structure_all_along_the_bends(name: str) -> None:
    options = WorldOptions(seed=5, sensors=("front",), route="bends", extra={"width_px": 160, "noise": 0})
    world = build_world(name, options)
    sensor, route = world.sensors[0], world.routes["bends"]
    assert isinstance(sensor, CameraSensor)

    for station_m in np.arange(0.0, route.length_m, 1.25):
        state = VehicleState(route.pose_at(float(station_m)), travelled_m=float(station_m))
        picture = _picture(world, state.pose_map_base, 1, float(station_m))[:, :, 1]
        view = sensor.view(0.0, state)
        nothing = view.table.picture(view.is_nothing.astype(np.float32), 0.0)
        assert not nothing[68:].any()  # 2 deg below the horizon there is ground everywhere
        assert name == "street" or not nothing.any()
        # Every column, down to a fifth of the picture's width, has something to hold on to.
        assert picture.reshape(120, 5, 32).std(axis=(0, 2)).min() > 8.0


@pytest.mark.parametrize("name", NAMES)
def test_a_wrong_option_names_the_world_and_the_nearest(name: str) -> None:
    with pytest.raises(ConfigError, match=rf"{name}.*peopel.*people"):
        _world(name, peopel=2)


def test_the_camera_runs_at_the_rate_of_the_paper() -> None:
    sensor = _world("corridor").sensors[0]

    assert isinstance(sensor, CameraSensor)
    assert sensor.rate_hz == 20.0
    assert sensor.info.size == (640, 480)


def test_a_smaller_picture_shows_the_same_view() -> None:
    full, small = (_world("street", noise=0, vibration_mrad=0, blur_px=0, width_px=w) for w in (640, 160))

    large, little = (_picture(world, Pose2(2.0, 0.0, 0.0)).astype(float) for world in (full, small))
    reduced = large.reshape(120, 4, 160, 4, 3).mean(axis=(1, 3))

    assert little.shape == (120, 160, 3)
    assert np.corrcoef(reduced.ravel(), little.ravel())[0, 1] > 0.97


def test_a_route_that_is_not_there_names_those_that_are() -> None:
    with pytest.raises(ConfigError, match=r"no route named 'bend'.*bends"):
        build_world("street", WorldOptions(route="bend"))


def test_depth_tells_where_every_pixel_of_another_picture_goes() -> None:
    """Half a metre further on and turned by 3 deg: the second picture, fetched by depth and poses, is the first."""
    extra = {"width_px": 320, "noise": 0, "vibration_mrad": 0, "blur_px": 0, "exposure": 1.0}
    world = build_world("corridor", WorldOptions(sensors=("front_depth", "front"), extra=extra))
    sensors = {sensor.info.name: sensor for sensor in world.sensors}
    info = sensors["front_depth"].info
    assert isinstance(info.calibration, DepthCamera)
    lens = PinholeLens(320, 240, info.calibration.colour)
    first, second = Pose2(3.0, 0.0, 0.0), Pose2(3.5, 0.02, np.radians(3.0))

    seen = sensors["front_depth"].render(0, 0.0, VehicleState(first))
    other = sensors["front"].render(0, 0.0, VehicleState(second))

    assert isinstance(seen, RGBD)
    assert isinstance(other, Image)
    rays = lens.directions()[0]
    points = (rays / rays[..., :1] * seen.depth_m[..., None]).reshape(-1, 3)
    pose_first, pose_second = (Pose3.from_planar(pose) @ info.pose_base_sensor for pose in (first, second))
    uv = lens.project((pose_second.inverse() @ pose_first).transform(points)).reshape(240, 320, 2).astype(np.float32)
    fetched = cv2.remap(other.pixels, uv[..., 0], uv[..., 1], cv2.INTER_LINEAR, borderValue=(0, 0, 0))
    inside = (uv >= 1).all(axis=2) & (uv <= (318, 238)).all(axis=2)
    error = np.abs(fetched.astype(float) - seen.bgr).mean(axis=2)[inside]
    assert inside.mean() > 0.6
    assert np.median(error) < 2.0  # grey levels; 14 for the picture as it stands
    assert np.isfinite(seen.depth_m).all()


def test_the_colour_of_the_depth_is_the_picture_of_the_camera() -> None:
    world = build_world("street", WorldOptions(sensors=("front_depth", "front"), extra={"width_px": 160, "noise": 0}))
    depth, front = (sensor.render(2, 0.1, VehicleState(Pose2(1.0))) for sensor in world.sensors)

    assert isinstance(depth, RGBD)
    assert isinstance(front, Image)
    np.testing.assert_array_equal(depth.bgr, front.pixels)
    assert np.isnan(depth.depth_m[:40]).any()  # the sky
    assert np.nanmin(depth.depth_m) > 0.5


def test_depth_needs_a_perspective_camera() -> None:
    world = build_world("supermarket", WorldOptions(sensors=("omni",)))
    omni = world.sensors[0]
    assert isinstance(omni, CameraSensor)

    with pytest.raises(ConfigError, match="perspective camera, which 'omni' is not"):
        TrueDepthSensor(omni)


def test_the_robot_of_the_street_carries_every_kind_of_sensor() -> None:
    names = ("wheels", "imu", "light", "floor", "laser", "front", "rgbd", "omni")
    whole = build_world("street", WorldOptions(seed=3, sensors=names, extra={"width_px": 160}))
    state = VehicleState(Pose2(16.0, 0.0, 0.0))

    readings = {sensor.info.name: sensor.render(0, 0.0, state) for sensor in whole.sensors}

    assert tuple(readings) == names
    assert {sensor.info.name: sensor.info.kind for sensor in whole.sensors} == {
        name: payload_kind(reading) for name, reading in readings.items()
    }
    scan, seen, floor = readings["laser"], readings["rgbd"], readings["floor"]
    assert isinstance(scan, Scan)
    assert isinstance(seen, RGBD)
    assert isinstance(floor, Image)
    assert np.isfinite(scan.ranges_m).sum() > 50  # houses, trees, cars, signs
    assert np.isfinite(seen.depth_m).mean() > 0.2
    assert floor.pixels.std() > 10.0


def test_the_ground_of_another_street_is_another() -> None:
    state = VehicleState(Pose2(1.0, 0.0, 0.0))

    here, there = (
        build_world("street", WorldOptions(seed=3, world_seed=seed, sensors=("floor",)))
        .sensors[0]
        .render(0, 0.0, state)
        for seed in (1, 2)
    )

    assert isinstance(here, Image)
    assert isinstance(there, Image)
    assert abs(np.corrcoef(here.pixels.ravel(), there.pixels.ravel())[0, 1]) < 0.5
