"""What the Kalman estimator does when a localizer is wrong, silent, late, mad or lying: the table of faults."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.special import gammainc, gammaincinv

from trailmark.estimates import Applied, Fix, Lost, Motion, PathOffset, information_from_sigmas
from trailmark.estimation.kalman import one_sided
from trailmark.estimation.kalman.agreement import ACQUITTED
from trailmark.estimation.kalman.clock import ClockGuard
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman.gate import _QUANTILES, threshold, weight
from trailmark.estimation.kalman.trust import root_of
from trailmark.estimation.kalman.variance_components import CLIPPED, CLIPPED_MEANS
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.geometry import Pose2

from .conftest import EKF_ONLY, ORIGIN, kalman, pose_of

pytestmark = pytest.mark.usefixtures("kind")

GOOD = information_from_sigmas(0.01, 0.01, 0.01)
FAIR = information_from_sigmas(0.1, 0.1, 0.05)
DAY_S = 86_400.0


def wheels(i: int) -> Motion:
    return Motion(0.1 * i, 0.1 * (i + 1), Pose2(0.1), GOOD)


def fix(stamp_s: float, offset_m: float = 0.0, x: float | None = None) -> Fix:
    return Fix(stamp_s, Pose2(stamp_s if x is None else x, offset_m, 0.0), FAIR)


def driven(estimator: Kalman, n: int, first: int = 0) -> Kalman:
    for i in range(first, first + n):
        assert estimator.apply("wheels", wheels(i)).status == "accepted"
    return estimator


class TestInformation:
    @pytest.mark.parametrize("turn", [0.0, 0.2, 1.0])
    def test_a_way_that_a_corridor_does_not_tell_contradicts_nobody(self, turn: float) -> None:
        estimator = kalman()
        cos, sin = math.cos(turn), math.sin(turn)
        across = 1e5 * np.array([[sin * sin, -sin * cos, 0.0], [-sin * cos, cos * cos, 0.0], [0.0, 0.0, 0.0]])
        for i in range(60):
            estimator.apply("wheels", Motion(0.1 * i, 0.1 * (i + 1), Pose2(0.1 * cos, 0.1 * sin), GOOD))
            estimator.apply("laser", Motion(0.1 * i, 0.1 * (i + 1), Pose2(), across + np.diag([0.0, 0.0, 1e5])))

        belief = estimator.belief(6.0)

        assert pose_of(belief).distance_to(Pose2(6.0 * cos, 6.0 * sin)) < 5e-3
        assert not belief.health

    @pytest.mark.parametrize(
        ("information", "reason"),
        [
            (np.zeros((3, 3)), "it has no information"),
            (np.full((3, 3), np.nan), "not finite"),
            (np.diag([np.inf, 1.0, 1.0]), "not finite"),
            (np.diag([1.0, -1.0, 1.0]), "negative diagonal"),
            (np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), "negative in a direction"),
            (np.array([[1.0, 0.5, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 1.0]]), "not symmetric"),
        ],
    )
    def test_what_cannot_be_is_refused_and_counted(self, information: np.ndarray, reason: str) -> None:
        estimator = driven(kalman(), 3)
        before = pose_of(estimator.belief(0.3))

        for estimate in (Fix(0.3, Pose2(5.0), information), Motion(0.3, 0.4, Pose2(5.0), information)):
            applied = estimator.apply("mad", estimate)
            assert applied.status == "refused"
            assert reason in applied.reason

        assert pose_of(estimator.belief(0.3)) == before
        assert sum(n for name, n in estimator.counters().items() if name.startswith("refused_")) == 2

    @pytest.mark.parametrize("huge", [1e13, 1e100, 1e300, 1.7e308 / 9])
    def test_what_is_implausibly_certain_is_reduced_to_the_floor(self, huge: float) -> None:
        estimator = driven(kalman(start_sigma_m=1.0), 3)

        applied = estimator.apply("proud", Fix(0.3, Pose2(0.5), huge * np.eye(3)))

        believed = estimator.belief()
        assert applied.status == "accepted"
        assert pose_of(believed).x == pytest.approx(0.5, abs=1e-6)
        assert believed.covariance is not None
        assert believed.covariance[0, 0] == pytest.approx(1e-12, rel=1e-3)
        assert estimator.counters()["repaired_too_certain"] == 1

    def test_a_direction_is_reduced_and_the_others_keep_theirs(self) -> None:
        estimator = kalman(start_sigma_m=1.0, floor_m=0.01)

        estimator.apply("proud", Fix(0.0, ORIGIN, np.diag([1e8, 4.0, 0.0])))

        covariance = estimator.belief(0.0).covariance
        assert covariance is not None
        assert covariance[0, 0] == pytest.approx(1 / (1 + 1e4), rel=1e-6)
        assert covariance[1, 1] == pytest.approx(1 / (1 + 4.0), rel=1e-6)

    def test_a_config_scales_and_overrides_what_a_localizer_says(self) -> None:
        scaled = kalman(start_sigma_m=1.0, sources={"camera": {"sigma_scale": 2.0}})
        replaced = kalman(start_sigma_m=1.0, sources={"camera": {"sigmas": [0.5, None, None]}})

        scaled.apply("camera", Fix(0.0, ORIGIN, information_from_sigmas(0.5, 0.5, 0.5)))
        applied = replaced.apply("camera", Fix(0.0, ORIGIN, np.full((3, 3), np.nan)))

        for estimator, variance in ((scaled, 0.5), (replaced, 0.2)):
            covariance = estimator.belief(0.0).covariance
            assert covariance is not None
            assert covariance[0, 0] == pytest.approx(variance)
        assert applied.dof == 1

    def test_the_root_of_any_information_gives_it_back(self) -> None:
        rng = np.random.default_rng(7)

        for rank in (1, 2, 3):
            rows = rng.normal(size=(rank, 3)) * (1e3, 1.0, 1e-2)
            information = rows.T @ rows
            root = root_of(tuple(information[np.triu_indices(3)].tolist()))
            assert root.shape == (rank, 3)
            np.testing.assert_allclose(root.T @ root, information, rtol=1e-9, atol=1e-9 * information.max())

    def test_other_numbers_that_are_not_finite_are_refused(self) -> None:
        estimator = kalman()

        assert "stamp is not finite" in estimator.apply("mad", Fix(math.nan, ORIGIN, GOOD)).reason
        assert "begins at -inf" in estimator.apply("mad", Motion(-math.inf, 0.1, ORIGIN, GOOD)).reason
        assert "needs a path" in estimator.apply("mad", PathOffset(0.1, math.nan, 0.0, 0.0, GOOD)).reason


class TestClock:
    def test_a_stuck_stamp_is_refused_after_a_while(self) -> None:
        estimator = driven(kalman(max_per_stamp=8), 5)

        verdicts = [estimator.apply("camera", fix(0.5, 1e-4 * i)) for i in range(12)]

        assert [verdict.status for verdict in verdicts] == ["accepted"] * 8 + ["refused"] * 4
        assert "clock stand still" in verdicts[-1].reason
        assert "refused 4 in a row" in estimator.belief().health["camera"]

    def test_a_stuck_stamp_is_late_in_the_end(self) -> None:
        estimator = kalman(history_s=1.0)
        statuses = []

        for i in range(30):
            driven(estimator, 1, first=i)
            statuses.append(estimator.apply("camera", fix(0.1, 1e-3 * i)).status)

        assert statuses[-1] == "late"
        assert pose_of(estimator.belief()).x == pytest.approx(3.0, abs=0.1)

    def test_what_is_told_twice_counts_once(self) -> None:
        once, twice = driven(kalman(), 5), driven(kalman(), 5)

        once.apply("camera", fix(0.5, 0.1))
        assert twice.apply("camera", fix(0.5, 0.1)).status == "accepted"
        assert twice.apply("camera", fix(0.5, 0.1)) == Applied("refused", "it has told the same already")
        assert "same interval" in twice.apply("wheels", wheels(4)).reason

        assert pose_of(twice.belief()) == pose_of(once.belief())

    @pytest.mark.parametrize("jump_s", [-DAY_S, DAY_S])
    @EKF_ONLY
    def test_one_stamp_of_another_day_is_refused(self, jump_s: float) -> None:
        estimator = driven(kalman(), 5)

        applied = estimator.apply("camera", fix(0.5 + jump_s))
        driven(estimator, 5, first=5)

        assert applied.status == "refused"
        assert "the clock jumped" in applied.reason
        assert pose_of(estimator.belief()).x == pytest.approx(1.0)

    @pytest.mark.parametrize("jump_s", [-DAY_S, DAY_S])
    @EKF_ONLY
    def test_when_all_clocks_are_set_it_begins_anew_there(self, jump_s: float) -> None:
        estimator = driven(kalman(), 5)
        estimator.belief()

        statuses = [
            estimator.apply("wheels", Motion(jump_s + 0.1 * i, jump_s + 0.1 * (i + 1), Pose2(0.1), GOOD)).status
            for i in range(10)
        ]

        belief = estimator.belief()
        assert statuses == ["refused"] * 4 + ["accepted"] * 6
        assert belief.stamp_s == pytest.approx(jump_s + 1.0)
        assert pose_of(belief).x == pytest.approx(0.5 + 0.6)
        assert belief.pose_odom_base.x == pytest.approx(0.5 + 0.6)
        assert belief.covariance is not None
        assert belief.covariance[0, 0] > 1.0
        assert estimator.counters()["time_resets"] == 1

    @EKF_ONLY
    def test_who_falls_silent_when_clocks_are_set_back_is_said_to_be(self) -> None:
        estimator = driven(kalman(), 5)
        estimator.apply("camera", fix(0.5))

        for i in range(40):
            estimator.apply("wheels", Motion(0.1 * i - DAY_S, 0.1 * (i + 1) - DAY_S, Pose2(0.1), GOOD))

        assert estimator.belief().health["camera"].startswith("silent for 3.")

    def test_a_config_may_refuse_another_time_for_ever(self) -> None:
        guard = ClockGuard(60.0, None)

        assert {guard.classify(DAY_S + i, 0.0) for i in range(100)} == {"elsewhere"}
        assert guard.classify(1.0, 0.0) == "here"

    def test_a_burst_of_old_estimates_gives_what_they_would_have_given_in_time(self) -> None:
        in_time, burst = kalman(), kalman()

        held = []
        for i in range(20):
            for estimator in (in_time, burst):
                driven(estimator, 1, first=i)
            in_time.apply("camera", fix(0.1 * (i + 1), 0.02))
            held.append(fix(0.1 * (i + 1), 0.02))
            if i % 2:  # 200 ms
                for estimate in held:
                    burst.apply("camera", estimate)
                held.clear()

        np.testing.assert_allclose(pose_of(burst.belief()).array(), pose_of(in_time.belief()).array(), atol=1e-12)


class TestGate:
    def test_thresholds_are_the_quantiles_of_chi_square(self) -> None:
        for probability in (*_QUANTILES, 0.98):
            expected = [2.0 * gammaincinv(dof / 2.0, probability) for dof in (1, 2, 3, 4)]
            assert [threshold(probability, dof) for dof in (1, 2, 3, 4)] == pytest.approx(expected, rel=1e-12)

    def test_probabilities_that_are_asked_for_are_known(self) -> None:
        assert {CLIPPED, ACQUITTED, one_sided._PROBABILITY, KalmanConfig().gate} <= _QUANTILES.keys()

    def test_means_of_clipped_differences_are_those_of_chi_square(self) -> None:
        for dof, mean in CLIPPED_MEANS.items():
            limit = threshold(CLIPPED, dof)
            below = gammainc(dof / 2.0 + 1.0, limit / 2.0)
            assert mean == pytest.approx(below + limit * (1.0 - gammainc(dof / 2.0, limit / 2.0)) / dof, rel=1e-12)

    def test_losses_weigh_less_with_distance(self) -> None:
        assert [weight("huber", (2.0 * d) ** 2, 1, 2.0) for d in (0.5, 1.0, 4.0)] == [1.0, 1.0, 0.25]
        assert weight("cauchy", 36.0, 1, 2.0) == pytest.approx(0.1)
        assert weight("none", 1e9, 1, 2.0) == 1.0

    def test_a_robust_loss_holds_an_outlier_back_without_a_gate(self) -> None:
        trusting, robust = kalman(gate="off"), kalman(gate="off", loss="cauchy")

        for estimator in (trusting, robust):
            driven(estimator, 10)
            assert estimator.apply("camera", fix(1.0, 3.0)).status == "accepted"

        assert abs(pose_of(robust.belief()).y) < 0.1 * abs(pose_of(trusting.belief()).y)

    def test_a_gate_can_be_its_own_for_a_localizer(self) -> None:
        estimator = driven(kalman(sources={"camera": {"gate": "off"}}), 10)

        assert estimator.apply("camera", fix(1.0, 3.0)).status == "accepted"
        assert estimator.apply("other", fix(1.0, -3.0)).status == "gated"

    @pytest.mark.parametrize("gate", [0.0, 1.0, 13.8])
    def test_a_gate_is_a_probability(self, gate: float) -> None:
        with pytest.raises(ValidationError, match="probability between 0 and 1"):
            KalmanConfig(gate=gate)


class TestRecovery:
    def test_a_wrong_and_overconfident_start_does_not_lock_the_truth_out(self) -> None:
        estimator = kalman(Pose2(1.0, 0.0, math.pi / 2), start_sigma_m=0.01, start_sigma_deg=0.5)
        statuses = []

        for i in range(20):
            driven(estimator, 1, first=i)
            statuses.append(estimator.apply("camera", fix(0.1 * (i + 1))).status)

        assert statuses[:5] == ["gated"] * 4 + ["accepted"]
        np.testing.assert_allclose(pose_of(estimator.belief()).array(), [2.0, 0.0, 0.0], atol=0.05)
        assert estimator.counters()["recoveries"] == 1

    def test_a_consistent_liar_is_kept_out_while_others_support_the_belief(self) -> None:
        estimator = kalman()
        statuses = []

        for i in range(100):
            driven(estimator, 1, first=i)
            assert estimator.apply("honest", fix(0.1 * (i + 1))).status == "accepted"
            statuses.append(estimator.apply("liar", fix(0.1 * (i + 1), 1.0)))

        assert {verdict.status for verdict in statuses} == {"gated"}
        assert "others support the belief" in statuses[-1].reason
        assert estimator.belief().health["liar"] == "contradicts the belief, 20 of late"
        assert abs(pose_of(estimator.belief()).y) < 0.02

    def test_a_liar_that_comes_to_its_senses_is_heard_again(self) -> None:
        estimator = kalman()

        for i in range(40):
            driven(estimator, 1, first=i)
            estimator.apply("honest", fix(0.1 * (i + 1)))
            last = estimator.apply("camera", fix(0.1 * (i + 1), 1.0 if i < 20 else 0.0))

        assert last.status == "accepted"
        assert "camera" not in estimator.belief().health

    def test_support_of_another_direction_is_no_support(self) -> None:
        estimator = kalman()
        heading = information_from_sigmas(np.inf, np.inf, 0.05)

        for i in range(10):
            driven(estimator, 1, first=i)
            estimator.apply("compass", Fix(0.1 * (i + 1), ORIGIN, heading))
            last = estimator.apply("beacon", fix(0.1 * (i + 1), 2.0))

        assert last.status == "accepted"
        assert pose_of(estimator.belief()).y == pytest.approx(2.0, abs=0.1)


class TestSilence:
    @EKF_ONLY
    def test_a_silent_localizer_is_named_and_the_belief_goes_on_predicted(self) -> None:
        estimator = driven(kalman(timeout_s=1.0, sources={"camera": {}}), 5)
        assert estimator.belief().health == {"camera": "not heard of yet"}

        estimator.apply("camera", fix(0.5))
        driven(estimator, 20, first=5)

        belief = estimator.belief()
        assert belief.health == {"camera": "silent for 2.0 s"}
        assert pose_of(belief).x == pytest.approx(2.5, abs=1e-6)
        assert belief.fix_age_m == pytest.approx(2.0)

    @EKF_ONLY
    def test_all_silent_the_belief_stays_finite_and_says_so(self) -> None:
        estimator = driven(kalman(), 5)

        belief = estimator.belief(3600.0)

        assert belief.motion_age_s == pytest.approx(3599.5)
        assert pose_of(belief).x == pytest.approx(1.5)
        assert belief.health == {"wheels": "silent for 3599.5 s"}

    def test_who_is_lost_is_not_silent(self) -> None:
        estimator = driven(kalman(timeout_s=1.0), 20)

        estimator.apply("camera", Lost(2.0, "dark"))

        assert estimator.belief().health == {}
