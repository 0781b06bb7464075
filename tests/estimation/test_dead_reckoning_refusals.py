"""What dead reckoning refuses, and what comes too late for it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import (
    Applied,
    Estimate,
    Fix,
    Motion,
    PathOffset,
    information_from_sigmas,
)
from trailmark.geometry import Pose2
from trailmark.paths import Path, Waypoint

from .conftest import GOOD, dead_reckoning, drive, motion, pose_of


def straight_path(length_m: float = 10.0) -> Path:
    n = round(length_m / 0.05) + 1
    return Path(Waypoint(i, 0.05 * i, Pose2(0.05 * i, 0.0, 0.0)) for i in range(n))


class TestRefusals:
    @pytest.mark.parametrize(
        ("information", "reason"),
        [
            (np.full((3, 3), np.nan), "not finite"),
            (np.diag([1.0, -1.0, 1.0]), "negative"),
            (np.array([[1.0, 0.5, 0], [0, 1, 0], [0, 0, 1]]), "not symmetric"),
        ],
    )
    @pytest.mark.parametrize("kind", ["motion", "fix", "offset"])
    def test_malformed_information_is_refused(self, kind: str, information: np.ndarray, reason: str) -> None:
        estimator = dead_reckoning(path=straight_path())
        estimate: Estimate = {
            "motion": Motion(0.0, 1.0, Pose2(1.0), information),
            "fix": Fix(1.0, Pose2(1.0), information),
            "offset": PathOffset(1.0, 1.0, 0.0, 0.0, information),
        }[kind]

        applied = estimator.apply("bad", estimate)

        assert applied.status == "refused"
        assert reason in applied.reason
        assert estimator.belief(1.0).pose_map_base == Pose2()

    def test_a_fix_that_says_nothing_is_refused(self) -> None:
        assert dead_reckoning().apply("bad", Fix(1.0, Pose2(), np.zeros((3, 3)))) == Applied(
            "refused", "it has no information"
        )

    @pytest.mark.parametrize("stamp_s", [math.nan, math.inf])
    def test_a_stamp_that_cannot_be_is_refused(self, stamp_s: float) -> None:
        estimator = dead_reckoning()

        assert estimator.apply("bad", Fix(stamp_s, Pose2(), GOOD)).status == "refused"
        assert estimator.belief(1.0).stamp_s == 1.0

    def test_a_path_offset_of_nan_is_refused(self) -> None:
        applied = dead_reckoning(path=straight_path()).apply("bad", PathOffset(0.0, math.nan, 0.0, 0.0, GOOD))

        assert applied == Applied("refused", "the path offset is not finite")

    def test_what_is_older_than_the_history_is_late(self) -> None:
        estimator = dead_reckoning(history_s=1.0)
        drive(estimator, 140)  # 2 s
        before = estimator.belief()

        fix = estimator.apply("map", Fix(0.9, Pose2(9.0, 9.0, 0.0), GOOD))
        old = estimator.apply("vo", motion(0.0, 0.5, 1.0))

        assert fix.status == "late"
        assert "1.100 s old, the history reaches back 1 s" in fix.reason
        assert old.status == "late"
        assert estimator.belief().pose_map_base == before.pose_map_base

    def test_a_belief_older_than_the_history_says_its_own_stamp(self) -> None:
        estimator = dead_reckoning(history_s=1.0)
        drive(estimator, 210)

        belief = estimator.belief(0.5)

        assert 1.9 < belief.stamp_s <= 2.0
        assert belief.pose_map_base == estimator.belief(belief.stamp_s).pose_map_base

    def test_a_motion_without_information_still_moves_but_is_uncertain(self) -> None:
        estimator = dead_reckoning()

        estimator.apply("ticks", Motion(0.0, 1.0, Pose2(1.0), information_from_sigmas(0.01, math.inf, math.inf)))

        belief = estimator.belief()
        assert pose_of(belief).x == 1.0
        assert belief.covariance is not None
        assert math.sqrt(belief.covariance[0, 0]) < 0.02
        assert math.sqrt(belief.covariance[1, 1]) == pytest.approx(0.5, rel=0.05)  # the drift's 0.5 m/s
