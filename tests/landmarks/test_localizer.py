"""Known landmarks: what an instant tells alone, what a single one tells, outliers, noise that is learnt."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.errors import ConfigError
from trailmark.estimates import Belief, Estimate, Fix, Lost
from trailmark.frames import Arrays, Frame, Record, SensorInfo
from trailmark.geometry import Pose2, Pose3
from trailmark.interfaces import Session
from trailmark_landmarks.config import KnownLandmarksConfig
from trailmark_landmarks.localizer import KnownLandmarks

SQUARE = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 6.0], [0.0, 6.0]])
MANY = np.vstack([SQUARE, [[3.0, 9.0], [-2.0, 3.0], [8.0, 2.5]]])
TRUE = Pose2(2.0, 3.5, 0.6)
MOUNTING = Pose2(0.3, -0.1, 0.5)


def localizer(landmarks: Floats = MANY, mounting: Pose2 = MOUNTING, **config: Any) -> KnownLandmarks:
    calibration = Arrays({"ids": np.arange(len(landmarks)), "positions_map": landmarks})
    place = Pose3.from_planar(mounting)
    info = SensorInfo("seen", "range_bearing", calibration=calibration, pose_base_sensor=place)
    found = KnownLandmarks(KnownLandmarksConfig(sightings="seen", **config))
    found.start(Session(sensors={"seen": info}))
    return found


def sightings(
    ids: list[int], *, ranges: bool = True, bearings: bool = True, landmarks: Floats = MANY, mounting: Pose2 = MOUNTING
) -> dict[str, Any]:
    sensor = TRUE @ mounting
    offsets = landmarks[ids] - [sensor.x, sensor.y]
    arrays: dict[str, Any] = {"ids": np.array(ids)}
    if ranges:
        arrays["ranges_m"] = np.hypot(offsets[:, 0], offsets[:, 1])
    if bearings:
        angles = np.arctan2(offsets[:, 1], offsets[:, 0]) - sensor.theta
        arrays["bearings_rad"] = np.arctan2(np.sin(angles), np.cos(angles))
    return arrays


def observe(found: KnownLandmarks, arrays: dict[str, Any], belief: Belief | None = None) -> list[Estimate]:
    return list(found.observe(Frame("seen", 1.0, Record(arrays)), belief or Belief(1.0)))


def believing(pose: Pose2, sigma_m: float = 0.2, sigma_rad: float = 0.1) -> Belief:
    return Belief(1.0, pose, np.diag([sigma_m**2, sigma_m**2, sigma_rad**2]))


def assert_is_true(fix: Estimate, tolerance: float = 1e-6) -> None:
    assert isinstance(fix, Fix)
    np.testing.assert_allclose(fix.pose_map_base.array(), TRUE.array(), atol=tolerance)


@pytest.mark.parametrize("told", [{"ranges": False}, {}, {"bearings": True}])
def test_four_landmarks_tell_the_pose_of_base_without_a_belief(told: dict[str, bool]) -> None:
    (fix,) = observe(localizer(), sightings([0, 1, 2, 3], **told))
    assert_is_true(fix)
    assert np.linalg.matrix_rank(fix.information) == 3  # type: ignore[union-attr]  # a fix, as was asserted


@pytest.mark.parametrize("wrong", [0, 3, 5])
def test_an_outlier_among_many_bearings_does_not_move_the_pose(wrong: int) -> None:
    arrays = sightings([0, 1, 2, 3, 4, 5], ranges=False)
    arrays["bearings_rad"][wrong] += 0.7
    (fix,) = observe(localizer(), arrays)
    assert_is_true(fix)
    assert isinstance(fix, Fix)
    assert fix.details["agree"] == 5


def test_an_outlier_among_four_bearings_is_seen_but_not_found() -> None:
    arrays = sightings([0, 1, 2, 3], ranges=False)
    arrays["bearings_rad"][2] += 0.7
    (answer,) = observe(localizer(), arrays)
    assert isinstance(answer, Lost)


def test_three_bearings_alone_are_no_pose_because_nothing_could_contradict_them() -> None:
    (answer,) = observe(localizer(), sightings([0, 1, 2], ranges=False))
    assert isinstance(answer, Lost)
    assert "four are needed" in answer.reason


MIRROR = MANY * [-1.0, 1.0]


def test_a_mirrored_map_tells_no_pose_though_all_ranges_agree_with_it() -> None:
    arrays = sightings([0, 1, 2, 3, 4, 5, 6])
    (answer,) = observe(localizer(MIRROR), arrays)
    assert isinstance(answer, Lost)
    assert "of 7 bearings agree" in answer.reason


def test_bearings_in_a_wrong_unit_tell_no_pose_though_all_ranges_agree() -> None:
    arrays = sightings([0, 1, 2, 3, 4, 5, 6])
    arrays["bearings_rad"] = np.degrees(arrays["bearings_rad"])
    (answer,) = observe(localizer(), arrays)
    assert isinstance(answer, Lost)
    assert "of 7 bearings agree" in answer.reason


def test_a_sighting_that_is_told_often_counts_once() -> None:
    once, often = (observe(localizer(), sightings(ids))[0] for ids in ([0, 1, 2, 3], [0, 1, 2, 3] * 30))
    assert isinstance(once, Fix)
    assert isinstance(often, Fix)
    np.testing.assert_array_equal(often.information, once.information)
    assert often.details == once.details


def test_ranges_alone_say_that_they_tell_no_heading() -> None:
    (answer,) = observe(localizer(), sightings([0, 1, 2, 3], bearings=False))
    assert isinstance(answer, Lost)
    assert "heading" in answer.reason


def test_landmarks_in_one_place_tell_no_pose() -> None:
    heap = np.full((4, 2), 4.0)
    (answer,) = observe(localizer(heap), sightings([0, 1, 2, 3], landmarks=heap, ranges=False))
    assert isinstance(answer, Lost)


@pytest.mark.parametrize(("told", "rank"), [({"bearings": False}, 1), ({"ranges": False}, 1), ({}, 2)])
def test_a_single_landmark_tells_no_more_than_was_seen_of_it(told: dict[str, bool], rank: int) -> None:
    (fix,) = observe(localizer(), sightings([1], **told), believing(TRUE))
    assert isinstance(fix, Fix)
    assert np.linalg.matrix_rank(fix.information, tol=1e-6 * np.abs(fix.information).max()) == rank


@pytest.mark.parametrize("told", [{"bearings": False}, {"ranges": False}, {}])
def test_single_landmarks_pull_a_belief_to_the_truth(told: dict[str, bool]) -> None:
    believed = Pose2(TRUE.x + 0.15, TRUE.y - 0.1, TRUE.theta + 0.05)
    mean, covariance = believed.array(), np.diag([0.04, 0.04, 0.01])
    found = localizer(learn_noise=False, range_sigma_m=0.01, bearing_sigma_deg=0.1, mounting_sigma_deg=0.0)
    for _ in range(3):
        for landmark in (1, 2, 3):
            belief = Belief(1.0, Pose2.from_array(mean), covariance)
            (fix,) = observe(found, sightings([landmark], **told), belief)
            assert isinstance(fix, Fix)
            narrowed = np.linalg.inv(np.linalg.inv(covariance) + fix.information)
            mean = mean + narrowed @ fix.information @ (fix.pose_map_base.array() - mean)
            covariance = narrowed
    miss = mean - TRUE.array()
    assert np.abs(miss[:2]).max() < 0.02
    assert miss @ np.linalg.inv(covariance) @ miss < 9.0  # ranges hardly tell the heading, and say so


def test_noise_is_learnt_from_what_is_left_over() -> None:
    rng = np.random.default_rng(0)
    found = localizer(bearing_sigma_deg=1.0)
    for _ in range(400):
        arrays = sightings([0, 1, 2, 3, 4, 5, 6], ranges=False)
        arrays["bearings_rad"] = arrays["bearings_rad"] + rng.normal(scale=math.radians(2.5), size=7)
        observe(found, arrays)
    (fix,) = observe(found, sightings([0, 1, 2, 3, 4, 5, 6], ranges=False))
    assert isinstance(fix, Fix)
    assert 2.0 < fix.details["bearing_sigma_deg"] < 3.2


def range_sigma_m(off_m: Floats) -> float:
    """Return the noise that is learnt from single ranges that are off by these from what a sure belief expects."""
    found = localizer(range_sigma_m=0.1)
    for error_m in off_m.tolist():
        arrays = sightings([1], bearings=False)
        arrays["ranges_m"] = arrays["ranges_m"] + error_m
        (fix,) = observe(found, arrays, believing(TRUE, sigma_m=0.01, sigma_rad=0.01))
    assert isinstance(fix, Fix)
    return fix.details["range_sigma_m"]


def test_a_belief_that_is_wrong_by_metres_is_not_taken_for_noise() -> None:
    assert range_sigma_m(np.full(200, 2.0)) == pytest.approx(0.1)


def test_noise_that_is_three_times_as_large_is_learnt_from_single_sightings() -> None:
    assert 0.2 < range_sigma_m(np.random.default_rng(4).normal(scale=0.3, size=400)) < 0.4


@pytest.mark.parametrize("sigma_deg", [0.3, 1.0, 3.0])
def test_poses_are_as_wrong_as_they_say(sigma_deg: float) -> None:
    rng = np.random.default_rng(1)
    found, ratios = localizer(mounting_sigma_deg=0.0), []
    for _ in range(600):
        arrays = sightings([0, 1, 2, 3, 4, 5, 6], ranges=False)
        arrays["bearings_rad"] = arrays["bearings_rad"] + rng.normal(scale=math.radians(sigma_deg), size=7)
        (fix,) = observe(found, arrays)
        if isinstance(fix, Fix):
            miss = fix.pose_map_base.array() - TRUE.array()
            ratios.append(float(miss @ fix.information @ miss) / 3.0)
    assert len(ratios) > 540
    assert 0.5 < np.mean(ratios[100:]) < 1.5


def test_errors_that_last_are_given_less_weight() -> None:
    rng = np.random.default_rng(2)
    sigmas = []
    for lasts in (1, 20):
        found, offset = localizer(), 0.0
        for index in range(400):
            if index % lasts == 0:
                offset = rng.normal(scale=0.1)
            arrays = sightings([1], bearings=False)
            arrays["ranges_m"] = arrays["ranges_m"] + offset
            frame = Frame("seen", 0.2 * index, Record(arrays))
            estimates = found.observe(frame, believing(TRUE, sigma_m=0.01, sigma_rad=0.01))
        (fix,) = estimates
        assert isinstance(fix, Fix)
        sigmas.append(fix.details["range_sigma_m"])
    assert sigmas[1] > 1.5 * sigmas[0]


def test_strangers_are_counted_and_say_nothing_once_a_landmark_was_seen() -> None:
    found = localizer()
    stranger = {"ids": np.array([99]), "ranges_m": np.array([1.0])}
    (answer,) = observe(found, stranger)
    assert isinstance(answer, Lost)
    assert "99" in answer.reason
    observe(found, sightings([0], bearings=False), believing(TRUE))
    assert observe(found, stranger) == []
    assert found.counters() == {"unknown_landmarks": 2}


def test_readings_that_hang_while_the_robot_drives_are_no_pose_and_at_rest_they_are() -> None:
    arrays, answers = sightings([0, 1, 2, 3]), []
    found = localizer()
    for travelled_m in (0.0, 0.0, 0.05, 0.3, 0.5):
        frame = Frame("seen", 1.0 + travelled_m, Record(arrays))
        answers += found.observe(frame, replace(believing(TRUE), travelled_m=travelled_m))
    assert [isinstance(answer, Fix) for answer in answers] == [True, True, True, False, False]
    arrays = sightings([0, 1, 2])
    (answer,) = found.observe(Frame("seen", 2.0, Record(arrays)), replace(believing(TRUE), travelled_m=0.6))
    assert isinstance(answer, Fix)


def test_places_may_stand_in_the_config() -> None:
    found = KnownLandmarks(KnownLandmarksConfig(sightings="seen", landmarks={7: (4.0, 3.0)}))
    found.start(Session(sensors={"seen": SensorInfo("seen", "range")}))
    record = Record({"ids": np.array([7]), "ranges_m": np.array([3.0])})
    (fix,) = found.observe(Frame("seen", 1.0, record), believing(Pose2(1.2, 3.0)))
    assert isinstance(fix, Fix)


def test_places_that_nobody_tells_are_asked_for() -> None:
    found = KnownLandmarks(KnownLandmarksConfig(sightings="seen"))
    with pytest.raises(ConfigError, match=r"sensor 'seen' does not say where its landmarks stand; write landmarks:"):
        found.start(Session(sensors={"seen": SensorInfo("seen", "range")}))
