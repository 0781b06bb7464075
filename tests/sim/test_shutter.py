"""Rolling shutter and motion blur of the cameras that look at a scene."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from trailmark.errors import ConfigError
from trailmark.frames import Pinhole
from trailmark.geometry import Pose2, Pose3, Twist2
from trailmark_sim.render.bake import Lighting
from trailmark_sim.render.lenses import PinholeLens
from trailmark_sim.render.scene import Scene, SceneBuilder, Surface
from trailmark_sim.render.viewpoints import Moment, moments_between
from trailmark_sim.sensors.camera import CameraRig, CameraSensor
from trailmark_sim.sensors.shutter import Imaging, Shaking, Shutter, poses_after, viewpoints_after
from trailmark_sim.sensors.sight import Sight, pose_map_sensor
from trailmark_sim.stage import Stage
from trailmark_sim.vehicles import VehicleState
from trailmark_sim.worlds import build_world
from trailmark_sim.worlds.base import World, WorldOptions

LENS = PinholeLens(160, 120, Pinhole(130.0, 130.0, 79.5, 59.5))
NOTHING_MOVES = Moment(np.empty((0, 3, 3)), np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 4), np.float32))
ROLLING = Shutter(readout_s=0.05)
CAMERAS = [("corridor", "front"), ("corridor", "front_depth"), ("supermarket", "omni"), ("lab", "rgbd")]


@pytest.fixture(scope="module")
def wall() -> Scene:
    """Return a wall at x = 2 that is white left of y = 0 and dark right of it."""
    image = np.full((512, 512, 3), 30, np.uint8)
    image[:, :256] = 255
    builder = SceneBuilder(Lighting(ambient=(1.0, 1.0, 1.0)))
    look = Surface(builder.texture(image))
    builder.rectangle((2.0, 4.0, -4.0), (0.0, -8.0, 0.0), (0.0, 0.0, 8.0), look)
    return builder.build()


def _sight(scene: Scene, shutter: Shutter, threads: int = 1) -> Sight:
    stage = Stage(lambda: scene, lambda stamp_s, pose: NOTHING_MOVES, threads=threads)
    return Sight(stage, LENS, Pose3(), shutter=shutter)


def _light(sight: Sight, state: VehicleState) -> npt.NDArray[np.float64]:
    return sight.radiance(sight.view(1.0, state), 1.0, state)[..., 1].astype(float)


def _edges(light: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the column at which each row changes from light to dark [px]."""
    return np.asarray((light - light.min()).sum(axis=1) / np.ptp(light) - 0.5)


def test_an_edge_leans_by_the_turn_while_the_picture_is_read(wall: Scene) -> None:
    turning = VehicleState(twist=Twist2(yaw_radps=1.2))

    edges = _edges(_light(_sight(wall, ROLLING), turning))

    after_s = 0.05 * ((np.arange(120) + 0.5) / 120 - 0.5)
    np.testing.assert_allclose(edges, 79.5 + 130.0 * np.tan(1.2 * after_s), atol=0.05)  # px
    assert edges[-1] - edges[0] == pytest.approx(130.0 * 1.2 * 0.05 * 119 / 120, abs=0.1)


def test_an_edge_leans_by_the_way_while_the_picture_is_read(wall: Scene) -> None:
    going_left = VehicleState(twist=Twist2(left_mps=0.8))

    edges = _edges(_light(_sight(wall, ROLLING), going_left))

    after_s = 0.05 * ((np.arange(120) + 0.5) / 120 - 0.5)
    np.testing.assert_allclose(edges, 79.5 + 130.0 * 0.8 * after_s / 2.0, atol=0.05)


