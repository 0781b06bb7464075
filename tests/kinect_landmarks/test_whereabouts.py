"""A camera that has lost its pose is not taken to a place that only looks alike."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.estimates import Belief, Estimate, Fix, Lost, Motion
from trailmark.frames import RGBD, Frame
from trailmark.geometry import Pose2, Pose3
from trailmark.interfaces import Session
from trailmark.testing import MemoryMap
from trailmark_kinect_landmarks.config import KinectLandmarksConfig
from trailmark_kinect_landmarks.localizer import KinectLandmarks, KinectMotion
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
    start: Pose2 | None = None,
    led: Pose2 | None = None,
    solve: Literal["space", "plane"] = "space",
    min_agreeing: int = 12,
) -> Estimate:
    """Return what is said of the first picture after the camera was covered while wheels went ahead."""
    localizer = KinectLandmarks(KinectLandmarksConfig(camera="kinect", solve=solve, min_agreeing=min_agreeing))
    mode, start = ("track", _HERE) if localizer_map is None else ("replay", start)
    rng = np.random.default_rng(3)
    localizer.start(Session(sensors=SENSORS, mode=mode, map=localizer_map, start_pose=start, rng=rng))
    before = Belief(0.0, start, motion_age_s=motion_age_s)
    for i in range(6):
        localizer.observe(Frame("kinect", i / 30.0, room.look(start or _HERE)), before)
    localizer.observe(Frame("kinect", 6 / 30.0, _DARK), before)
    stamp_s = 5 / 30.0 + _COVERED_S
    after = Belief(stamp_s, start, pose_odom_base=led or Pose2(way_m), travelled_m=way_m, motion_age_s=motion_age_s)
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


class _Deeper(Room):
    """A room whose wall is half as far again: it is looked through where another one's stands."""

    def _render(self, pose: Pose2, box_left_m: float, tilt_rad: tuple[float, float]) -> RGBD:
        seen = super()._render(pose, box_left_m, tilt_rad)
        return RGBD(np.ascontiguousarray(seen.bgr[:, ::-1]), seen.depth_m * np.float32(1.5))


def test_landmarks_are_not_remembered_anew_where_the_camera_looks_through_those_it_saw(room: Room) -> None:
    other_boards, through = (_after_a_gap(room, None, later=later) for later in (Room(seed=11), _Deeper(seed=11)))
    after_a_way = _after_a_gap(room, None, way_m=0.2, later=_Deeper(seed=11))

    for answer, is_begun in ((other_boards, True), (through, False), (after_a_way, True)):
        assert isinstance(answer, Lost)
        assert ("remembers anew" in answer.reason) == is_begun


def _twice(taught: MemoryMap, n_kept: int) -> MemoryMap:
    """Return a map in which all landmarks stand once more, farther ahead and turned round, and some of the first."""
    arrays = taught.load("map")
    assert arrays is not None
    n = len(arrays["points"])
    both = {key: np.concatenate([array[:n_kept], array]) if len(array) == n else array for key, array in arrays.items()}
    R = np.diag([-1.0, -1.0, 1.0])
    both["points"][n_kept:] = arrays["points"] @ R + (10.0, 0.0, 0.0)
    both["anchor"][n_kept:, :2] = arrays["anchor"][:, :2] @ R[:2, :2] + (10.0, 0.0)
    both["anchor"][n_kept:, 2] += math.pi
    localizer_map = MemoryMap()
    localizer_map.save("map", both)
    return localizer_map


