"""How alike the taught landmarks look that should be seen from a pose: from the right one, and with other boards."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.geometry import Pose2, Pose3
from trailmark_kinect_landmarks.camera import LandmarkCamera
from trailmark_kinect_landmarks.config import KinectLandmarksConfig
from trailmark_kinect_landmarks.eye import LandmarkDetector, PreparedImage
from trailmark_kinect_landmarks.fuzzy import SearchPlan
from trailmark_kinect_landmarks.memory import Anchor, LandmarkMemory
from trailmark_kinect_landmarks.place_likeness import place_likeness

from .conftest import SENSORS, Room

CONFIG = KinectLandmarksConfig(camera="kinect")
CAMERA = LandmarkCamera(CONFIG, SENSORS["kinect"], None)


def picture_of(room: Room, pose: Pose2, **options: float) -> PreparedImage:
    return LandmarkDetector(CONFIG, CAMERA).prepare(room.look(pose, **options), None, None, 1.0)


def pose_matrix(pose: Pose2) -> Floats:
    return Pose3.from_planar(pose).matrix()


@pytest.fixture(scope="module")
def memory(room: Room) -> LandmarkMemory:
    """Return what is taught from the first pose."""
    detector, taught = LandmarkDetector(CONFIG, CAMERA), LandmarkMemory()
    picture = detector.prepare(room.look(Pose2()), None, None, 1.0)
    seen = detector.find(picture, SearchPlan(CONFIG.finders, 1.0, True), np.empty((0, 2)), 60)
    taught.add(seen, Anchor(np.eye(4), np.zeros((3, 3))), is_trusted=True)
    loaded = LandmarkMemory()
    loaded.load(taught.arrays())
    return loaded


def test_the_taught_room_looks_alike_from_beside_and_with_a_hand_before_it(memory: LandmarkMemory, room: Room) -> None:
    beside = Pose2(0.05, 0.1, 0.05)
    seen, hidden = picture_of(room, beside), picture_of(room, beside, box_left_m=0.6)

    there = place_likeness(memory, CAMERA, seen, pose_matrix(beside))
    with_less = place_likeness(memory, CAMERA, hidden, pose_matrix(beside))

    assert there is not None
    assert there > 0.85
    assert with_less is not None
    assert with_less > 0.8  # what stands before the others has another depth: they are not asked


def test_other_boards_and_a_wrong_pose_do_not_look_alike(memory: LandmarkMemory, room: Room) -> None:
    other = place_likeness(memory, CAMERA, picture_of(Room(seed=11), Pose2()), np.eye(4))
    wrong = place_likeness(memory, CAMERA, picture_of(room, Pose2()), pose_matrix(Pose2(0.0, 0.4, 0.0)))

    assert other is not None
    assert other < 0.5
    assert wrong is not None
    assert wrong < 0.5


def test_where_few_should_be_seen_nothing_is_told(memory: LandmarkMemory, room: Room) -> None:
    picture = picture_of(room, Pose2())

    assert place_likeness(memory, CAMERA, picture, pose_matrix(Pose2(0.0, 2.0, 0.0))) is None  # taught far from there
    assert place_likeness(memory, CAMERA, picture, pose_matrix(Pose2(0.0, 0.0, 3.0))) is None  # with its back to them
    assert place_likeness(LandmarkMemory(), CAMERA, picture, np.eye(4)) is None
