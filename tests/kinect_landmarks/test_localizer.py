"""The localizers in a rendered room with exact truth, and on a real recording."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

import trailmark
from trailmark.errors import ConfigError, ShapeError, StoreError
from trailmark.estimates import Belief, Estimate, Fix, Lost, Motion
from trailmark.frames import RGBD, Frame, Image, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.testing import MemoryMap
from trailmark_kinect_landmarks.config import KinectFlowConfig, KinectLandmarksConfig
from trailmark_kinect_landmarks.flow import KinectFlow
from trailmark_kinect_landmarks.localizer import KinectLandmarks, KinectMotion

from .conftest import SENSORS, Drive, Room, arc


def _landmarks(**options: object) -> KinectLandmarks:
    return KinectLandmarks(KinectLandmarksConfig(camera="kinect", **options))


def _misses(answers: list[Estimate], poses: list[Pose2]) -> np.ndarray:
    """Distance and turn of every fix from the truth [m, rad]."""
    rows = [
        (fix.pose_map_base.distance_to(pose), abs(pose.between(fix.pose_map_base).theta))
        for fix, pose in ((answer, poses[round(answer.stamp_s * 30)]) for answer in answers)
        if isinstance(fix, Fix)
    ]
    return np.array(rows).reshape(-1, 2)


@pytest.mark.parametrize("solve", ["plane", "space"])
def test_a_drive_through_a_room_is_known_to_a_centimetre(drive: Drive, solve: str) -> None:
    poses = arc(40)

    answers = drive(_landmarks(solve=solve), poses)

    misses = _misses(answers, poses)
    assert len(misses) == len(poses) - 1
    assert math.sqrt((misses[:, 0] ** 2).mean()) < 0.01  # 1 cm
    assert math.degrees(math.sqrt((misses[:, 1] ** 2).mean())) < 0.3


@pytest.mark.parametrize("options", [{"point": "centre"}, {"refind": "look"}, {"angles": "linear"}, {"adapt": False}])
def test_the_paper_s_own_choices_find_the_way_too(drive: Drive, options: dict[str, object]) -> None:
    poses = arc(20)

    misses = _misses(drive(_landmarks(**options), poses), poses)

    assert len(misses) >= 0.9 * (len(poses) - 1)
    assert misses[:, 0].max() < 0.10  # 10 cm: centres of blobs move with their outline


def test_the_answer_carries_the_paper_s_numbers(drive: Drive) -> None:
    poses = arc(10)

    fix = drive(_landmarks(), poses)[-1]

    assert isinstance(fix, Fix)
    d = fix.details
    assert d["AB"] == pytest.approx(math.hypot(d["dx_B"] - d["dx_A"], d["dV_A"] - d["dV_B"]))
    assert d["Dir"] == pytest.approx(d["dV_A"] - d["dV_B"])
    assert d["omega"] == pytest.approx(math.atan(abs(d["Dir"]) / (d["dx_B"] - d["dx_A"])))
    assert d["dx_A"] == pytest.approx(d["dM_A"] * math.tan(d["alpha_A"]))
    assert d["dy_B"] == pytest.approx(d["dV_B"] * math.tan(d["beta_B"]))
    assert d["epsilon"] == pytest.approx(math.hypot(d["epsilon_x"], d["epsilon_y"]))
    assert d["epsilon"] == pytest.approx(math.hypot(poses[-1].x, poses[-1].y), abs=0.02)


def test_motions_add_up_to_the_way(drive: Drive) -> None:
    poses = arc(15)
    pose = poses[0]

    answers = drive(KinectMotion(KinectLandmarksConfig(camera="kinect")), poses)

    for before, after in itertools.pairwise(answers):
        assert isinstance(before, Motion)
        assert isinstance(after, Motion)
        assert after.since_s == before.stamp_s
    for motion in answers:
        assert isinstance(motion, Motion)
        pose = pose @ motion.pose_since_now
    assert pose.distance_to(poses[-1]) < 0.02


def test_light_switched_down_to_a_fifth_is_lived_through(drive: Drive) -> None:
    poses = arc(30)

    answers = drive(_landmarks(light="light"), poses, light=lambda i: 1.0 if i < 12 else 0.2)

    misses = _misses(answers, poses)
    assert len(misses) >= 0.9 * (len(poses) - 1)
    assert misses[:, 0].max() < 0.05


def test_a_box_that_is_carried_away_moves_the_robot_nowhere(drive: Drive) -> None:
    poses = arc(30)
    localizer = _landmarks()

    answers = drive(localizer, poses, box_left_m=lambda i: 0.0 if i < 6 else 0.02 * (i - 6))

    assert _misses(answers, poses)[:, 0].max() < 0.02
    assert localizer.counters()["moved"] > 0


def test_a_taught_place_is_found_again_without_a_start_pose(drive: Drive) -> None:
    localizer_map, poses = MemoryMap(), arc(20)
    teacher = _landmarks()
    drive(teacher, poses, mode="teach", map=localizer_map)
    teacher.finish()
    first = localizer_map.load("map")
    teacher.finish()  # may be repeated
    later = [Pose2(0.05 + 0.01 * i, 0.1, 0.05) for i in range(8)]

    answers = drive(_landmarks(), later, mode="replay", map=localizer_map, start_pose=None)

    misses = _misses(answers, later)
    assert len(misses) >= 7
    assert misses[:, 0].max() < 0.03
    assert first is not None
    np.testing.assert_array_equal(first["points"], localizer_map.load("map")["points"])  # type: ignore[index]


def test_a_wrong_start_pose_in_a_taught_place_is_overruled(drive: Drive) -> None:
    localizer_map, poses = MemoryMap(), arc(8)
    teacher = _landmarks(solve="plane")
    drive(teacher, poses, mode="teach", map=localizer_map)
    teacher.finish()

    answers = drive(_landmarks(solve="plane"), poses, mode="replay", map=localizer_map, start_pose=Pose2(0.0, 3.0, 1.0))

    misses = _misses(answers, poses)
    assert len(misses) >= 6
    assert misses[-1, 0] < 0.03


def test_a_map_that_lacks_arrays_is_refused(drive: Drive) -> None:
    localizer_map = MemoryMap()
    localizer_map.save("map", {"points": np.zeros((2, 3)), "light": np.ones(1)})

    with pytest.raises(StoreError, match=r"lack cov.*teach the place again"):
        drive(_landmarks(), arc(2), mode="replay", map=localizer_map)


def test_without_a_start_pose_or_a_map_it_cannot_say(drive: Drive) -> None:
    answers = drive(_landmarks(), arc(2), start_pose=None)

    assert [answer.reason for answer in answers if isinstance(answer, Lost)] == [
        "no start pose, and no map of this place"
    ] * 2


@pytest.mark.parametrize("depth_m", [2.0, np.nan])
def test_a_blank_wall_and_missing_depth_are_lost_with_a_reason(depth_m: float) -> None:
    localizer = _landmarks()
    localizer.start(Session(sensors=SENSORS, start_pose=Pose2()))
    blank = RGBD(np.full((480, 640, 3), 120, np.uint8), np.full((480, 640), depth_m, np.float32))

    (answer,) = localizer.observe(Frame("kinect", 0.0, blank), Belief(0.0, Pose2()))

    assert isinstance(answer, Lost)
    assert answer.reason == "0 landmarks with depth, 3 are needed"


@pytest.mark.parametrize("factor", [5.0, 0.1, 1000.0, 0.001])
@pytest.mark.parametrize("plugin", ["kinect_landmarks", "kinect_flow"])
def test_a_wrong_depth_factor_is_said_even_where_no_pose_is_found(
    room: Room, caplog: pytest.LogCaptureFixture, plugin: str, factor: float
) -> None:
    localizer = trailmark.create("localizer", plugin, camera="kinect")
    localizer.start(Session(sensors=SENSORS, start_pose=Pose2()))

    for i, pose in enumerate(arc(31)):
        seen = room.look(pose)
        frame = Frame("kinect", i / 30.0, RGBD(seen.bgr, seen.depth_m * np.float32(factor)))
        localizer.observe(frame, Belief(i / 30.0, Pose2()))

    assert "look at the source's 'depth_factor'" in caplog.text


def test_a_covered_camera_is_lost_and_found_again(room: Room) -> None:
    localizer = _landmarks()
    localizer.start(Session(sensors=SENSORS, start_pose=Pose2(), rng=np.random.default_rng(7)))
    dark = RGBD(np.zeros((480, 640, 3), np.uint8), np.full((480, 640), np.nan, np.float32))
    answers: list[Estimate] = []

    for i in range(12):
        payload = dark if 4 <= i < 8 else room.look(Pose2(0.01 * i))
        answers += localizer.observe(Frame("kinect", i / 30.0, payload), Belief(i / 30.0, Pose2()))

    assert [type(answer) for answer in answers] == [Fix] * 3 + [Lost] * 4 + [Fix] * 4
    assert isinstance(answers[-1], Fix)
    assert answers[-1].pose_map_base.distance_to(Pose2(0.11)) < 0.02


def test_other_payloads_are_refused() -> None:
    localizer = _landmarks()
    localizer.start(Session(sensors=SENSORS))

    with pytest.raises(ShapeError, match="takes rgbd, but 'kinect' gave Image"):
        localizer.observe(Frame("kinect", 0.0, Image(np.zeros((4, 4), np.uint8))), Belief(0.0))


def test_depth_of_another_size_needs_a_calibration(room: Room) -> None:
    localizer = _landmarks()
    localizer.start(Session(sensors={"kinect": SensorInfo("kinect", "rgbd")}, start_pose=Pose2()))
    seen = room.look(Pose2())

    with pytest.raises(ConfigError, match="depth has 320 x 240 px and colour 640 x 480; give the calibration"):
        localizer.observe(Frame("kinect", 0.0, RGBD(seen.bgr, seen.depth_m[::2, ::2])), Belief(0.0, Pose2()))


def test_near_beyond_far_is_refused() -> None:
    with pytest.raises(ValueError, match=r"near_m \(7\) must be less than far_m \(6\)"):
        KinectLandmarksConfig(camera="kinect", near_m=7.0)


def test_six_stage_pictures_are_written(drive: Drive, tmp_path: Path) -> None:
    drive(_landmarks(debug_images=tmp_path / "stages"), arc(3))

    names = sorted(path.name for path in (tmp_path / "stages").iterdir())
    assert len(names) == 12  # the first picture is remembered, the others are answered
    assert names[5] == "000000_6_angles.png"
    assert cv2.imread(str(tmp_path / "stages" / names[5])).shape == (480, 640, 3)


def test_the_same_run_gives_the_same_numbers(drive: Drive) -> None:
    first, second = (drive(_landmarks(), arc(8)) for _ in range(2))

    assert [a.pose_map_base for a in first if isinstance(a, Fix)] == [
        b.pose_map_base for b in second if isinstance(b, Fix)
    ]


@pytest.mark.parametrize("solve", ["plane", "space"])
def test_optical_flow_gives_the_motion(drive: Drive, solve: str) -> None:
    poses = arc(20)
    pose = poses[0]

    for motion in drive(KinectFlow(KinectFlowConfig(camera="kinect", solve=solve)), poses):
        assert isinstance(motion, Motion)
        pose = pose @ motion.pose_since_now

    assert pose.distance_to(poses[-1]) < 0.01


def test_optical_flow_sets_a_moving_box_aside(drive: Drive) -> None:
    poses = [Pose2()] * 15
    pose = Pose2()

    answers = drive(KinectFlow(KinectFlowConfig(camera="kinect")), poses, box_left_m=lambda i: 0.02 * i)

    for motion in answers:
        assert isinstance(motion, Motion)
        pose = pose @ motion.pose_since_now
    assert pose.distance_to(Pose2()) < 0.01


def test_optical_flow_is_not_carried_along_by_a_box_that_walks_off_on_the_way(drive: Drive) -> None:
    poses = [Pose2(0.01 * i) for i in range(40)]
    pose = poses[0]

    carried = drive(KinectFlow(KinectFlowConfig(camera="kinect")), poses, box_left_m=lambda i: 0.02 * max(0, i - 10))

    for motion in carried:
        assert isinstance(motion, Motion)
        pose = pose @ motion.pose_since_now
    assert pose.distance_to(poses[-1]) < 0.02


def test_two_landmarks_and_one_in_reserve_hold_the_pose(drive: Drive) -> None:
    config = KinectLandmarksConfig(camera="kinect", solve="plane", landmarks=3, min_landmarks=2, adapt=False)
    poses = arc(40)

    answers = drive(KinectLandmarks(config), poses)

    fixes = [answer for answer in answers if isinstance(answer, Fix)]
    assert len(fixes) >= 0.9 * (len(poses) - 1)
    assert max(fix.details["n_agree"] for fix in fixes) <= 3
    true = {i / 30.0: pose for i, pose in enumerate(poses)}
    assert max(fix.pose_map_base.distance_to(true[fix.stamp_s]) for fix in fixes) < 0.1


@pytest.mark.parametrize("step_m", [0.01, -0.02])
def test_two_landmarks_and_one_in_reserve_do_not_go_with_a_box(drive: Drive, step_m: float) -> None:
    config = KinectLandmarksConfig(camera="kinect", solve="plane", landmarks=3, min_landmarks=2, adapt=False)
    poses = arc(40)

    answers = drive(KinectLandmarks(config), poses, box_left_m=lambda i: step_m * max(0, i - 6))

    misses = _misses(answers, poses)
    assert len(misses) >= 0.9 * (len(poses) - 1)
    assert misses[:, 0].max() < 0.1  # 10 cm


def test_two_landmarks_and_one_in_reserve_notice_a_camera_that_tilts(
    drive: Drive, caplog: pytest.LogCaptureFixture
) -> None:
    config = KinectLandmarksConfig(camera="kinect", solve="plane", landmarks=3, min_landmarks=2, adapt=False)
    poses = arc(40)

    answers = drive(
        KinectLandmarks(config), poses, tilt_rad=lambda i: (0.12 * math.sin(0.1 * i), 0.12 * math.sin(0.13 * i))
    )

    misses = _misses(answers, poses)
    assert len(misses) >= 0.9 * (len(poses) - 1)
    assert misses[:, 0].max() < 0.05
    assert "the camera 'kinect' tilts" in caplog.text


@pytest.mark.data
@pytest.mark.parametrize("plugin", ["kinect_landmarks", "kinect_flow"])
def test_a_real_hand_held_recording_is_tracked(data_folder: Path, plugin: str) -> None:
    import trailmark
    from trailmark.evaluation import evaluate
    from trailmark.geometry import Trajectory

    source = trailmark.create("source", "tum_rgbd", path=data_folder / "rgbd" / "fr1_rpy_0_5s")
    source.start(Session(name="rgbd"))
    localizer = trailmark.create("localizer", plugin, camera="rgbd")
    localizer.start(Session(sensors=source.sensors, start_pose=Pose2(), rng=np.random.default_rng(0)))
    poses = [(0.0, Pose2())][:0]
    pose, n = Pose2(), 0
    for frame in source.frames():
        n += 1
        for answer in localizer.observe(frame, Belief(frame.stamp_s, pose)):
            if isinstance(answer, Fix | Motion):
                pose = answer.pose_map_base if isinstance(answer, Fix) else pose @ answer.pose_since_now
                poses.append((frame.stamp_s, pose))
    evaluation = evaluate(Trajectory.from_poses(poses), source.ground_truth())

    one_second = next(error for error in evaluation.relative if error.unit == "s")
    assert len(poses) >= 0.9 * n
    assert evaluation.absolute.position.rmse <= 0.11
    assert one_second.position.rmse <= 0.14


def _first_seen(room: Room, localizer_map: MemoryMap, **keys: object) -> Estimate:
    """Return what is said of the first picture of a robot that is told where it is by a `start_pose` alone."""
    start_pose, box_left_m = keys.pop("start_pose", None), keys.pop("box_left_m", 0.0)
    localizer = _landmarks(**keys)
    rng = np.random.default_rng(3)
    localizer.start(Session(sensors=SENSORS, mode="replay", map=localizer_map, start_pose=start_pose, rng=rng))  # type: ignore[arg-type]
    (answer,) = localizer.observe(
        Frame("kinect", 0.0, room.look(Pose2(0.05, 0.1, 0.05), box_left_m=box_left_m)), Belief(0.0)
    )  # type: ignore[arg-type]
    return answer


def test_a_room_of_the_same_plan_is_not_taken_for_the_taught_one(drive: Drive, room: Room) -> None:
    localizer_map = MemoryMap()
    teacher = _landmarks()
    drive(teacher, arc(12), mode="teach", map=localizer_map)
    teacher.finish()

    own = _first_seen(room, localizer_map)
    elsewhere = [_first_seen(Room(seed), localizer_map) for seed in (11, 12, 13)]

    assert isinstance(own, Fix)
    assert all(isinstance(answer, Lost) for answer in elsewhere)


@pytest.fixture(scope="module")
def taught_room(room: Room) -> MemoryMap:
    """Return what a localizer keeps that was taught on a plane."""
    localizer_map, teacher = MemoryMap(), _landmarks(solve="plane")
    poses = arc(12)
    session = Session(
        sensors=SENSORS, start_pose=poses[0], mode="teach", map=localizer_map, rng=np.random.default_rng(7)
    )
    teacher.start(session)
    for i, pose in enumerate(poses):
        teacher.observe(Frame("kinect", i / 30.0, room.look(pose)), Belief(i / 30.0, poses[0]))
    teacher.finish()
    return localizer_map


def test_few_landmarks_that_agree_are_another_place_for_all_that_is_known(taught_room: MemoryMap, room: Room) -> None:
    doubted = _first_seen(room, taught_room, min_agreeing=60)

    assert isinstance(doubted, Lost)
    assert "landmarks agree on a place, 60 are needed" in doubted.reason


def test_a_known_start_is_not_doubted(taught_room: MemoryMap, room: Room) -> None:
    few = {"solve": "plane", "min_agreeing": 60}

    doubted = _first_seen(room, taught_room, **few)
    told = _first_seen(room, taught_room, start_pose=Pose2(0.05, 0.1, 0.05), **few)
    wrongly_told = _first_seen(room, taught_room, start_pose=Pose2(0.0, 3.0, 1.0), **few)

    assert isinstance(doubted, Lost)
    assert isinstance(told, Fix)
    assert told.pose_map_base.distance_to(Pose2(0.05, 0.1, 0.05)) < 0.03
    assert isinstance(wrongly_told, Lost)


def test_no_more_landmarks_may_be_asked_to_agree_than_are_followed() -> None:
    with pytest.raises(ValueError, match=r"min_agreeing \(61\).* 60,.*landmarks \(60\)"):
        KinectLandmarksConfig(camera="kinect", min_agreeing=61)
    with pytest.raises(ValueError, match=r"min_agreeing \(29\).* 28,.*landmarks \(8\)"):
        KinectLandmarksConfig(camera="kinect", landmarks=8, min_agreeing=29)

    assert KinectLandmarksConfig(camera="kinect", landmarks=8).n_followed == 28


def test_of_eight_landmarks_those_that_are_followed_beside_them_count_too(taught_room: MemoryMap, room: Room) -> None:
    assert isinstance(_first_seen(room, taught_room, solve="plane", landmarks=8), Fix)


def test_a_room_with_other_boards_between_the_same_is_another_place(taught_room: MemoryMap, room: Room) -> None:
    twin = Room()
    other = Room(seed=99)
    for first in range(0, twin._wall.shape[1], 200):  # two thirds of the boards are others
        twin._wall[:, first : first + 130] = other._wall[:, first : first + 130]

    own = _first_seen(room, taught_room, min_agreeing=3)
    by_landmarks = _first_seen(twin, taught_room, min_agreeing=3, place_alike=0.0)
    doubted = _first_seen(twin, taught_room, min_agreeing=3)

    assert isinstance(own, Fix)
    assert isinstance(by_landmarks, Fix)
    assert isinstance(doubted, Lost)
    assert "it may be another place" in doubted.reason


def test_a_crate_before_the_boards_makes_no_other_place(taught_room: MemoryMap, room: Room) -> None:
    hidden = _first_seen(room, taught_room, box_left_m=0.5)

    assert isinstance(hidden, Fix)
