"""Absolute poses from elsewhere as fixes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Belief, Fix, Lost
from trailmark.frames import Frame, Record, SensorInfo
from trailmark.geometry import Pose2, Pose3
from trailmark.interfaces import Session
from trailmark_baselines.config import PoseFixesConfig
from trailmark_baselines.pose_fixes import PoseFixes

UNTOLD = np.full((3, 3), np.nan)
SATELLITES = np.diag([np.nan, np.nan, np.inf])


def told(
    covariance: np.ndarray, mounting: Pose3 | None = None, believed: Pose2 | None = None, **keys: float
) -> Fix | Lost:
    localizer = PoseFixes(PoseFixesConfig(poses="mocap", **keys))
    info = SensorInfo("mocap", "pose", pose_base_sensor=mounting or Pose3())
    localizer.start(Session(sensors={"mocap": info}))
    record = Record({"pose": np.array([2.0, 1.0, math.pi / 2]), "covariance": covariance})
    (estimate,) = localizer.observe(Frame("mocap", 1.0, record), Belief(1.0, believed))
    assert isinstance(estimate, Fix | Lost)
    return estimate


def test_a_pose_is_a_fix_as_exact_as_it_says() -> None:
    fix = told(np.diag([0.04, 0.01, 0.0025]))

    assert isinstance(fix, Fix)
    assert fix.pose_map_base == Pose2(2.0, 1.0, math.pi / 2)
    np.testing.assert_allclose(fix.information, np.diag([25.0, 100.0, 400.0]))


def test_the_mounting_is_taken_off() -> None:
    """The sensor sits 0.5 m ahead of base, which heads along y: base is 0.5 m lower."""
    fix = told(np.eye(3), Pose3(x=0.5))

    assert isinstance(fix, Fix)
    np.testing.assert_allclose(fix.pose_map_base.array(), [2.0, 0.5, math.pi / 2], atol=1e-12)


def test_a_receiver_that_knows_no_heading_informs_of_none() -> None:
    fix = told(SATELLITES, believed=Pose2(0.0, 0.0, 0.3), sigma=2.0)

    assert isinstance(fix, Fix)
    assert fix.pose_map_base == Pose2(2.0, 1.0, 0.3)
    np.testing.assert_allclose(fix.information, np.diag([0.25, 0.25, 0.0]))


def test_the_configs_sigma_is_a_floor_where_the_reading_says_one() -> None:
    fix = told(np.diag([1e-8, 4.0, 1e-8]), sigma=0.5, sigma_deg=math.degrees(0.1))

    assert isinstance(fix, Fix)
    np.testing.assert_allclose(fix.information, np.diag([4.0, 0.25, 100.0]))


@pytest.mark.parametrize(
    ("covariance", "mounting", "reason"),
    [
        (UNTOLD, Pose3(), "set sigma and sigma_deg"),
        (np.diag([1.0, 1.0, np.inf]), Pose3(x=1.0), "does not sit at base"),
        (np.full((3, 3), 1e-30), Pose3(), "not positive definite"),
        (np.array([[0.01, 5.0, 0.0], [5.0, 0.01, 0.0], [0.0, 0.0, 0.01]]), Pose3(), "not positive definite"),
        (np.diag([0.01, -1.0, 0.01]), Pose3(), "not positive definite"),
    ],
)
def test_what_cannot_be_weighed_is_lost(covariance: np.ndarray, mounting: Pose3, reason: str) -> None:
    lost = told(covariance, mounting)

    assert isinstance(lost, Lost)
    assert reason in lost.reason