@pytest.mark.parametrize("yaw_radps", [0.4, 1.0])
def test_a_blurred_edge_is_as_wide_as_the_turn_while_it_exposes(wall: Scene, yaw_radps: float) -> None:
    turning = VehicleState(twist=Twist2(yaw_radps=yaw_radps))

    sharp, blurred = (
        -np.diff(_light(_sight(wall, shutter), turning)[55:65].mean(axis=0))[40:120]
        for shutter in (Shutter(), Shutter(exposure_s=0.06))
    )

    def variance(slope: npt.NDArray[np.float64]) -> float:
        u = np.arange(len(slope))
        middle = (slope * u).sum() / slope.sum()
        return float((slope * (u - middle) ** 2).sum() / slope.sum())

    width_px = 130.0 * yaw_radps * 0.06
    # A box of that width has a twelfth of its square as variance; it is sampled at most a pixel apart.
    assert variance(blurred) - variance(sharp) == pytest.approx(width_px**2 / 12.0, rel=0.06)
    assert blurred.max() == pytest.approx(blurred.sum() / width_px, rel=0.08)


def test_blur_and_rolling_shutter_come_together(wall: Scene) -> None:
    turning = VehicleState(twist=Twist2(yaw_radps=1.0))

    light = _light(_sight(wall, Shutter(0.03, 0.05)), turning)

    after_s = 0.05 * ((np.arange(120) + 0.5) / 120 - 0.5)
    np.testing.assert_allclose(_edges(light), 79.5 + 130.0 * np.tan(after_s), atol=0.06)