def test_of_two_places_that_look_alike_that_is_found_to_which_motions_lead(room: Room, taught: MemoryMap) -> None:
    arrays, aside = taught.load("map"), Pose2(0.05, 1.7, 0.05)
    assert arrays is not None
    alike = _twice(taught, n_kept=len(arrays["points"]) // 2)

    answer = _after_a_gap(room, alike, solve="plane", start=aside, led=aside.between(_HERE), way_m=1.6)

    assert isinstance(answer, Fix)
    assert answer.pose_map_base.distance_to(_HERE) < 0.03


def test_landmarks_of_this_drive_are_enough_where_none_were_taught(room: Room, taught: MemoryMap) -> None:
    localizer = KinectLandmarks(KinectLandmarksConfig(camera="kinect", solve="plane"))
    localizer.start(Session(sensors=SENSORS, mode="replay", map=taught, start_pose=_HERE, rng=np.random.default_rng(3)))
    beyond = [Pose2(0.05, 0.1 + 0.04 * i, 0.05) for i in range(60)]
    for i, pose in enumerate(beyond):
        localizer.observe(Frame("kinect", i / 30.0, room.look(pose)), Belief(i / 30.0))
    (answer,) = localizer.observe(Frame("kinect", 4.0, room.look(beyond[-1])), Belief(4.0))

    assert isinstance(answer, Fix)
    assert answer.pose_map_base.distance_to(beyond[-1]) < 0.05


def test_after_landmarks_are_remembered_anew_fixes_state_what_the_belief_does(room: Room) -> None:
    believed = np.diag([1.5, 0.8, 0.4]) ** 2
    localizer = KinectLandmarks(KinectLandmarksConfig(camera="kinect"))
    localizer.start(Session(sensors=SENSORS, start_pose=_HERE, rng=np.random.default_rng(3)))
    for i in range(4):
        localizer.observe(Frame("kinect", i / 30.0, room.look(_HERE)), Belief(i / 30.0, _HERE, motion_age_s=0.0))
    there, other = Pose2(2.0, 1.0, 0.5), Room(seed=11)
    answers = [
        localizer.observe(
            Frame("kinect", 2.0 + i / 30.0, other.look(_HERE)),
            Belief(2.0, there, believed, Pose2(2.0), travelled_m=2.0, motion_age_s=0.0),
        )
        for i in range(4)
    ]

    first, fix = answers[0][0], answers[-1][-1]
    assert isinstance(first, Lost)
    assert first.reason.endswith("remembers anew")
    assert isinstance(fix, Fix)
    assert fix.pose_map_base.distance_to(there) < 0.05
    sigmas = np.sqrt(np.diag(np.linalg.inv(fix.information)))
    assert sigmas == pytest.approx([math.hypot(1.5, 0.3), math.hypot(0.8, 0.3), math.hypot(0.4, 0.35)], rel=0.1)


def test_a_motion_begins_anew_after_a_doubt(room: Room, taught: MemoryMap) -> None:
    localizer = KinectMotion(KinectLandmarksConfig(camera="kinect"))
    localizer.start(Session(sensors=SENSORS, mode="replay", map=taught, rng=np.random.default_rng(3)))
    answers: list[list[Estimate]] = []
    for stamp_s, odom_m in ((0.0, 0.0), (0.03, 0.0), (2.0, 4.0), (4.0, 0.02), (4.03, 0.02)):
        belief = Belief(stamp_s, pose_odom_base=Pose2(odom_m), travelled_m=4.0 if stamp_s else 0.0, motion_age_s=0.0)
        answers.append(list(localizer.observe(Frame("kinect", stamp_s, room.look(_HERE)), belief)))

    kinds = [[type(answer) for answer in some] for some in answers]
    assert kinds == [[], [Motion], [Lost], [], [Motion]]
    assert isinstance(answers[-1][0], Motion)
    assert answers[-1][0].since_s == pytest.approx(4.0)


@pytest.mark.parametrize(("way_m", "motion_age_s"), [(4.0, math.inf), (-4.0, 0.0)])
def test_without_motions_nothing_contradicts_a_place(
    room: Room, taught: MemoryMap, way_m: float, motion_age_s: float
) -> None:
    answer = _after_a_gap(room, taught, way_m=way_m, motion_age_s=motion_age_s)

    assert isinstance(answer, Fix)
    assert answer.pose_map_base.distance_to(_HERE) < 0.03


def _moving(x: float = 0.0, theta: float = 0.0, age_s: float = 0.1) -> Belief:
    return Belief(0.0, pose_odom_base=Pose2(x, 0.0, theta), travelled_m=x, motion_age_s=age_s)


_STANDING = _moving()


def _begun(
    *pose: float, covariance: Floats | None = None, belief: Belief | None = _STANDING, is_assumed: bool = False
) -> Whereabouts:
    whereabouts, T_map_base = Whereabouts(1.0), Pose3.from_planar(Pose2(*pose)).matrix()
    whereabouts.begin(T_map_base, covariance=covariance, belief=belief, is_assumed=is_assumed)
    return whereabouts


def test_motions_lead_on_until_they_are_interrupted() -> None:
    whereabouts = _begun(1.0, 2.0, math.pi / 2)

    whereabouts.follow(_moving(0.5))
    before = whereabouts.lead
    whereabouts.follow(_moving(0.5, age_s=2.0))
    whereabouts.follow(_moving(0.6))

    assert before is not None
    assert (before.pose.x, before.pose.y, before.pose.theta) == pytest.approx((1.0, 2.5, math.pi / 2))
    assert whereabouts.lead is None
    assert not whereabouts.is_near(before.pose)
    assert whereabouts.is_possible(Pose2(50.0))


def test_a_prediction_that_is_taken_back_does_not_interrupt_motions() -> None:
    braking, restarted = _begun(), _begun()

    for x in (0.5, 0.498):
        braking.follow(_moving(x))
    for x in (5.0, 0.0):
        restarted.follow(_moving(x))

    assert braking.lead is not None
    assert braking.lead.pose.x == pytest.approx(0.498)
    assert restarted.lead is None


def test_what_is_near_grows_with_the_way_and_the_turns() -> None:
    whereabouts = _begun(0.0, 0.0, 3.1)

    assert whereabouts.has_stood
    assert whereabouts.is_near(Pose2(0.4, 0.0, -3.1))
    assert not whereabouts.is_near(Pose2(0.8, 0.0, 3.1))
    assert not whereabouts.is_near(Pose2(0.0, 0.0, 2.3))
    for turn in (1.0, 2.0, 1.0, 0.0):
        whereabouts.follow(_moving(3.0, turn))
    assert not whereabouts.has_stood
    assert whereabouts.is_near(Pose2(-3.8, 0.1, 2.3))


def test_a_pose_that_was_hardly_known_leaves_others_possible() -> None:
    whereabouts = _begun(covariance=np.diag([0.01, 1.5, 0.1]) ** 2, is_assumed=True)

    assert not whereabouts.is_near(Pose2(1.5))
    assert whereabouts.is_possible(Pose2(1.5))
    assert not whereabouts.is_possible(Pose2(7.0))
    whereabouts.follow(_moving(10.0))
    assert whereabouts.is_possible(Pose2(10.0, 11.0))  # by its heading, as far ahead
    assert not whereabouts.is_possible(Pose2(10.0, 14.0))


def test_a_told_start_is_near_itself_without_motions_until_it_is_forgotten() -> None:
    whereabouts, moving = _begun(2.0, belief=None, is_assumed=True), _begun(2.0, is_assumed=True)

    assert whereabouts.is_near(Pose2(2.3))
    assert not whereabouts.is_near(Pose2(4.0))
    whereabouts.forget()
    moving.follow(_moving(age_s=5.0))
    assert not whereabouts.is_near(Pose2(2.3))
    assert not moving.is_near(Pose2(2.3))


def test_landmarks_remembered_anew_are_no_surer_than_the_gap_and_the_pose_before() -> None:
    believed = np.diag([4.0, 1.0, 0.01])

    told, blind = restart_covariance(0.0, believed), restart_covariance(4.0, None)
    twice, unknown = restart_covariance(0.0, blind), restart_covariance(0.0, np.full((3, 3), np.nan))

    assert np.sqrt(np.diag(told)) == pytest.approx([math.hypot(0.3, 2.0), math.hypot(0.3, 1.0), math.hypot(0.35, 0.1)])
    assert np.sqrt(np.diag(blind)) == pytest.approx([2.3, 2.3, 2.35])
    assert np.diag(twice) == pytest.approx(np.diag(blind) + np.diag(restart_covariance(0.0, None)))
    assert unknown[0, 0] >= 100.0
