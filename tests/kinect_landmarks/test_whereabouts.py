"""A camera that has lost its pose is not taken to a place that only looks alike."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Belief, Estimate, Fix, Lost
from trailmark.frames import RGBD, Frame
from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark.testing import MemoryMap
from trailmark_kinect_landmarks.config import KinectLandmarksConfig
from trailmark_kinect_landmarks.localizer import KinectLandmarks
from trailmark_kinect_landmarks.whereabouts import Whereabouts, is_in_reach, restart_covariance

from .conftest import SENSORS, Room, arc

_DARK = RGBD(np.zeros((480, 640, 3), np.uint8), np.full((480, 640), np.nan, np.float32))
_COVERED_S = 1.5
_HERE = Pose2(0.05, 0.1, 0.05)


@pytest.fixture(scope="module")
def taught(room: Room) -> MemoryMap:
    localizer_map, teacher, poses = MemoryMap(), KinectLandmarks(KinectLandmarksConfig(camera="kinect")), arc(12)
    rng = np.random.default_rng(7)
    teacher.start(Session(sensors=SENSORS, start_pose=poses[0], mode="teach", map=localizer_map, rng=rng))
    for i, pose in enumerate(poses):
        teacher.observe(Frame("kinect", i / 30.0, room.look(pose)), Belief(i / 30.0, pose))
    teacher.finish()
    return localizer_map


def _after_a_gap(
    room: Room,
    localizer_map: MemoryMap | None,
    *,
    way_m: float = 0.0,
    seen_from: Pose2 = _HERE,
    motion_age_s: float = 0.0,
    start: Pose2 | None = None,
    later: Room | None = None,
) -> Estimate:
    """Return what is said of the first picture after the camera was covered while wheels went ahead."""
    localizer = KinectLandmarks(KinectLandmarksConfig(camera="kinect"))
    rng, mode = np.random.default_rng(3), "track" if localizer_map is None else "replay"
    localizer.start(Session(sensors=SENSORS, mode=mode, map=localizer_map, start_pose=start, rng=rng))
    before = Belief(0.0, start, motion_age_s=motion_age_s)
    for i in range(6):
        localizer.observe(Frame("kinect", i / 30.0, room.look(_HERE)), before)
    stamp_s = 5 / 30.0 + _COVERED_S
    localizer.observe(Frame("kinect", 6 / 30.0, _DARK), before)
    after = Belief(
        stamp_s,
        start,
        pose_odom_base=Pose2(way_m),
        travelled_m=way_m,
        motion_age_s=motion_age_s,
    )
    (answer,) = localizer.observe(Frame("kinect", stamp_s, (later or room).look(seen_from)), after)
    return answer


@pytest.mark.parametrize("is_taught", [True, False])
def test_a_place_that_motions_do_not_lead_to_only_looks_alike(room: Room, taught: MemoryMap, is_taught: bool) -> None:
    answer = _after_a_gap(room, taught if is_taught else None, way_m=4.0, start=None if is_taught else _HERE)

    assert isinstance(answer, Lost)
    assert "from where motions lead: it may be another that looks alike" in answer.reason


def test_a_place_that_motions_lead_to_is_found_again(room: Room, taught: MemoryMap) -> None:
    there = Pose2(0.25, 0.1, 0.05)

    answer = _after_a_gap(room, taught, way_m=0.2, seen_from=there)

    assert isinstance(answer, Fix)
    assert answer.pose_map_base.distance_to(there) < 0.03


@pytest.mark.parametrize("is_taught", [True, False])
def test_a_robot_that_was_carried_off_while_it_stood_is_found(room: Room, taught: MemoryMap, is_taught: bool) -> None:
    there = Pose2(0.05, 0.9, 0.05)

    answer = _after_a_gap(room, taught if is_taught else None, seen_from=there, start=None if is_taught else _HERE)

    assert isinstance(answer, Fix)
    assert answer.pose_map_base.distance_to(there) < 0.05


@pytest.mark.parametrize("way_m", [0.0, 0.2])
def test_landmarks_are_remembered_anew_but_where_the_camera_is_proved_not_to_be(room: Room, way_m: float) -> None:
    answer = _after_a_gap(room, None, start=_HERE, way_m=way_m, later=Room(seed=11))  # other boards on the same wall

    assert isinstance(answer, Lost)
    assert ("remembers anew" in answer.reason) == (way_m > 0.0)  # after a way nobody knows which boards it should see


def test_without_motions_nothing_contradicts_a_place(room: Room, taught: MemoryMap) -> None:
    answer = _after_a_gap(room, taught, way_m=4.0, motion_age_s=math.inf)

    assert isinstance(answer, Fix)
    assert answer.pose_map_base.distance_to(_HERE) < 0.03


def test_motions_that_were_interrupted_tell_nothing() -> None:
    whereabouts, moving = Whereabouts(1.0), Belief(0.0, motion_age_s=0.1)
    whereabouts.begin(Pose2(1.0, 2.0, math.pi / 2), moving)
    there = Belief(1.0, pose_odom_base=Pose2(0.5), travelled_m=0.5, motion_age_s=0.1)

    before = whereabouts.carried(there)
    whereabouts.follow(Belief(3.0, motion_age_s=2.0))

    assert before is not None
    assert (before.x, before.y, before.theta) == pytest.approx((1.0, 2.5, math.pi / 2))
    assert whereabouts.carried(there) is None


def test_reach_grows_with_the_way_and_turns_wrap() -> None:
    pose = Pose2(0.0, 0.0, 3.1)

    assert is_in_reach(Pose2(0.4, 0.0, -3.1), pose)
    assert not is_in_reach(Pose2(0.8, 0.0, 3.1), pose)
    assert is_in_reach(Pose2(0.8, 0.0, 3.1), pose, way_m=3.0)
    assert not is_in_reach(Pose2(0.0, 0.0, 0.0), pose, way_m=3.0)


def test_landmarks_remembered_anew_are_no_surer_than_the_gap_and_the_belief() -> None:
    believed = np.diag([4.0, 1.0, 0.01])

    told, blind = restart_covariance(0.0, believed), restart_covariance(4.0, None)

    assert np.sqrt(np.diag(told)) == pytest.approx([math.hypot(0.3, 2.0), math.hypot(0.3, 1.0), math.hypot(0.35, 0.1)])
    assert np.sqrt(np.diag(blind)) == pytest.approx([2.3, 2.3, 2.35])
