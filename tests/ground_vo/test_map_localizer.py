"""Teaching a path and coming back to it."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from trailmark.errors import ConfigError, StoreError
from trailmark.estimates import Belief, Fix, Lost
from trailmark.frames import Frame, Image, Scalar
from trailmark.geometry import Pose2, Pose3
from trailmark.interfaces import Session
from trailmark.paths import Keyframe
from trailmark.testing.ground import GroundCamera, MirroredFloor, ground_run
from trailmark_ground_vo.config import GroundMapConfig
from trailmark_ground_vo.map_localizer import GroundMap

WAY_M, STEP_M = 0.32, 0.004


@pytest.fixture(scope="module")
def camera():
    return GroundCamera((320, 288), (3.9e-4, 3.95e-4), mounting=Pose3(x=0.1, y=-0.03, yaw=-math.pi), noise_sigma=3.0)


def way(station_m):
    return Pose2.exp(station_m, 0.0, station_m / 1.5)


def taught(camera, ground, localizer_map, **keys):
    """Teach the way with true poses; returns the localizer."""
    localizer = GroundMap(GroundMapConfig(camera="floor", **keys))
    run = ground_run(lambda time_s: way(time_s), int(WAY_M / STEP_M), rate_hz=1 / STEP_M, ground=ground, camera=camera)
    localizer.start(Session(name="floor_map", mode="teach", sensors={"floor": run.sensor}, map=localizer_map))
    for index, frame in enumerate(run.frames):
        _, pose = run.truth[index]
        belief = Belief(frame.stamp_s, pose_map_base=pose, travelled_m=index * STEP_M)
        assert localizer.observe(frame, belief) == ()
    localizer.finish()
    return localizer


def replayed(camera, localizer_map, **keys):
    localizer = GroundMap(GroundMapConfig(camera="floor", **keys))
    sensors = {"floor": camera.sensor_info("floor")}
    localizer.start(Session(name="floor_map", mode="replay", sensors=sensors, map=localizer_map))
    return localizer


def seen_from(camera, ground, pose, stamp_s=1.0, seed=3):
    return Frame("floor", stamp_s, Image(camera.image(ground, pose, seed)))


def test_a_patch_is_registered_every_five_centimetres(camera, ground, localizer_map):
    localizer = taught(camera, ground, localizer_map)

    keyframes = localizer_map.keyframes()
    assert [round(keyframe.station_m, 3) for keyframe in keyframes] == [0.0, 0.052, 0.1, 0.152, 0.2, 0.252, 0.3]
    assert all(sum(array.nbytes for array in keyframe.arrays.values()) == 1936 for keyframe in keyframes)
    assert keyframes[2].pose_map_base.distance_to(way(0.1)) < 1e-9
    assert localizer.counters()["registered"] == 7


@pytest.mark.parametrize("search", ["exhaustive", "pyramid"])
def test_a_wrong_belief_is_corrected(search, camera, ground, localizer_map):
    taught(camera, ground, localizer_map)
    localizer = replayed(camera, localizer_map, search=search)
    errors = []
    for station_m in (0.01, 0.11, 0.16, 0.29):
        truth = way(station_m) @ Pose2(0.0, 0.004, math.radians(1.0))
        belief = truth @ Pose2(0.006, -0.005, math.radians(-1.5))
        said = localizer.observe(seen_from(camera, ground, truth, station_m), Belief(station_m, pose_map_base=belief))
        assert isinstance(said[0], Fix), said
        assert said[0].stamp_s == station_m
        errors.append(truth.between(said[0].pose_map_base).array())

    errors = np.abs(errors)
    assert errors[:, :2].max() < 0.35e-3  # the camera is 0.1 m ahead of base
    assert math.degrees(errors[:, 2].max()) < 0.25


def test_the_information_of_a_fix_lies_in_the_axes_of_the_map(camera, localizer_map):
    lines = np.random.default_rng(0).normal(128.0, 25.0, 512)
    texture = cv2.GaussianBlur(np.tile(lines, (512, 1)).astype(np.float32), (0, 0), 1.5)
    texture += cv2.GaussianBlur(np.random.default_rng(1).normal(0.0, 4.0, (512, 512)).astype(np.float32), (0, 0), 1.0)
    grain = MirroredFloor(np.clip(texture, 0, 255).astype(np.float32))  # known along x of the map, hardly along y
    localizer = GroundMap(GroundMapConfig(camera="floor"))
    sensors = {"floor": camera.sensor_info("floor")}
    localizer.start(Session(mode="teach", sensors=sensors, map=localizer_map))
    pose = Pose2(0.5, 0.2, 1.1)
    localizer.observe(seen_from(camera, grain, pose), Belief(0.0, pose_map_base=pose))

    localizer = replayed(camera, localizer_map, min_groups=1, tilt_deg=0.0)
    said = localizer.observe(seen_from(camera, grain, pose), Belief(0.0, pose_map_base=pose))

    assert isinstance(said[0], Fix)
    assert said[0].information[0, 0] > 3 * said[0].information[1, 1]


def test_each_patch_is_dealt_with_once_per_pass(camera, ground, localizer_map):
    taught(camera, ground, localizer_map)
    localizer = replayed(camera, localizer_map)
    fixes = []
    for index in range(50):
        pose = way(0.02 + 0.002 * index)
        fixes += localizer.observe(seen_from(camera, ground, pose, float(index)), Belief(index, pose_map_base=pose))

    assert len(fixes) == 3
    assert [round(fix.details["place"]) for fix in fixes] == [0, 1, 2]
    assert localizer.counters()["searched"] == 3


def test_away_from_every_place_nothing_is_searched(camera, ground, localizer_map):
    taught(camera, ground, localizer_map)
    localizer = replayed(camera, localizer_map)

    said = localizer.observe(
        seen_from(camera, ground, way(0.1)), Belief(0.0, pose_map_base=way(0.1) @ Pose2(0.0, 0.04, 0.0))
    )

    assert said == ()
    assert localizer.latency_s() == 0.0


def test_a_heading_beyond_the_search_is_not_searched(camera, ground, localizer_map):
    taught(camera, ground, localizer_map)

    turned = way(0.1) @ Pose2(0.0, 0.0, math.pi)

    assert (
        replayed(camera, localizer_map).observe(seen_from(camera, ground, turned), Belief(0.0, pose_map_base=turned))
        == ()
    )


def test_covered_ground_is_lost_tried_again_and_then_given_up(camera, ground, localizer_map):
    taught(camera, ground, localizer_map)
    localizer = replayed(camera, localizer_map, max_attempts=3)
    other = MirroredFloor.procedural(seed=77, size_px=512, grain_px=1.5)

    said = [
        localizer.observe(seen_from(camera, other, way(0.1), float(n), seed=n), Belief(n, pose_map_base=way(0.1)))
        for n in range(5)
    ]

    assert [len(answer) for answer in said] == [1, 1, 1, 0, 0]
    assert all(isinstance(answer[0], Lost) and "covered" in answer[0].reason for answer in said[:3])
    assert localizer.counters()["rejected"] == 3


def test_a_rejected_patch_is_found_when_the_cover_is_gone(camera, ground, localizer_map):
    taught(camera, ground, localizer_map)
    localizer = replayed(camera, localizer_map)
    other = MirroredFloor.procedural(seed=77, size_px=512, grain_px=1.5)

    first = localizer.observe(seen_from(camera, other, way(0.1)), Belief(0.0, pose_map_base=way(0.1)))
    second = localizer.observe(seen_from(camera, ground, way(0.104)), Belief(1.0, pose_map_base=way(0.104)))

    assert isinstance(first[0], Lost)
    assert isinstance(second[0], Fix)


@pytest.mark.parametrize("station_m", [0.013, 0.148, 0.26])
def test_it_finds_itself_anywhere_on_the_path(station_m, camera, ground, localizer_map):
    taught(camera, ground, localizer_map)
    localizer = replayed(camera, localizer_map, global_batch=2, search="pyramid")
    truth = way(station_m) @ Pose2(0.0, 0.003, math.radians(2.0))

    said = []
    for index in range(5):
        said += localizer.observe(seen_from(camera, ground, truth, float(index), seed=index), Belief(float(index)))
        if isinstance(said[-1], Fix):
            break

    assert isinstance(said[-1], Fix)
    assert truth.distance_to(said[-1].pose_map_base) < 0.15e-3
    assert all("start unknown" in lost.reason for lost in said[:-1])


def repeating(period_m: float) -> MirroredFloor:
    """A floor that is printed: the same every `period_m` along x."""
    once = MirroredFloor.procedural(seed=12, size_px=512, grain_px=1.5).texture[:, : round(period_m / 3.9e-4)]
    return MirroredFloor(np.tile(once, (1, 8)))


def drive_on(localizer, camera, ground, from_m, to_m):
    """Drive without a pose, told by odometry alone; returns what was said in each picture and where it was true."""
    said = []
    for index, x in enumerate(np.arange(from_m, to_m, 0.01)):
        truth = Pose2(float(x), 0.0, 0.0)
        belief = Belief(float(index), pose_odom_base=Pose2(float(x) - from_m, 0.0, 0.0), travelled_m=float(x) - from_m)
        said.append((truth, localizer.observe(seen_from(camera, ground, truth, float(index), seed=index), belief)[0]))
    return said


def taught_straight(camera, ground, localizer_map, way_m=0.55):
    localizer = GroundMap(GroundMapConfig(camera="floor"))
    localizer.start(Session(mode="teach", sensors={"floor": camera.sensor_info("floor")}, map=localizer_map))
    for index, x in enumerate(np.arange(0.0, way_m, 0.05)):
        pose = Pose2(float(x), 0.0, 0.0)
        belief = Belief(float(index), pose_map_base=pose, travelled_m=float(x))
        localizer.observe(seen_from(camera, ground, pose, float(index), seed=100 + index), belief)


@pytest.mark.parametrize(
    "period_m",
    [0.1, pytest.param(0.12, marks=pytest.mark.xfail(strict=True, reason="one of the places that look alike is told"))],
)
def test_where_the_floor_repeats_itself_it_does_not_guess(period_m, camera, localizer_map):
    ground = repeating(period_m)
    taught_straight(camera, ground, localizer_map, way_m=0.8)

    said = drive_on(replayed(camera, localizer_map, search="pyramid"), camera, ground, 0.22, 0.3)

    assert said
    assert all(isinstance(answer, Lost) for _, answer in said)


def test_driving_on_tells_two_places_apart(camera, localizer_map):
    once, other = (MirroredFloor.procedural(seed=seed, size_px=1024, grain_px=1.5).texture for seed in (12, 13))
    copy = round(0.3 / 3.9e-4)  # 0.1 and 0.4 m look alike; the ground ahead of them, which the camera sees first, not
    ground = MirroredFloor(np.hstack([once[:, :copy], once[:, : round(0.27 / 3.9e-4)], other]))
    taught_straight(camera, ground, localizer_map, way_m=0.8)

    said = drive_on(replayed(camera, localizer_map, search="pyramid"), camera, ground, 0.1, 0.4)

    first = next(index for index, (_, answer) in enumerate(said) if isinstance(answer, Fix))
    assert all("2 of 16 places may be this one" in lost.reason for _, lost in said[:first])
    assert 1 <= first <= 10
    assert said[first][0].distance_to(said[first][1].pose_map_base) < 0.3e-3


def test_a_way_to_confirm_is_waited_for(camera, ground, localizer_map):
    taught_straight(camera, ground, localizer_map, way_m=0.35)

    said = drive_on(replayed(camera, localizer_map, search="pyramid", confirm_m=0.1), camera, ground, 0.12, 0.3)

    first = next(index for index, (_, answer) in enumerate(said) if isinstance(answer, Fix))
    assert 10 <= first <= 12
    assert said[first][0].distance_to(said[first][1].pose_map_base) < 0.3e-3


def test_off_the_path_it_goes_on_saying_that_it_does_not_know(camera, localizer_map, ground):
    taught(camera, ground, localizer_map)
    localizer = replayed(camera, localizer_map, search="pyramid")
    other = MirroredFloor.procedural(seed=78, size_px=512, grain_px=1.5)

    for index in range(4):
        said = localizer.observe(seen_from(camera, other, way(0.1), float(index), seed=index), Belief(float(index)))
        assert isinstance(said[0], Lost)
    assert localizer.latency_s() == pytest.approx(7 * 1e-3)


def test_an_empty_store_is_nothing_to_search_in(camera, ground, localizer_map):
    assert replayed(camera, localizer_map).observe(seen_from(camera, ground, Pose2()), Belief(0.0)) == ()


def test_frames_of_other_sensors_are_not_looked_at(camera, localizer_map):
    assert replayed(camera, localizer_map).observe(Frame("light", 0.0, Scalar(1.0)), Belief(0.0)) == ()


def test_without_a_store_it_is_told_what_it_needs(camera):
    localizer = GroundMap(GroundMapConfig(camera="floor"))

    with pytest.raises(ConfigError, match="no path store; use `trailmark teach`"):
        localizer.start(Session(name="floor_map", sensors={"floor": camera.sensor_info("floor")}))


def test_a_store_taught_with_other_settings_is_refused(camera, ground, localizer_map):
    taught(camera, ground, localizer_map)

    with pytest.raises(StoreError, match=r"taught with high_pass = \[1\], but the config has \[0\]"):
        replayed(camera, localizer_map, high_pass=False)


def test_a_keyframe_without_a_patch_is_refused(camera, localizer_map):
    localizer_map.add(Keyframe(0.25, 0.0, Pose2(), {"patch": np.zeros((40, 40), np.uint8)}))

    with pytest.raises(StoreError, match=r"at 0\.250 m holds a patch of \(40, 40\) uint8 instead of \(44, 44\)"):
        replayed(camera, localizer_map)


def test_raw_intensities_and_whole_pixels_find_a_place_too(camera, ground, localizer_map):
    keys = {"high_pass": False, "refined": False, "min_groups": 4, "max_attempts": 1}
    taught(camera, ground, localizer_map, **keys)

    localizer, belief = replayed(camera, localizer_map, **keys), Belief(0.0, pose_map_base=way(0.104))
    said = localizer.observe(seen_from(camera, ground, way(0.1)), belief)

    assert isinstance(said[0], Fix)
    assert said[0].pose_map_base.distance_to(way(0.1)) < 1e-3


def test_closing_twice_is_fine(camera, localizer_map):
    localizer = replayed(replace(camera), localizer_map)

    localizer.close()
    localizer.close()


@pytest.mark.parametrize(("aside_m", "n_searched"), [((0.017, 0.017), 1), ((0.019, 0.019), 0)])
def test_a_patch_is_searched_for_within_twenty_five_millimetres(aside_m, n_searched, camera, ground, localizer_map):
    """Both lie in the square that the search covers, 24 and 27 mm away; the paper looks within 0.025 m."""
    teacher = taught_one_place(camera, ground, localizer_map)
    localizer = replayed(camera, localizer_map)

    localizer.observe(seen_from(camera, ground, way(0.0)), Belief(1.0, pose_map_base=Pose2(*aside_m, 0.0)))

    assert teacher.counters()["registered"] == 1
    assert localizer.counters()["searched"] == n_searched


def test_of_several_patches_within_reach_the_nearest_is_searched_for(camera, ground, localizer_map):
    taught(camera, ground, localizer_map, spacing_m=0.02)
    localizer = replayed(camera, localizer_map)
    pose = way(0.025)  # 25, 5 and 15 mm from the first three

    said = localizer.observe(seen_from(camera, ground, pose), Belief(1.0, pose_map_base=pose))

    assert [round(one.details["place"]) for one in said] == [1]


def taught_one_place(camera, ground, localizer_map):
    """Teach the start alone."""
    localizer = GroundMap(GroundMapConfig(camera="floor"))
    sensors = {"floor": camera.sensor_info("floor")}
    localizer.start(Session(name="floor_map", mode="teach", sensors=sensors, map=localizer_map))
    localizer.observe(seen_from(camera, ground, way(0.0), 0.0), Belief(0.0, pose_map_base=way(0.0)))
    localizer.finish()
    return localizer