@pytest.mark.parametrize(("world", "sensor"), CAMERAS)
def test_a_still_camera_sees_the_same_to_the_byte(world: str, sensor: str) -> None:
    plain, slow = (_world(world, sensor, **times) for times in ({}, {"exposure_ms": 20, "readout_ms": 30}))
    state = VehicleState(plain.start, travelled_m=0.2)

    pictures = [_arrays(one.sensors[0].render(3, 1.0, state)) for one in (plain, slow)]

    for first, second in zip(*pictures, strict=True):
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize(("world", "sensor"), CAMERAS)
def test_one_and_two_threads_give_the_same_bytes(world: str, sensor: str) -> None:
    times = {"exposure_ms": 10, "readout_ms": 30, "people": 1}
    state = VehicleState(Pose2(1.0, 2.0, 0.1), Twist2(0.3, 0.0, 0.3), travelled_m=0.2)

    one, two = (_arrays(_world(world, sensor, n, **times).sensors[0].render(3, 1.0, state)) for n in (1, 2))

    for first, second in zip(one, two, strict=True):
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize(("world", "sensor"), CAMERAS)
def test_a_moving_camera_sees_something_else(world: str, sensor: str) -> None:
    worlds = [_world(world, sensor, **times) for times in ({}, {"exposure_ms": 20}, {"readout_ms": 30})]
    state = VehicleState(worlds[0].start, Twist2(0.3, 0.0, 1.2), travelled_m=0.2)

    sharp, blurred, leaning = (_arrays(one.sensors[0].render(3, 1.0, state))[0].astype(float) for one in worlds)

    for other in (blurred, leaning):
        assert 0.2 < np.abs(other - sharp).mean() < 25.0  # grey levels
    middle = slice(sharp.shape[0] // 2 - 1, sharp.shape[0] // 2 + 1)
    assert np.abs(leaning - sharp)[middle].mean() < np.abs(leaning - sharp).mean()


def test_people_move_while_the_picture_is_read() -> None:
    """The camera stands; only where somebody walks do the pictures differ."""
    plain, rolling = (_world("corridor", "front", people=2, noise=0, **t) for t in ({}, {"readout_ms": 45}))
    state = VehicleState(Pose2(1.0, 0.0))

    sharp, leaning = (one.sensors[0].render(0, 2.0, state).pixels.astype(float) for one in (plain, rolling))

    differs = np.abs(leaning - sharp).max(axis=2) > 12.0
    assert 0 < differs.sum() < 0.02 * differs.size


def test_the_depth_of_each_row_is_of_its_own_time() -> None:
    """Driving towards a wall: ranges of late rows are shorter by the way since."""
    builder = SceneBuilder(Lighting())
    builder.rectangle((2.0, 4.0, -4.0), (0.0, -8.0, 0.0), (0.0, 0.0, 8.0), Surface())
    driving = VehicleState(twist=Twist2(1.0))

    view = _sight(builder.build(), ROLLING).view(1.0, driving)

    depth = view.table.picture(view.ranges_m * view.table.rays[:, 0], np.nan)
    after_s = 0.05 * ((np.arange(120) + 0.5) / 120 - 0.5)
    np.testing.assert_allclose(depth, np.repeat((2.0 - after_s)[:, None], 160, axis=1), atol=2e-5)


def test_poses_follow_the_arc_of_the_twist() -> None:
    state = VehicleState(Pose2(1.0, -2.0, 0.7), Twist2(0.4, -0.2, 1.5))
    after_s = np.linspace(-0.2, 0.2, 9)

    poses = poses_after(state, after_s)

    expected = [(state.pose_map_base @ state.twist.after(float(t))).array() for t in after_s]
    np.testing.assert_allclose(poses, expected, atol=1e-12)


def test_viewpoints_are_the_poses_of_the_sensor_on_the_way() -> None:
    state = VehicleState(Pose2(1.0, -2.0, 0.7), Twist2(0.4, -0.2, 1.5), travelled_m=3.0)
    mounting, shaking = Pose3(0.2, 0.1, 0.5, 0.02, -0.03, 0.1), Shaking(2e-3, 1e-3, 4)
    after_s = np.linspace(-0.2, 0.2, 5)

    points = viewpoints_after(state, mounting, shaking, after_s)

    for n, t in enumerate(after_s.tolist()):
        way_m = 3.0 + np.hypot(0.4, 0.2) * t
        later = replace(state, pose_map_base=state.pose_map_base @ state.twist.after(t), travelled_m=way_m)
        pose = pose_map_sensor(later, mounting, shaking)
        np.testing.assert_allclose(points.rotations[n], pose.rotation(), atol=1e-12)
        np.testing.assert_allclose(points.eyes[n], (pose.x, pose.y, pose.z), atol=1e-12)


def test_between_two_moments_people_go_straight_on_and_turn_about_at_once() -> None:
    east, west = (np.diag([1.0, turn, turn])[None] for turn in (1.0, -1.0))
    first, second = (
        Moment(frame, np.array([[x, 0.0, 0.0]]), np.array([[x, 1.0, 0.0]]), np.array([[x, 0, 1, 1]], np.float32))
        for frame, x in ((east, 1.0), (west, 3.0))
    )

    moment = moments_between([first, second], np.array([0.0, 0.25, 0.75, 1.0]))

    np.testing.assert_allclose(moment.origins[:, 0, 0], [1.0, 1.5, 2.5, 3.0])
    np.testing.assert_allclose(moment.shadows[:, 0, 0], [1.0, 1.5, 2.5, 3.0])
    np.testing.assert_allclose(moment.frames[:, 0, 1, 1], [1.0, 1.0, -1.0, -1.0])
    assert moment.shadows.dtype == np.float32


@pytest.mark.parametrize("times", [{"exposure_s": -1e-3}, {"readout_s": -1e-3}, {"readout_s": float("nan")}])
def test_an_impossible_time_is_refused(times: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="time of 0 or more"):
        Shutter(**times)


@pytest.mark.parametrize(("times", "said"), [((0.06, 0.0), "exposes for 60 ms"), ((0.0, 0.06), "is read for 60 ms")])
def test_a_picture_must_be_done_before_the_next(wall: Scene, times: tuple[float, float], said: str) -> None:
    stage = Stage(lambda: wall, lambda stamp_s, pose: NOTHING_MOVES)

    with pytest.raises(ConfigError, match=f"'cam' {said}.* 20 Hz .* 50 ms"):
        CameraSensor("cam", CameraRig(LENS, Pose3(), 20.0), stage, imaging=Imaging(shutter=Shutter(*times)))


def _world(name: str, sensor: str, threads: int = 1, **extra: object) -> World:
    return build_world(name, WorldOptions(seed=5, sensors=(sensor,), threads=threads, extra=extra))


def _arrays(payload: Any) -> list[npt.NDArray[Any]]:
    return [payload.pixels] if hasattr(payload, "pixels") else [payload.bgr, payload.depth_m]
