"""The option ``correct`` of every localizer: motions that are wrong in a known way."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.config import MotionCorrection
from trailmark.estimates import Lost, Motion, information_along, information_from_covariance
from trailmark.geometry import Pose2
from trailmark.pipeline.localizers.correcting import corrected_motion, with_corrected_motions


def motion(pose: Pose2, covariance: np.ndarray) -> Motion:
    return Motion(1.0, 1.1, pose, information_from_covariance(covariance), {"quality": 0.5})


def test_an_arc_is_longer_and_bends_more_by_its_factors():
    correction = MotionCorrection(way=1.1, turn=0.9, turn_deg_per_m=2.0, way_m_per_rad=0.05)
    told = motion(Pose2.exp(0.5, 0.02, 0.3), np.diag([1e-4, 1e-4, 1e-4]))

    right = corrected_motion(told, correction.matrix())

    expected = Pose2.exp(1.1 * 0.5 + 0.05 * 0.3, 1.1 * 0.02, 0.9 * 0.3 + math.radians(2.0) * 0.5)
    np.testing.assert_allclose(right.pose_since_now.array(), expected.array(), atol=1e-12)
    assert (right.since_s, right.stamp_s, right.details["quality"]) == (1.0, 1.1, 0.5)


def test_the_information_is_that_of_corrected_samples():
    rng, correction = np.random.default_rng(7), MotionCorrection(way=1.2, turn=0.8, turn_deg_per_m=5.0)
    cov = np.array([[4e-6, 1e-6, 0.0], [1e-6, 2e-6, 5e-7], [0.0, 5e-7, 3e-6]])
    told = motion(Pose2(0.4, 0.1, 0.5), cov)

    samples = np.array(
        [
            corrected_motion(motion(Pose2.from_array(values), cov), correction.matrix()).pose_since_now.array()
            for values in rng.multivariate_normal(told.pose_since_now.array(), cov, size=2000)
        ]
    )

    stated = np.linalg.inv(corrected_motion(told, correction.matrix()).information)
    np.testing.assert_allclose(np.cov(samples.T), stated, atol=5e-7)


def test_what_was_not_measured_stays_unmeasured():
    told = Motion(0.0, 0.1, Pose2(0.0, 0.0, 0.2), information_along((0.0, 0.0, 1.0), 0.01))

    right = corrected_motion(told, MotionCorrection(turn=2.0).matrix())

    np.testing.assert_allclose(right.information, np.diag([0.0, 0.0, 2500.0]), atol=1e-4)


def test_other_estimates_are_left_alone():
    lost = Lost(1.0, "dark")

    assert with_corrected_motions([lost], MotionCorrection(way=2.0)) == (lost,)


def test_a_correction_that_leaves_nothing_is_refused():
    with pytest.raises(ValueError, match="nothing would be left of the motion"):
        MotionCorrection(way=0.0)


@pytest.mark.parametrize("key", ["way", "turn", "turn_deg_per_m", "way_m_per_rad"])
@pytest.mark.parametrize("value", [1e300, -1e300])
def test_a_correction_beyond_all_robots_is_refused(key: str, value: float):
    with pytest.raises(ValueError, match=rf"{key}\n  Input should be (less|greater) than or equal to"):
        MotionCorrection(**{key: value})
