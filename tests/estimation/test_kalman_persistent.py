"""Absolute estimates that are rejected most of the time: the belief is wide, until it is found again."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Belief, Fix, Motion, information_from_sigmas, range_fix
from trailmark.estimation.kalman.dissent import covering_covariance
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman.lasting_errors import UNAFFECTED
from trailmark.estimation.kalman.measurements import fix_measurement
from trailmark.estimation.kalman.recovery import directions_of
from trailmark.estimation.kalman.state import FilterState, Gaussian, RejectedMeasurement, Rejections
from trailmark.estimation.kalman.trust import Trust
from trailmark.estimation.symmetric import Sym3, diagonal
from trailmark.geometry import Pose2

from .conftest import kalman, pose_of

DT_S = 0.1
STEP = Pose2.exp(0.3 * DT_S, 0.0, 0.15 * DT_S)
WHEELS = information_from_sigmas(2e-3, 1e-3, 4e-3)
BEACONS = {"a": (0.0, 0.0), "b": (6.0, 0.0), "c": (6.0, 5.0), "d": (0.0, 5.0)}
TRUST = Trust(0.999, "none", 2.0, 1.0, (1e-6, 1e-6), None)


def sigmas_off(belief: Belief, true: Pose2) -> tuple[float, float]:
    """Return how far the position and the heading are off, in standard deviations."""
    assert belief.covariance is not None
    away = true.array() - pose_of(belief).array()
    position = math.sqrt(float(away[:2] @ np.linalg.solve(belief.covariance[:2, :2], away[:2])))
    heading = abs(math.remainder(float(away[2]), 2.0 * math.pi)) / math.sqrt(belief.covariance[2, 2])
    return position, heading


def test_a_camera_that_is_mounted_askew_leaves_no_sure_belief() -> None:
    """Every pose is right but for the heading, 90 deg: no way fits it, and no pose does."""
    rng = np.random.default_rng(3)
    estimator, true, off = kalman(None), Pose2(2.0, 1.0, 0.3), []
    for i in range(1, 301):
        true = true @ STEP
        stamp_s = DT_S * i
        step = STEP @ Pose2(*(rng.normal(size=3) * (2e-3, 1e-3, 4e-3)).tolist())
        estimator.apply("wheels", Motion(stamp_s - DT_S, stamp_s, step, WHEELS))
        if i % 5 == 0:
            dx, dy, turn = (rng.normal(size=3) * 0.02).tolist()
            told = Pose2(true.x + dx, true.y + dy, true.theta - math.pi / 2.0 + turn)
            estimator.apply("camera", Fix(stamp_s, told, information_from_sigmas(0.02, 0.02, 0.02)))
        if stamp_s > 5.0:
            off.append(sigmas_off(estimator.belief(stamp_s), true))

    assert np.quantile(off, 0.95, axis=0).max() < 4.0
    assert "contradicts the belief" in estimator.belief(30.0).health["camera"]


def drive_among_beacons(estimator: Kalman, until_s: float, true: Pose2) -> Pose2:
    """Drive on with ranges to four beacons twice a second; return the true pose at the end."""
    rng = np.random.default_rng(7)
    for i in range(1, round(until_s / DT_S) + 1):
        true, stamp_s = true @ STEP, DT_S * i
        step = STEP @ Pose2(*(rng.normal(size=3) * (2e-3, 1e-3, 4e-3)).tolist())
        estimator.apply("wheels", Motion(stamp_s - DT_S, stamp_s, step, WHEELS))
        if i % 5 == 0:
            for place in BEACONS.values():
                range_m = math.hypot(place[0] - true.x, place[1] - true.y) + rng.normal() * 0.05
                estimator.apply("beacons", range_fix(estimator.belief(stamp_s), place, range_m, 0.1))
    return true


def test_ranges_alone_find_a_start_that_is_wrong_by_metres_and_half_a_turn() -> None:
    estimator = kalman(Pose2(5.0, 4.0, math.pi))

    true = drive_among_beacons(estimator, 20.0, Pose2(2.0, 1.0, 0.3))

    belief = estimator.belief(20.0)
    assert math.hypot(pose_of(belief).x - true.x, pose_of(belief).y - true.y) < 0.2
    assert abs(pose_of(belief).between(true).theta) < math.radians(10.0)
    assert max(sigmas_off(belief, true)) < 4.0


def line_at(x: float, y: float, odom: Pose2, stamp_s: float = 1.0) -> RejectedMeasurement:
    """Return a range along x that was rejected where odometry stood."""
    information: Sym3 = (2500.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    fix = Fix(stamp_s, Pose2(x, y), np.diag([2500.0, 0.0, 0.0]))
    return RejectedMeasurement(stamp_s, odom, fix_measurement("beacons", fix, information, TRUST))


def pose_at(x: float, y: float, odom: Pose2, stamp_s: float = 1.0) -> RejectedMeasurement:
    certain = 0.02**-2
    fix = Fix(stamp_s, Pose2(x, y), information_from_sigmas(0.02, 0.02, 0.02))
    measurement = fix_measurement("camera", fix, diagonal(certain, certain, certain), TRUST)
    return RejectedMeasurement(stamp_s, odom, measurement)


def test_a_place_that_is_measured_along_a_way_tells_the_heading() -> None:
    here, before = Pose2(), Pose2(-1.0, -1.0)

    assert directions_of([line_at(1.0, 0.0, here)], here, np.zeros(3)) == 1
    assert directions_of([line_at(1.0, 0.0, here)] * 2, here, np.zeros(3)) == 1
    assert directions_of([line_at(1.0, 0.0, here), line_at(1.0, 0.0, before)], here, np.zeros(3)) == 2


def covered(*rejected: RejectedMeasurement, share: float = 1.0) -> np.ndarray:
    source = rejected[0].measurement.source
    rejections = Rejections(counts={source: 1}, measurements={source: rejected}, shares={source: share})
    gaussian = Gaussian(np.zeros(3), np.eye(3) * 1e-6, UNAFFECTED)
    return np.asarray(covering_covariance(FilterState(1.0, gaussian, rejections=rejections), gaussian))


def test_a_constant_offset_says_nothing_of_the_heading() -> None:
    covariance = covered(pose_at(-1.0, 1.0, Pose2(-1.0)), pose_at(0.0, 1.0, Pose2()))

    assert covariance[1, 1] == pytest.approx(0.2, rel=1e-4)
    assert covariance[2, 2] == pytest.approx(1e-6)


def test_a_way_that_goes_aside_covers_its_heading() -> None:
    covariance = covered(pose_at(0.0, -1.0, Pose2(-1.0)), pose_at(0.0, 0.0, Pose2()))

    assert covariance[2, 2] == pytest.approx(0.2 * (math.pi / 2.0) ** 2, rel=1e-4)


def test_parts_of_poses_are_covered_when_a_third_is_rejected() -> None:
    once, often = covered(line_at(2.0, 0.0, Pose2()), share=0.3), covered(line_at(2.0, 0.0, Pose2()), share=0.4)

    np.testing.assert_array_equal(once, np.eye(3) * 1e-6)
    assert 2.0 / math.sqrt(often[0, 0]) < 4.0
    assert often[1, 1] == pytest.approx(1e-6)
    assert math.pi / math.sqrt(often[2, 2]) < 2.0


def test_one_that_says_whole_poses_and_parts_of_poses_may_be_wrong_with_both() -> None:
    estimator, true = kalman(), Pose2()
    parts = np.diag([2500.0, 2500.0, 0.0])
    for i in range(1, 200):
        true, stamp_s = true @ STEP, DT_S * i
        estimator.apply("wheels", Motion(stamp_s - DT_S, stamp_s, STEP, WHEELS))
        if i % 5 == 0:
            wrong = Pose2(true.x + 3.0 * math.sin(i), true.y + 3.0 * math.cos(2.3 * i), true.theta + 1.5)
            is_part = (i // 5) % 3 == 0
            estimator.apply(
                "camera", Fix(stamp_s, wrong, parts if is_part else information_from_sigmas(0.02, 0.02, 0.01))
            )
        belief = estimator.belief(stamp_s)

    assert belief.covariance is not None
    assert np.linalg.eigvalsh(belief.covariance).min() > 0.0
    assert sigmas_off(belief, true)[0] < 4.0
