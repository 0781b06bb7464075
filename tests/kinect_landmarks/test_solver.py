"""What few landmarks that tell most may say, and what becomes of a taught place when depth lies elsewhere."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest

from trailmark.estimates import Belief
from trailmark.frames import Frame
from trailmark.geometry import Pose2, Pose3
from trailmark.interfaces import Session
from trailmark.testing import MemoryMap
from trailmark_kinect_landmarks.alignment import Refusal
from trailmark_kinect_landmarks.camera import alignment_limits
from trailmark_kinect_landmarks.config import KinectLandmarksConfig
from trailmark_kinect_landmarks.expectation import Expected
from trailmark_kinect_landmarks.landmarks import SeenLandmarks, TrackedLandmarks
from trailmark_kinect_landmarks.localizer import KinectLandmarks
from trailmark_kinect_landmarks.memory import Anchor, LandmarkMemory, MemoryLimits
from trailmark_kinect_landmarks.registration import Registration
from trailmark_kinect_landmarks.solver import PoseSolver, Solved

from .conftest import SENSORS, Room

ROWS = np.arange(11)
NEAR = ROWS < 3  # exact, so that they tell most


def seen_at(points: np.ndarray) -> SeenLandmarks:
    n = len(points)
    cov = np.where(NEAR, 1e-6, 1e-3)[:, None, None] * np.eye(3)
    look = np.ones((n, 4), np.float32)
    return SeenLandmarks(np.zeros((n, 2)), np.zeros(n, np.int8), np.ones(n), look, look, points, cov)


def at_rest(is_carried: np.ndarray, carried_m: float) -> tuple[PoseSolver, TrackedLandmarks]:
    """Return what a robot that stands still tracks, while some of the landmarks are carried to the left."""
    config = KinectLandmarksConfig(camera="kinect", solve="plane", landmarks=3, min_landmarks=2, min_agreeing=3)
    points = np.stack([np.linspace(2.0, 4.0, 11), np.linspace(-1.5, 1.5, 11) * (-1.0) ** ROWS, np.zeros(11)], axis=1)
    memory = LandmarkMemory(MemoryLimits(trial=1))
    memory.add(seen_at(points), Anchor(np.eye(4), np.zeros((3, 3))), is_trusted=True)
    now = points + is_carried[:, None] * np.array([0.0, carried_m, 0.0])
    solver = PoseSolver(config, memory, alignment_limits(config), np.random.default_rng(0))
    return solver, TrackedLandmarks(seen_at(now), ROWS)


def solved(is_carried: np.ndarray, carried_m: float, expected: Expected | None) -> Solved | Refusal:
    """Return the pose of such a robot."""
    solver, again = at_rest(is_carried, carried_m)
    return solver.solve(again, expected)


def test_after_landmarks_are_forgotten_the_last_pose_is_not_taken_for_known() -> None:
    solver, again = at_rest(NEAR, 0.0)
    solver.solve(again, None)
    assert solver._spread is not None

    solver.forget()

    assert solver._spread is None


def test_once_the_camera_tilts_three_must_agree() -> None:
    solver, again = at_rest(NEAR, 0.0)
    assert solver.n_needed == 2

    tilted = again.seen.points_base @ Pose3(pitch=np.radians(5.0)).rotation()
    again = TrackedLandmarks(replace(again.seen, points_base=tilted), ROWS)

    assert [solver.notices_tilt(stamp_s, again) for stamp_s in (0.0, 0.5)] == [False, True]
    assert solver.n_needed == 3


@pytest.mark.parametrize("carried_m", [0.0, 0.3])
def test_few_that_were_carried_off_together_do_not_take_the_pose_with_them(carried_m: float) -> None:
    answer = solved(NEAR, carried_m, None)

    assert isinstance(answer, Solved)
    np.testing.assert_allclose(answer.T_map_base, np.eye(4), atol=0.01)
    assert NEAR[answer.agreeing.rows].all() == (carried_m == 0.0)


def test_where_neither_half_of_the_landmarks_outvotes_the_other_nothing_is_told() -> None:
    answer = solved(ROWS < 5, 0.3, None)

    assert isinstance(answer, Refusal)
    assert answer.reason == "the landmarks contradict one another"


def test_a_thing_that_shows_more_landmarks_than_the_room_is_left_out_where_the_motion_is_known() -> None:
    stands = Expected(np.eye(2), np.zeros(2), np.full(2, 0.02), 0.01)

    answer = solved(ROWS < 7, 0.6, stands)

    assert isinstance(answer, Solved)
    np.testing.assert_allclose(answer.T_map_base, np.eye(4), atol=0.05)
    assert (answer.agreeing.rows >= 7).all()


def test_a_taught_place_is_not_forgotten_when_depth_is_found_to_lie_elsewhere(
    room: Room, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    config = KinectLandmarksConfig(camera="kinect", solve="plane")
    localizer_map, teacher, localizer = MemoryMap(), KinectLandmarks(config), KinectLandmarks(config)
    start, frame = Pose2(), Frame("kinect", 0.0, room.look(Pose2()))
    teaching = Session(mode="teach", rng=np.random.default_rng(7), sensors=SENSORS, start_pose=start, map=localizer_map)
    teacher.start(teaching)
    for k in range(5):
        teacher.observe(Frame("kinect", k / 30.0, frame.payload), Belief(k / 30.0, start))
    teacher.finish()
    localizer.start(replace(teaching, mode="replay", rng=np.random.default_rng(7)))
    taught = localizer.counters()["remembered"]
    monkeypatch.setattr(localizer._watch.registration, "found", Registration(right_px=8.0))
    monkeypatch.setattr(localizer._watch, "look", lambda *_: True)

    with caplog.at_level(logging.WARNING):
        localizer.observe(frame, Belief(0.0, start))

    assert localizer.counters()["registered"] == 1
    assert localizer.counters()["remembered"] >= taught > 0
    assert "teach it again" in caplog.text
