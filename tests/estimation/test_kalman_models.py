"""What a Kalman estimator estimates beside the pose, how motion is tested, how a pose is set or found again."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.errors import ShapeError
from trailmark.estimates import Applied, Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.geometry import Pose2, wrap_angle

from .conftest import GOOD, ORIGIN, kalman, pose_of

pytestmark = pytest.mark.usefixtures("kind")

FAIR = information_from_sigmas(0.05, 0.05, 0.02)
TURN_ONLY = information_from_sigmas(math.inf, math.inf, 1e-4)
DT_S = 0.1


def step(i: int, pose: Pose2, information: np.ndarray = GOOD) -> Motion:
    return Motion(DT_S * i, DT_S * (i + 1), pose, information)


class TestCommonErrors:
    def test_a_gyro_bias_is_learned_from_wheels_that_disagree(self) -> None:
        estimator = kalman(sources={"gyro": {"errors": "gyro_bias"}})
        bias_radps = math.radians(1.5)

        for i in range(300):
            estimator.apply("wheels", step(i, Pose2(0.02, 0.0, 0.01), information_from_sigmas(1e-3, 1e-3, 2e-3)))
            estimator.apply("gyro", step(i, Pose2(0.0, 0.0, 0.01 + bias_radps * DT_S), TURN_ONLY))

        value, sigma = estimator.common_errors()["gyro"]
        assert value == pytest.approx(bias_radps, abs=math.radians(0.1))
        assert abs(value - bias_radps) < 3.0 * sigma < math.radians(0.5)
        assert wrap_angle(pose_of(estimator.belief()).theta - 3.0) == pytest.approx(0.0, abs=0.1)

    def test_a_scale_is_learned_from_fixes_and_taken_off_where_there_are_none(self) -> None:
        estimator = kalman(sources={"wheels": {"errors": "scale"}})

        for i in range(200):
            estimator.apply("wheels", step(i, Pose2(1.04 * 0.05)))
            if i < 150 and i % 5 == 4:
                estimator.apply("camera", Fix(DT_S * (i + 1), Pose2(0.05 * (i + 1)), FAIR))

        value, _ = estimator.common_errors()["wheels"]
        assert value == pytest.approx(0.04, abs=0.01)
        assert pose_of(estimator.belief()).x == pytest.approx(10.0, abs=0.05)  # uncorrected: 0.1 m more

    def test_without_it_the_same_drive_ends_elsewhere(self) -> None:
        estimator = kalman()

        for i in range(200):
            estimator.apply("wheels", step(i, Pose2(1.04 * 0.05)))

        assert pose_of(estimator.belief()).x > 10.3
        assert estimator.common_errors() == {}

    def test_the_order_of_arrival_changes_nothing(self) -> None:
        sources = {"wheels": {"errors": "scale"}, "gyro": {"errors": "gyro_bias"}}
        rng = np.random.default_rng(3)
        told = []
        for i in range(30):
            told.append(("wheels", step(i, Pose2(0.05, 0.0, 0.01))))
            told.append(("gyro", step(i, Pose2(0.0, 0.0, 0.012), TURN_ONLY)))
            if i % 6 == 5:
                told.append(("camera", Fix(DT_S * (i + 1), Pose2(0.05 * i, *rng.normal(0.0, 0.05, 2)), FAIR)))
        beliefs = []
        for order in (range(len(told)), rng.permutation(len(told))):
            estimator = kalman(sources=sources)
            for k in order:
                estimator.apply(*told[k])
            beliefs.append((pose_of(estimator.belief(3.0)).array(), estimator.belief(3.0).covariance))

        np.testing.assert_allclose(beliefs[1][0], beliefs[0][0], atol=1e-9)
        np.testing.assert_allclose(beliefs[1][1], beliefs[0][1], atol=1e-9)


class TestVelocity:
    def test_fixes_alone_tell_the_velocity(self) -> None:
        still, moving = kalman(), kalman(model="velocity", coast_s=5.0)

        for i in range(100):
            for estimator in (still, moving):
                estimator.apply("camera", Fix(DT_S * i, Pose2(0.04 * i), FAIR))

        assert moving.belief().twist.forward_mps == pytest.approx(0.4, abs=0.1)
        assert pose_of(moving.belief(10.4)).x == pytest.approx(4.16, abs=0.08)
        assert pose_of(still.belief(10.4)).x < 4.0

    def test_motion_is_believed_as_without_it(self) -> None:
        plain, filtered = kalman(), kalman(model="velocity")

        for i in range(50):
            for estimator in (plain, filtered):
                estimator.apply("wheels", step(i, Pose2(0.05, 0.0, 0.02)))

        np.testing.assert_allclose(pose_of(filtered.belief()).array(), pose_of(plain.belief()).array(), atol=1e-6)
        assert filtered.belief().twist.forward_mps == pytest.approx(0.5, abs=0.01)

    def test_a_gap_is_the_same_however_often_somebody_asks(self) -> None:
        estimator = kalman(model="velocity")
        for i in range(20):
            estimator.apply("wheels", step(i, Pose2(0.05)))
        whole = estimator.belief(3.5)
        estimator.apply("nobody", Fix(2.7, Pose2(), information_from_sigmas(1e6, 1e6, 1e6)))

        cut = estimator.belief(3.5)

        assert cut.covariance is not None
        assert whole.covariance is not None
        assert pose_of(cut).x == pytest.approx(pose_of(whole).x, abs=5e-3)
        # What a turn within the gap does to its end is of second order, and left out.
        np.testing.assert_allclose(np.diag(cut.covariance), np.diag(whole.covariance), rtol=0.02)


class TestMotionGate:
    def drive(self, **config: object) -> tuple[Kalman, list[Applied]]:
        estimator, verdicts = kalman(**config), []
        for i in range(40):
            jump = 1.0 if i == 20 else -1.0 if i == 30 else 0.0
            estimator.apply("wheels", step(i, Pose2(0.05), information_from_sigmas(5e-3, 5e-3, 5e-3)))
            verdicts.append(
                estimator.apply("vo", step(i, Pose2(0.05, jump), information_from_sigmas(1e-4, 1e-4, 1e-4)))
            )
        return estimator, verdicts

    def test_a_step_that_contradicts_the_others_and_the_velocity_is_left_out(self) -> None:
        estimator, verdicts = self.drive()

        assert [i for i, verdict in enumerate(verdicts) if verdict.status == "gated"] == [20, 30]
        assert "against the motion of others" in verdicts[20].reason
        assert verdicts[20].nis is not None
        assert abs(pose_of(estimator.belief()).y) < 0.02

    def test_every_other_step_has_its_nis(self) -> None:
        _, verdicts = self.drive()

        assert all(verdict.dof == 3 and verdict.nis is not None for verdict in verdicts)

    def test_without_a_gate_it_counts(self) -> None:
        _, verdicts = self.drive(gate="off")

        assert {verdict.status for verdict in verdicts} == {"accepted"}

    def test_of_a_single_localizer_nobody_knows(self) -> None:
        estimator = kalman()

        verdicts = [estimator.apply("vo", step(i, Pose2(1.0 if i == 5 else 0.05))) for i in range(10)]

        assert {verdict.status for verdict in verdicts} == {"accepted"}

    def test_two_that_disagree_a_little_both_count_for_less(self) -> None:
        agreeing, disagreeing = kalman(), kalman()

        for i in range(20):
            for estimator, scale in ((agreeing, 1.0), (disagreeing, 1.3)):
                estimator.apply("a", step(i, Pose2(0.05), information_from_sigmas(1e-3, 1e-3, 1e-3)))
                estimator.apply("b", step(i, Pose2(scale * 0.05), information_from_sigmas(1e-3, 1e-3, 1e-3)))

        sure, unsure = agreeing.belief().covariance, disagreeing.belief().covariance
        assert sure is not None
        assert unsure is not None
        assert unsure[0, 0] > 1.5 * sure[0, 0]
        assert pose_of(disagreeing.belief()).x == pytest.approx(1.15, abs=0.02)

    def test_who_is_left_out_is_named(self) -> None:
        estimator = kalman()
        for i in range(10):
            estimator.apply("wheels", step(i, Pose2(0.05), information_from_sigmas(5e-3, 5e-3, 5e-3)))
            estimator.apply("vo", step(i, Pose2(0.05, 1.0 if i == 9 else 0.0)))

        assert "contradicts the others" in estimator.belief().health["vo"]


class TestSetPose:
    def test_what_was_believed_is_replaced(self) -> None:
        estimator = kalman()
        for i in range(10):
            estimator.apply("wheels", step(i, Pose2(0.1)))

        assert estimator.set_pose(Pose2(5.0, 6.0, 1.0)) == Applied("accepted", "", None, 3)

        belief = estimator.belief()
        np.testing.assert_allclose(pose_of(belief).array(), [5.0, 6.0, 1.0])
        assert belief.covariance is not None
        assert belief.covariance[0, 0] == pytest.approx(0.01**2)
        assert belief.pose_odom_base.x == pytest.approx(1.0)

    def test_a_pose_of_the_past_is_driven_on(self) -> None:
        estimator = kalman()
        for i in range(10):
            estimator.apply("wheels", step(i, Pose2(0.1)))

        estimator.set_pose(Pose2(5.0, 6.0, math.pi / 2), stamp_s=0.5)

        np.testing.assert_allclose(pose_of(estimator.belief()).array(), [5.0, 6.5, math.pi / 2], atol=1e-3)

    def test_from_nowhere_it_is_the_start(self) -> None:
        estimator = kalman(start_pose=None)

        estimator.set_pose(Pose2(2.0, 3.0, 0.0), 0.25 * np.eye(3))
        estimator.apply("wheels", step(0, Pose2(0.1)))

        assert pose_of(estimator.belief()).y == pytest.approx(3.0, abs=1e-3)

    def test_what_cannot_be_is_refused(self) -> None:
        estimator = kalman()
        for i in range(200):
            estimator.apply("wheels", step(i, Pose2(0.1)))

        assert estimator.set_pose(ORIGIN, stamp_s=1e6).status == "refused"
        assert estimator.set_pose(ORIGIN, -np.eye(3)).status == "refused"
        assert estimator.set_pose(ORIGIN, stamp_s=5.0).status == "late"
        with pytest.raises(ShapeError, match=r"\(3, 3\)"):
            estimator.set_pose(ORIGIN, np.eye(2))


class TestAgreement:
    """A wrong start: what was rejected says together where base is."""

    BEACONS = ((4.0, 0.0), (0.0, 5.0), (-3.0, -4.0))

    def seen(self, truth: Pose2, stamp_s: float, beacon: tuple[float, float], believed: Pose2) -> Fix:
        """Return a sighting as a fix of rank two, made about a belief that may be wrong."""
        dx, dy = beacon[0] - believed.x, beacon[1] - believed.y
        distance = math.hypot(dx, dy)
        rows = np.array([[-dx / distance, -dy / distance, 0.0], [dy / distance**2, -dx / distance**2, -1.0]])
        true_x, true_y = beacon[0] - truth.x, beacon[1] - truth.y
        turn = wrap_angle(math.atan2(true_y, true_x) - truth.theta - (math.atan2(dy, dx) - believed.theta))
        miss = np.array([math.hypot(true_x, true_y) - distance, turn])
        rest = rows.T @ np.linalg.solve(rows @ rows.T, miss)
        information = (rows.T / np.square([0.1, 0.05])) @ rows
        return Fix(stamp_s, Pose2.from_array(believed.array() + rest), (information + information.T) / 2.0)

    @pytest.mark.parametrize("turn_deg", [90.0, -90.0, 180.0])
    def test_a_wrong_and_overconfident_start_is_mended_by_partial_fixes(self, turn_deg: float) -> None:
        truth = ORIGIN
        estimator = kalman(Pose2(1.0, 0.0, math.radians(turn_deg)))
        reasons = []

        for i in range(60):
            truth = truth @ Pose2(0.03, 0.0, 0.01)
            stamp_s = DT_S * (i + 1)
            estimator.apply("wheels", step(i, Pose2(0.03, 0.0, 0.01)))
            believed = pose_of(estimator.belief(stamp_s))
            reasons.append(estimator.apply("beacons", self.seen(truth, stamp_s, self.BEACONS[i % 3], believed)).reason)

        assert any("they agree on another pose" in reason for reason in reasons[:10])
        error = pose_of(estimator.belief()).array() - truth.array()
        assert np.hypot(*error[:2]) < 0.1
        assert abs(wrap_angle(float(error[2]))) < 0.05

    def test_scattered_outliers_do_not_move_the_belief(self) -> None:
        estimator = kalman()
        rng = np.random.default_rng(5)
        statuses = []

        for i in range(15):
            estimator.apply("wheels", step(i, Pose2(0.03)))
            wild = Pose2(*rng.uniform(-20.0, 20.0, 2), rng.uniform(-3.0, 3.0))
            statuses.append(estimator.apply("mad", Fix(DT_S * (i + 1), wild, FAIR)).status)

        assert set(statuses) == {"gated"}
        assert pose_of(estimator.belief()).x == pytest.approx(0.45, abs=0.01)
