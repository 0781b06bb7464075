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
from trailmark_kinect_landmarks.whereabouts import Whereabouts, restart_covariance

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
    later: Room | None = None,
    **keys: object,
) -> Estimate:
    """Return what is said of the first picture after the camera was covered while wheels went ahead."""
    localizer = KinectLandmarks(KinectLandmarksConfig(camera="kinect", **keys))  # type: ignore[arg-type]
    mode, start = ("track", _HERE) if localizer_map is None else ("replay", None)
    rng = np.random.default_rng(3)
    localizer.start(Session(sensors=SENSORS, mode=mode, map=localizer_map, start_pose=start, rng=rng))
    before = Belief(0.0, start, motion_age_s=motion_age_s)
    for i in range(6):
        localizer.observe(Frame("kinect", i / 30.0, room.look(_HERE)), before)
    localizer.observe(Frame("kinect", 6 / 30.0, _DARK), before)
    stamp_s, led = 5 / 30.0 + _COVERED_S, Pose2(way_m)
    after = Belief(stamp_s, start, pose_odom_base=led, travelled_m=way_m, motion_age_s=motion_age_s)
    (answer,) = localizer.observe(Frame("kinect", stamp_s, (later or room).look(seen_from)), after)
    return answer


@pytest.mark.parametrize("is_taught", [True, False])
def test_a_place_that_motions_do_not_lead_to_only_looks_alike(room: Room, taught: MemoryMap, is_taught: bool) -> None:
    answer = _after_a_gap(room, taught if is_taught else None, way_m=4.0)

    assert isinstance(answer, Lost)
    assert "from where motions lead: it may be another that looks alike" in answer.reason


@pytest.mark.parametrize("min_agreeing", [12, 60])  # few that were taught are enough where motions lead
def test_a_place_that_motions_lead_to_is_found_again(room: Room, taught: MemoryMap, min_agreeing: int) -> None:
    there = Pose2(0.25, 0.1, 0.05)

    answer = _after_a_gap(room, taught, way_m=0.2, seen_from=there)
    beyond_the_map = _after_a_gap(room, None, way_m=0.2, seen_from=there, min_agreeing=min_agreeing)

    for found in (answer, beyond_the_map):
        assert isinstance(found, Fix)
        assert found.pose_map_base.distance_to(there) < 0.03


@pytest.mark.parametrize("is_taught", [True, False])
@pytest.mark.parametrize("way_m", [0.0, 0.03, 0.2, 0.5])
def test_a_robot_that_was_carried_off_is_found(room: Room, taught: MemoryMap, way_m: float, is_taught: bool) -> None:
    there = Pose2(0.05, 0.9, 0.05)

    answer = _after_a_gap(room, taught if is_taught else None, way_m=way_m, seen_from=there)

    assert isinstance(answer, Fix)
    assert answer.pose_map_base.distance_to(there) < 0.05


@pytest.mark.parametrize("seen", ["boards", "none"])
def test_landmarks_are_remembered_anew_but_where_the_camera_surely_is_not(room: Room, seen: str) -> None:
    other = Room(seed=11)
    if seen == "none":  # it looks through where the wall was: somebody carried it to where nothing is known
        other._render = lambda *about: _farther(room._render(*about))  # type: ignore[method-assign]
        other._look = other._render  # type: ignore[assignment]

    answer = _after_a_gap(room, None, later=other)

    assert isinstance(answer, Lost)
    assert ("remembers anew" in answer.reason) == (seen == "boards")


def _farther(seen: RGBD) -> RGBD:
    return RGBD(np.ascontiguousarray(seen.bgr[:, ::-1]), seen.depth_m * np.float32(1.5))


@pytest.mark.parametrize(("way_m", "motion_age_s"), [(4.0, math.inf), (-4.0, 0.0)])
def test_without_motions_nothing_contradicts_a_place(
    room: Room, taught: MemoryMap, way_m: float, motion_age_s: float
) -> None:
    answer = _after_a_gap(room, taught, way_m=way_m, motion_age_s=motion_age_s)

    assert isinstance(answer, Fix)
    assert answer.pose_map_base.distance_to(_HERE) < 0.03


def _moving(x: float = 0.0, theta: float = 0.0, age_s: float = 0.1) -> Belief:
    return Belief(0.0, pose_odom_base=Pose2(x, 0.0, theta), travelled_m=x, motion_age_s=age_s)


def test_motions_lead_on_until_they_are_interrupted() -> None:
    whereabouts = Whereabouts(1.0)
    whereabouts.begin(Pose2(1.0, 2.0, math.pi / 2), None, _moving())

    whereabouts.follow(_moving(0.5))
    before = whereabouts.led
    whereabouts.follow(_moving(0.5, age_s=2.0))
    whereabouts.follow(_moving(0.6))

    assert before is not None
    assert (before.x, before.y, before.theta) == pytest.approx((1.0, 2.5, math.pi / 2))
    assert whereabouts.led is None
    assert not whereabouts.is_near(before)
    assert whereabouts.is_possible(Pose2(50.0))


def test_what_is_near_grows_with_the_way_and_the_turns() -> None:
    whereabouts = Whereabouts(1.0)
    whereabouts.begin(Pose2(0.0, 0.0, 3.1), None, _moving())

    assert whereabouts.has_stood
    assert whereabouts.is_near(Pose2(0.4, 0.0, -3.1))
    assert not whereabouts.is_near(Pose2(0.8, 0.0, 3.1))
    assert not whereabouts.is_near(Pose2(0.0, 0.0, 2.3))
    for turn in (1.0, 2.0, 1.0, 0.0):
        whereabouts.follow(_moving(3.0, turn))
    assert not whereabouts.has_stood
    assert whereabouts.is_near(Pose2(-3.8, 0.1, 2.3))


def test_a_pose_that_was_hardly_known_leaves_others_possible() -> None:
    whereabouts = Whereabouts(1.0)

    whereabouts.begin(Pose2(), np.diag([0.01, 1.5, 0.3]) ** 2, _moving(), is_assumed=True)

    assert not whereabouts.is_near(Pose2(1.5))
    assert whereabouts.is_possible(Pose2(1.5))
    assert not whereabouts.is_possible(Pose2(7.0))


def test_a_told_start_is_near_itself_without_motions() -> None:
    whereabouts = Whereabouts(1.0)

    whereabouts.begin(Pose2(2.0), None, None, is_assumed=True)

    assert whereabouts.is_near(Pose2(2.3))
    assert not whereabouts.is_near(Pose2(4.0))


def test_landmarks_remembered_anew_are_no_surer_than_the_gap_and_the_pose_before() -> None:
    believed = np.diag([4.0, 1.0, 0.01])
    whereabouts = Whereabouts(1.0)

    told, blind = restart_covariance(0.0, believed), restart_covariance(4.0, None)
    whereabouts.begin(Pose2(), blind, None, is_assumed=True)
    twice, unknown = whereabouts.restart_covariance(0.0), restart_covariance(0.0, np.full((3, 3), np.nan))

    assert np.sqrt(np.diag(told)) == pytest.approx([math.hypot(0.3, 2.0), math.hypot(0.3, 1.0), math.hypot(0.35, 0.1)])
    assert np.sqrt(np.diag(blind)) == pytest.approx([2.3, 2.3, 2.35])
    assert np.diag(twice) == pytest.approx(np.diag(blind) + np.diag(restart_covariance(0.0, None)))
    assert unknown[0, 0] >= 100.0
