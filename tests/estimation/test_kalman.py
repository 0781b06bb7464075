"""The Kalman estimator: prediction, correction, any order of arrival, odometry that never jumps."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest

from trailmark.estimates import (
    Applied,
    Belief,
    Estimate,
    Fix,
    Lost,
    Motion,
    PathOffset,
    information_along,
    information_from_covariance,
    information_from_sigmas,
)
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.geometry import Pose2
from trailmark.paths import Path, Waypoint

from .conftest import EKF_ONLY, GOOD, ORIGIN, kalman, pose_of

pytestmark = pytest.mark.usefixtures("kind")

FAIR = information_from_sigmas(0.1, 0.1, 0.05)
AHEAD = Pose2(0.1)


Told = tuple[str, Estimate]


def covariance_of(belief: Belief) -> np.ndarray:
    assert belief.covariance is not None
    return belief.covariance


def drive(estimator: Kalman, n: int, step: Pose2 = AHEAD, source: str = "wheels", first: int = 0) -> None:
    for i in range(first, first + n):
        assert estimator.apply(source, Motion(0.1 * i, 0.1 * (i + 1), step, GOOD)) == Applied("accepted")


def told(estimator: Kalman, estimates: Sequence[Told]) -> Belief:
    for source, estimate in estimates:
        assert estimator.apply(source, estimate).status in {"accepted", "gated"}
    return estimator.belief(max(estimate.stamp_s for _, estimate in estimates))


def test_each_test_runs_with_both_filters(kind: str) -> None:
    assert kalman().config.filter == kind


class TestMotion:
    """Covariances worked out by hand are of the noise that is stated: errors that last have tests of their own."""

    @EKF_ONLY
    def test_motion_is_chained_and_its_covariance_adds_up(self) -> None:
        estimator = kalman(calibration_sigma=0.0)

        drive(estimator, 10)

        belief = estimator.belief()
        assert belief.stamp_s == 1.0
        assert pose_of(belief).x == pytest.approx(1.0, abs=1e-12)
        assert covariance_of(belief)[0, 0] == pytest.approx(0.01**2 + 10 * 1e-6)
        lever_m2 = sum((0.1 * k) ** 2 for k in range(10)) * 1e-6 + 1.0 * math.radians(0.5) ** 2
        assert covariance_of(belief)[1, 1] == pytest.approx(0.01**2 + 10 * 1e-6 + lever_m2, rel=1e-9)
        assert belief.travelled_m == pytest.approx(1.0)
        assert belief.twist.forward_mps == pytest.approx(1.0)
        assert belief.motion_age_s == 0.0
        assert belief.fix_age_m == math.inf

    @EKF_ONLY
    def test_a_motion_cut_by_a_fix_that_says_nothing_new_is_as_uncertain_as_in_one_piece(self) -> None:
        covariance = np.array([[1e-4, 2e-5, 1e-5], [2e-5, 3e-4, 9e-5], [1e-5, 9e-5, 1e-4]])
        motion = Motion(0.0, 1.0, Pose2(1.0, 0.2, 0.4), information_from_covariance(covariance))
        whole, cut = kalman(calibration_sigma=0.0), kalman(calibration_sigma=0.0)

        whole.apply("vo", motion)
        cut.apply("vo", motion)
        cut.apply("nothing", Fix(0.3, Pose2(50.0, 50.0, 1.0), information_from_sigmas(1e9, 1e9, 1e9)))

        np.testing.assert_allclose(covariance_of(cut.belief(1.0)), covariance_of(whole.belief(1.0)), rtol=1e-9)
        np.testing.assert_allclose(pose_of(cut.belief(1.0)).array(), pose_of(whole.belief(1.0)).array(), atol=1e-9)

    @EKF_ONLY
    def test_two_localizers_of_the_same_motion_are_weighed(self) -> None:
        estimator = kalman(calibration_sigma=0.0)

        estimator.apply("good", Motion(0.0, 1.0, Pose2(1.0), information_from_sigmas(0.1, 0.1, 0.1)))
        estimator.apply("poor", Motion(0.0, 1.0, Pose2(1.5), information_from_sigmas(0.2, 0.2, 0.2)))

        belief = estimator.belief(1.0)
        assert pose_of(belief).x == pytest.approx((1.0 * 100 + 1.5 * 25) / 125)
        assert covariance_of(belief)[0, 0] == pytest.approx(0.01**2 + 1 / 125)

    def test_covariance_intersection_gains_nothing_from_agreement(self) -> None:
        estimator = kalman(motions="intersection", calibration_sigma=0.0)

        for source in ("a", "b"):
            estimator.apply(source, Motion(0.0, 1.0, Pose2(1.0), information_from_sigmas(0.1, 0.1, 0.1)))

        assert covariance_of(estimator.belief(1.0))[0, 0] == pytest.approx(0.01**2 + 0.1**2)

    @EKF_ONLY
    def test_a_gyro_and_a_distance_make_one_motion(self) -> None:
        estimator = kalman()

        for i in range(20):
            since_s, stamp_s = 0.1 * i, 0.1 * (i + 1)
            turn = Motion(since_s, stamp_s, Pose2(0.0, 0.0, 0.05), information_from_sigmas(np.inf, np.inf, 1e-3))
            way = Motion(since_s, stamp_s, Pose2(0.1), information_from_sigmas(1e-3, 1e-3, np.inf))
            estimator.apply("gyro", turn)
            estimator.apply("wheel", way)

        expected = ORIGIN
        for _ in range(20):
            expected = expected @ Pose2(0.1, 0.0, 0.05)
        np.testing.assert_allclose(pose_of(estimator.belief()).array(), expected.array(), atol=1e-9)

    def test_a_direction_that_nobody_measured_goes_on_and_drifts(self) -> None:
        estimator = kalman()
        drive(estimator, 1, Pose2(0.1, 0.0, 0.02))

        estimator.apply("wheels", Motion(0.1, 0.2, Pose2(0.1), information_from_sigmas(1e-3, 1e-3, np.inf)))

        belief = estimator.belief()
        assert pose_of(belief).theta == pytest.approx(0.04, abs=1e-6)
        assert covariance_of(belief)[2, 2] > math.radians(5.0) ** 2

    @EKF_ONLY
    def test_motions_of_one_localizer_that_overlap_count_once(self) -> None:
        estimator = kalman()

        estimator.apply("vo", Motion(0.0, 1.0, Pose2(1.0), GOOD))
        estimator.apply("vo", Motion(0.5, 1.5, Pose2(1.0), GOOD))

        assert pose_of(estimator.belief()).x == pytest.approx(1.5)

    @EKF_ONLY
    def test_a_gap_is_coasted_and_then_base_stands(self) -> None:
        estimator = kalman()
        drive(estimator, 10)

        soon, late, later = (estimator.belief(stamp_s) for stamp_s in (1.5, 3.0, 4.0))

        assert pose_of(soon).x == pytest.approx(1.5)
        assert soon.motion_age_s == pytest.approx(0.5)
        assert pose_of(late).x == pytest.approx(2.0)
        assert late.travelled_m == pytest.approx(2.0)
        assert covariance_of(later)[0, 0] > covariance_of(late)[0, 0] > covariance_of(soon)[0, 0]


class TestCorrection:
    def test_a_fix_is_weighed_against_the_belief(self) -> None:
        estimator = kalman(start_sigma_m=0.1)

        applied = estimator.apply("camera", Fix(0.0, Pose2(0.1), information_from_sigmas(0.1, 0.1, 0.1)))

        assert applied.status == "accepted"
        assert applied.dof == 3
        assert applied.nis == pytest.approx(0.1**2 / (0.1**2 + 0.1**2))
        assert pose_of(estimator.belief(0.0)).x == pytest.approx(0.05)

    @EKF_ONLY
    def test_an_unmeasured_direction_costs_nothing_and_hurts_nothing(self) -> None:
        estimator = kalman()
        along = information_along((1.0, 1.0, 0.0), 0.01)

        applied = estimator.apply("camera", Fix(0.0, Pose2(1.0, -1.0, 3.0), along))

        assert applied.dof == 1
        assert applied.nis == pytest.approx(0.0, abs=1e-20)
        assert pose_of(estimator.belief(0.0)) == ORIGIN

    def test_a_heading_is_compared_the_short_way_round(self) -> None:
        estimator = kalman(start_pose=Pose2(0.0, 0.0, math.pi - 0.01), start_sigma_deg=5.0)

        estimator.apply("compass", Fix(0.0, Pose2(0.0, 0.0, -math.pi + 0.01), FAIR))

        believed = pose_of(estimator.belief(0.0))
        assert math.pi - abs(believed.theta) < 0.0101
        assert believed.y == pytest.approx(0.0, abs=1e-12)

    def test_path_offsets_correct_across_the_path(self) -> None:
        path = Path(Waypoint(i, 0.1 * i, Pose2(0.0, 0.1 * i, math.pi / 2)) for i in range(50))
        estimator = kalman(Pose2(0.0, 1.0, math.pi / 2), path, start_sigma_m=0.5, start_sigma_deg=20.0)
        across = information_from_sigmas(np.inf, 1e-3, 1e-3)

        applied = estimator.apply("divs", PathOffset(0.0, 1.0, 0.2, 0.1, across))

        believed = estimator.belief(0.0)
        assert applied.dof == 2
        np.testing.assert_allclose(pose_of(believed).array(), [-0.2, 1.0, math.pi / 2 + 0.1], atol=1e-3)
        assert believed.on_path is not None
        assert believed.on_path.lateral_m == pytest.approx(0.2, abs=1e-3)

    def test_from_nowhere_the_first_whole_fix_says_where(self) -> None:
        estimator = kalman(start_pose=None)
        drive(estimator, 5)

        part = estimator.apply("compass", Fix(0.5, ORIGIN, information_from_sigmas(np.inf, np.inf, 0.1)))
        assert estimator.belief().pose_map_base is None
        whole = estimator.apply("camera", Fix(0.5, Pose2(7.0, 8.0, 0.5), FAIR))

        assert part.status == "unused"
        assert "says 1 of its 3 numbers" in part.reason
        assert whole.status == "accepted"
        assert pose_of(estimator.belief()).x == pytest.approx(7.0)

    def test_ages_count_from_the_last_accepted_estimate(self) -> None:
        estimator = kalman()
        drive(estimator, 10)

        estimator.apply("camera", Fix(0.5, Pose2(0.5), FAIR))

        assert estimator.belief().fix_age_m == pytest.approx(0.5)

    @EKF_ONLY
    def test_a_fix_that_contradicts_is_gated_and_says_why(self) -> None:
        estimator = kalman()
        drive(estimator, 10)

        applied = estimator.apply("camera", Fix(1.0, Pose2(4.0), FAIR))

        assert applied.status == "gated"
        assert "the gate is 16.3" in applied.reason
        assert pose_of(estimator.belief()).x == pytest.approx(1.0)


# What a run may hear: two odometries of their own rates, a camera that sees three numbers, a compass, a beacon.
def _heard(seed: int) -> list[Told]:
    rng = np.random.default_rng(seed)
    loose = information_from_sigmas(0.02, 0.02, 0.03)
    quick = [Motion(0.1 * i, 0.1 * (i + 1), Pose2(*rng.normal((0.1, 0, 0.05), 0.01)), GOOD) for i in range(12)]
    slow = [Motion(0.33 * i, 0.33 * (i + 1), Pose2(*rng.normal((0.3, 0, 0.16), 0.02)), loose) for i in range(3)]
    heard: list[Told] = [*(("wheels", motion) for motion in quick), *(("vo", motion) for motion in slow)]
    for _ in range(5):
        stamp_s = round(float(rng.uniform(0.0, 1.2)), 1)
        heard.append(("camera", Fix(stamp_s, Pose2(stamp_s, rng.normal(0, 0.3), 0.5 * stamp_s), FAIR)))
        heading = information_from_sigmas(np.inf, np.inf, 0.05)
        heard.append(("compass", Fix(stamp_s, Pose2(9.0, 9.0, rng.normal(0.5 * stamp_s, 0.1)), heading)))
        along = information_along((0.6, 0.8, 0.1), 0.1)
        heard.append(("beacon", Fix(stamp_s + 0.05, Pose2(stamp_s, rng.normal(0, 2.0), 0.0), along)))
    return heard


class TestOrder:
    @pytest.mark.parametrize("seed", range(10))
    def test_any_order_of_arrival_gives_what_the_right_order_gives(self, seed: int) -> None:
        heard = _heard(seed)
        mixed = list(heard)
        random.Random(seed).shuffle(mixed)

        expected = told(kalman(recover_after=3), sorted(heard, key=lambda pair: pair[1].stamp_s))
        belief = told(kalman(recover_after=3), mixed)

        np.testing.assert_allclose(pose_of(belief).array(), pose_of(expected).array(), atol=1e-9)
        np.testing.assert_allclose(covariance_of(belief), covariance_of(expected), atol=1e-9)
        np.testing.assert_allclose(belief.pose_odom_base.array(), expected.pose_odom_base.array(), atol=1e-9)

    def test_a_late_fix_corrects_everything_after_its_own_stamp(self) -> None:
        in_time, late = kalman(start_sigma_deg=10.0), kalman(start_sigma_deg=10.0)
        fix = Fix(0.5, Pose2(0.5, 0.1, 0.2), information_from_sigmas(0.01, 0.01, 0.01))

        drive(in_time, 5)
        in_time.apply("camera", fix)
        drive(in_time, 5, first=5)
        drive(late, 10)
        late.apply("camera", fix)

        np.testing.assert_allclose(pose_of(late.belief()).array(), pose_of(in_time.belief()).array(), atol=1e-12)
        assert pose_of(late.belief()).y > 0.15

    def test_what_is_older_than_the_history_is_late(self) -> None:
        estimator = kalman(history_s=0.5)
        drive(estimator, 10)

        applied = estimator.apply("camera", Fix(0.4, ORIGIN, FAIR))
        motion = estimator.apply("wheels", Motion(0.2, 0.3, ORIGIN, GOOD))

        assert applied == Applied("late", "0.600 s old, the history reaches back 0.5 s")
        assert motion.status == "late"
        assert estimator.counters()["late"] == 2

    def test_a_long_run_forgets_what_is_old(self) -> None:
        estimator = kalman(history_s=1.0)

        drive(estimator, 500)
        estimator.apply("camera", Fix(49.5, Pose2(49.5), FAIR))

        assert len(estimator._timeline._history) < 40
        assert len(estimator._timeline._nodes) < 40
        assert pose_of(estimator.belief()).x == pytest.approx(50.0, abs=0.05)


class TestOdometry:
    def test_it_is_not_touched_by_fixes(self) -> None:
        estimator = kalman()
        drive(estimator, 10)

        estimator.apply("camera", Fix(1.0, Pose2(1.0, 0.01, 0.01), GOOD))

        np.testing.assert_allclose(estimator.belief().pose_odom_base.array(), [1.0, 0.0, 0.0], atol=1e-12)

    def test_it_never_jumps_when_slower_motion_changes_the_past(self) -> None:
        estimator = kalman()
        published = []

        for i in range(30):
            drive(estimator, 1, first=i)
            published.append(estimator.belief(0.1 * (i + 1)).pose_odom_base)
            if i % 5 == 4:
                slow = Motion(
                    0.1 * (i - 4), 0.1 * (i + 1), Pose2(0.8, 0.3, 0.5), information_from_sigmas(0.2, 0.2, 0.3)
                )
                estimator.apply("vo", slow)
                assert estimator.belief(0.1 * (i + 1)).pose_odom_base.distance_to(published[-1]) < 1e-12

        steps = [a.distance_to(b) for a, b in pairwise(published)]
        assert max(steps) < 0.15
        assert estimator.belief().travelled_m == pytest.approx(3.0, abs=0.5)

    def test_a_belief_ahead_of_all_motion_binds_nobody(self) -> None:
        estimator = kalman()

        for i in range(10):
            estimator.belief(0.1 * (i + 1))
            drive(estimator, 1, first=i)

        assert estimator.belief().travelled_m == pytest.approx(1.0)
        assert estimator.belief().pose_odom_base.x == pytest.approx(1.0)

    @EKF_ONLY
    def test_beliefs_of_a_history_interpolate_the_motion(self) -> None:
        estimator = kalman()
        drive(estimator, 10)

        assert pose_of(estimator.belief(0.55)).x == pytest.approx(0.55)
        assert estimator.belief(0.55).stamp_s == 0.55

    def test_lost_lets_time_go_on(self) -> None:
        estimator = kalman()

        assert estimator.apply("camera", Lost(3.0, "dark")) == Applied("unused", "lost: dark")
        assert estimator.belief().stamp_s == 3.0
