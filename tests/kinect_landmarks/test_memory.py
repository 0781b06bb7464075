"""What is remembered, for how sure, and what has been moved."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.errors import StoreError
from trailmark.geometry import Pose3
from trailmark_kinect_landmarks.landmarks import SeenLandmarks
from trailmark_kinect_landmarks.memory import Anchor, LandmarkMemory, MemoryLimits
from trailmark_kinect_landmarks.systematic import TravelledWay

ROW = np.array([0])


def _seen(n: int = 2) -> SeenLandmarks:
    points = np.stack([np.full(n, 2.0), np.arange(n, dtype=float), np.zeros(n)], axis=1)
    cov = np.tile(np.eye(3) * 1e-4, (n, 1, 1))
    look = np.ones((n, 4), np.float32)
    return SeenLandmarks(np.zeros((n, 2)), np.zeros(n, np.int8), np.ones(n), look, look, points, cov)


def _memory(is_trusted: bool = False) -> LandmarkMemory:
    memory = LandmarkMemory(MemoryLimits(trial=3, moved_after=2))
    memory.add(_seen(), Anchor(np.eye(4), np.zeros((3, 3))), is_trusted)
    return memory


def test_a_new_landmark_votes_after_its_trial() -> None:
    memory = _memory()
    votes = [bool(memory.votes(ROW)[0])]

    for _ in range(2):
        memory.agree(ROW, memory.points[ROW].copy(), np.eye(3)[None] * 1e-4)
        votes.append(bool(memory.votes(ROW)[0]))

    assert votes == [False, False, True]


def test_what_is_remembered_at_the_start_votes_at_once() -> None:
    assert _memory(is_trusted=True).votes(np.array([0, 1])).all()


def test_landmarks_are_remembered_in_map_axes() -> None:
    memory = LandmarkMemory()
    quarter = Pose3(x=1.0, yaw=np.pi / 2).matrix()

    memory.add(_seen(1), Anchor(quarter, np.zeros((3, 3))), is_trusted=True)

    np.testing.assert_allclose(memory.points, [[1.0, 2.0, 0.0]])


def test_sightings_average_out_and_stay_able_to_learn() -> None:
    memory, rng = _memory(), np.random.default_rng(7)
    true = memory.points[0].copy()

    for _ in range(300):
        memory.agree(ROW, true[None] + rng.normal(0.0, 0.01, (1, 3)), np.eye(3)[None] * 1e-4)

    assert np.abs(memory.points[0] - true).max() < 0.006
    assert 1e-6 < memory.cov[0, 0, 0] < 1e-5  # a twenty-fifth of one sighting's


def test_what_moves_against_the_others_is_set_aside() -> None:
    memory = _memory(is_trusted=True)

    memory.disagree(ROW)
    assert memory.votes(ROW).all()
    memory.disagree(ROW)

    assert memory.is_moved.tolist() == [True, False]
    assert not memory.votes(ROW).any()


def test_one_sighting_in_agreement_forgives() -> None:
    memory = _memory(is_trusted=True)

    memory.disagree(ROW)
    memory.agree(ROW, memory.points[ROW].copy(), np.eye(3)[None] * 1e-4)
    memory.disagree(ROW)

    assert not memory.is_moved.any()


def test_what_is_stored_is_what_is_loaded() -> None:
    memory, again = _memory(), LandmarkMemory()

    again.load(memory.arrays())

    for name, array in memory.arrays().items():
        np.testing.assert_array_equal(again.arrays()[name], array)


def test_a_map_of_an_earlier_version_is_read_without_its_anchors() -> None:
    arrays = _memory().arrays()
    del arrays["anchor"]
    memory = LandmarkMemory()

    memory.load(arrays)

    assert memory.drift(ROW, np.eye(4), 2.0) == TravelledWay(depth_m=2.0)


def test_drift_grows_from_where_landmarks_were_remembered_and_falls_on_the_way_back() -> None:
    memory = LandmarkMemory()
    there = Anchor(Pose3(x=1.0).matrix(), np.zeros((3, 3)), TravelledWay(way_m=1.0))
    first = memory.add(_seen(1), Anchor(np.eye(4), np.zeros((3, 3))), is_trusted=True)
    later = memory.add(_seen(1), there, is_trusted=True)

    assert memory.drift(later, Pose3(x=3.0).matrix(), 2.0).way_m == pytest.approx(3.0)
    assert memory.drift(first, Pose3(x=0.1, yaw=0.2).matrix(), 2.0) == TravelledWay(
        pytest.approx(0.1), pytest.approx(0.2), 2.0
    )


def test_a_memory_that_is_cleared_is_empty() -> None:
    memory = _memory()

    memory.clear()

    assert len(memory) == 0


def test_arrays_that_do_not_belong_together_are_refused() -> None:
    arrays = _memory().arrays()
    arrays["kind"] = arrays["kind"][:1]

    with pytest.raises(StoreError, match="differ in length: teach the place again"):
        LandmarkMemory().load(arrays)


def _at(picture: int, n: int, rng: np.random.Generator) -> SeenLandmarks:
    seen = _seen(n)
    seen.points_base[:] = rng.uniform(-5.0, 5.0, (n, 3))
    seen.points_base[:, 0] += 0.01 * picture
    return seen


def test_memory_stays_bounded_over_ten_thousand_pictures() -> None:
    memory, rng = LandmarkMemory(MemoryLimits(trial=3, moved_after=2, most=300)), np.random.default_rng(7)
    memory.add(_seen(4), Anchor(np.eye(4), np.zeros((3, 3))), is_trusted=True)
    memory.size_m[:4] = 7.0  # by which they are known again
    followed = np.arange(4)
    most = 0

    for picture in range(10_000):
        numbers = memory.forget(followed)
        followed = followed if numbers is None else numbers[followed]
        assert (followed >= 0).all()
        if picture % 10 == 0:
            memory.agree(followed, memory.points[followed].copy(), np.tile(np.eye(3) * 1e-4, (len(followed), 1, 1)))
        new = memory.add(_at(picture, 3, rng), Anchor(np.eye(4), np.zeros((3, 3))), is_trusted=picture % 5 == 0)
        assert new[-1] == len(memory) - 1
        most = max(most, len(memory))

    assert most <= 300 + 3
    assert (memory.size_m == 7.0).sum() == 4
    assert len({len(memory.arrays()[name]) for name in memory.arrays()}) == 1


def test_those_seen_often_outlive_those_seen_once_and_the_moved_go_first() -> None:
    memory = LandmarkMemory(MemoryLimits(trial=1, moved_after=1, most=100))
    memory.add(_seen(101), Anchor(np.eye(4), np.zeros((3, 3))), is_trusted=True)
    memory.size_m[:] = np.arange(101)
    often = np.arange(0, 50)
    for _ in range(5):
        memory.agree(often, memory.points[often].copy(), np.tile(np.eye(3) * 1e-4, (50, 1, 1)))
    memory.disagree(np.array([3, 4]))

    numbers = memory.forget(np.array([100]))

    assert numbers is not None
    assert len(memory) == 90  # a tenth more than needed
    assert not np.isin([3.0, 4.0], memory.size_m).any()
    assert np.isin(np.delete(np.arange(50.0), [3, 4]), memory.size_m).all()
    assert 100.0 in memory.size_m
    assert memory.size_m[numbers[100]] == 100.0


def test_a_taught_place_is_never_forgotten() -> None:
    taught, memory = _memory(), LandmarkMemory(MemoryLimits(most=100))
    memory.load(taught.arrays())

    for _ in range(200):
        memory.forget(np.empty(0, np.intp))
        memory.add(_seen(1), Anchor(np.eye(4), np.zeros((3, 3))), is_trusted=False)

    assert memory.is_taught.sum() == 2
    assert len(memory) < 2 + 100
