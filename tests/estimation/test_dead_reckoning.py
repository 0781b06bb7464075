"""Dead reckoning: integration, corrections at their own stamp, ages, ways and refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trailmark.estimates import (
    Applied,
    Belief,
    Estimate,
    Fix,
    Lost,
    Motion,
    PathOffset,
    information_along,
    information_from_sigmas,
)
from trailmark.estimation.dead_reckoning import DeadReckoning
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.geometry import Pose2, wrap_angle
from trailmark.interfaces import Session
from trailmark.paths import Path, Waypoint

GOOD = information_from_sigmas(1e-3, 1e-3, 1e-3)
ORIGIN = Pose2()
ONE_FRAME = Pose2(0.0037, 0.0, 0.01)  # of the ground-camera paper's vehicle at 70 Hz


def started(start_pose: Pose2 | None = ORIGIN, path: Path | None = None, **config: float) -> DeadReckoning:
    estimator = DeadReckoning(DeadReckoningConfig(**config))
    estimator.start(Session(start_pose=start_pose, path=path))
    return estimator


def motion(since_s: float, stamp_s: float, x: float, y: float = 0.0, theta: float = 0.0) -> Motion:
    return Motion(since_s, stamp_s, Pose2(x, y, theta), GOOD)


def drive(estimator: DeadReckoning, n: int, step: Pose2 = ONE_FRAME, rate_hz: float = 70.0) -> None:
    for i in range(n):
        assert estimator.apply("vo", Motion(i / rate_hz, (i + 1) / rate_hz, step, GOOD)) == Applied("accepted")


def pose_of(belief: Belief) -> Pose2:
    assert belief.pose_map_base is not None
    return belief.pose_map_base


def straight_path(length_m: float = 10.0) -> Path:
    n = round(length_m / 0.05) + 1
    return Path(Waypoint(i, 0.05 * i, Pose2(0.05 * i, 0.0, 0.0)) for i in range(n))


class TestMotion:
    def test_motions_are_chained(self) -> None:
        estimator = started(Pose2(1.0, 2.0, math.pi / 2))
        estimator.apply("vo", motion(0.0, 1.0, 1.0, 0.0, math.pi / 2))
        estimator.apply("vo", motion(1.0, 2.0, 0.5))

        belief = estimator.belief()

        assert belief.stamp_s == 2.0
        np.testing.assert_allclose(pose_of(belief).array()[:2], [0.5, 3.0], atol=1e-15)
        np.testing.assert_allclose(belief.pose_odom_base.array()[:2], [1.0, 0.5], atol=1e-15)
        assert wrap_angle(pose_of(belief).theta - math.pi) == pytest.approx(0.0, abs=1e-15)

    def test_before_anything_base_stands_at_the_start(self) -> None:
        belief = started(Pose2(1.0, 2.0, 0.3)).belief()

        assert belief.pose_map_base == Pose2(1.0, 2.0, 0.3)
        assert belief.travelled_m == 0.0
        assert belief.motion_age_s == math.inf
        assert belief.fix_age_m == math.inf

    def test_the_belief_is_interpolated_along_the_arc(self) -> None:
        estimator = started()
        arc = Pose2.exp(1.0, 0.0, 1.0)
        estimator.apply("vo", Motion(0.0, 1.0, arc, GOOD))

        belief = estimator.belief(0.25)

        np.testing.assert_allclose(pose_of(belief).array(), Pose2.exp(0.25, 0.0, 0.25).array(), atol=1e-15)
        assert belief.travelled_m == pytest.approx(0.25)
        assert belief.motion_age_s == 0.0

    def test_the_belief_is_carried_on_with_the_last_twist(self) -> None:
        estimator = started()
        estimator.apply("vo", motion(0.0, 0.5, 0.5))

        belief = estimator.belief(0.8)

        assert pose_of(belief).x == pytest.approx(0.8)
        assert belief.travelled_m == pytest.approx(0.8)
        assert belief.motion_age_s == pytest.approx(0.3)
        assert belief.twist.forward_mps == pytest.approx(1.0)

    def test_the_twist_is_that_of_the_motion_at_the_stamp(self) -> None:
        estimator = started()
        estimator.apply("vo", motion(0.0, 1.0, 1.0))
        estimator.apply("vo", motion(1.0, 2.0, 3.0, 0.0, 0.2))

        assert estimator.belief(0.5).twist.forward_mps == pytest.approx(1.0)
        assert estimator.belief(1.5).twist.yaw_radps == pytest.approx(0.2)

    def test_a_gap_is_bridged_with_the_last_twist_and_counted(self) -> None:
        estimator = started()
        estimator.apply("vo", motion(0.0, 1.0, 1.0))
        estimator.apply("vo", motion(3.0, 4.0, 1.0))

        assert pose_of(estimator.belief(4.0)).x == pytest.approx(4.0)
        assert estimator.belief(2.5).motion_age_s == pytest.approx(1.5)
        assert estimator.belief(3.5).motion_age_s == 0.0
        assert estimator.counters() == {"gaps": 1, "overlaps": 0}

    def test_a_gap_makes_the_belief_less_certain(self) -> None:
        with_gap, without = started(), started()
        for estimator, since_s in ((with_gap, 2.0), (without, 1.0)):
            estimator.apply("vo", motion(0.0, 1.0, 1.0))
            estimator.apply("vo", motion(since_s, 3.0, 3.0 - since_s))

        covariances = [estimator.belief().covariance for estimator in (with_gap, without)]

        assert covariances[0] is not None
        assert covariances[1] is not None
        assert np.linalg.eigvalsh(covariances[0] - covariances[1])[0] > -1e-12
        assert covariances[0][0, 0] == pytest.approx(0.5**2, rel=0.1)  # 1 s at the drift's 0.5 m/s

    def test_an_overlap_counts_once(self) -> None:
        estimator = started()
        estimator.apply("vo", motion(0.0, 1.0, 1.0))
        estimator.apply("vo", motion(0.5, 1.5, 1.0))  # the first half is known

        assert pose_of(estimator.belief()).x == pytest.approx(1.5)
        assert estimator.counters()["overlaps"] == 1

    def test_a_motion_that_adds_nothing_is_refused(self) -> None:
        estimator = started()
        estimator.apply("vo", motion(0.0, 1.0, 1.0))

        applied = estimator.apply("klt", motion(0.2, 1.0, 0.8))

        assert applied.status == "refused"
        assert "already known until 1.000000 s" in applied.reason
        assert pose_of(estimator.belief()).x == 1.0

    def test_driving_backwards_is_way_too(self) -> None:
        estimator = started()
        estimator.apply("vo", motion(0.0, 1.0, 1.0))
        estimator.apply("vo", motion(1.0, 2.0, -1.0))

        assert estimator.belief().travelled_m == pytest.approx(2.0)

    def test_stamps_that_went_through_decimals_leave_no_gap(self) -> None:
        estimator = started()
        estimator.apply("vo", motion(0.0, 1 / 3, 1.0))
        estimator.apply("vo", motion(0.3333333, 1.0, 1.0))

        assert estimator.counters() == {"gaps": 0, "overlaps": 0}


class TestFix:
    def test_a_late_fix_is_equation_5(self) -> None:
        rng = np.random.default_rng(7)
        for _ in range(50):
            start = Pose2(*rng.uniform(-0.5, 0.5, 2), rng.uniform(-3, 3))
            estimator = started(start)
            steps = rng.normal([0.0037, 0.0, 0.0], [0.0005, 0.0002, 0.01], (30, 3))
            for i, (x, y, theta) in enumerate(steps):
                estimator.apply("vo", motion(i / 70, (i + 1) / 70, x, y, theta))
            search, found = pose_of(estimator.belief(16 / 70)), pose_of(estimator.belief(30 / 70))  # 200 ms later
            dt, dtheta = rng.normal(0.0, 0.01, 2), rng.normal(0.0, 0.05)

            estimator.apply("map", Fix(16 / 70, Pose2(search.x + dt[0], search.y + dt[1], search.theta + dtheta), GOOD))

            corrected = pose_of(estimator.belief(30 / 70))
            v = found.array()[:2] - search.array()[:2]
            rotation = np.array([[math.cos(dtheta), -math.sin(dtheta)], [math.sin(dtheta), math.cos(dtheta)]])
            expected = search.array()[:2] + dt + rotation @ v  # Eq. (5)
            np.testing.assert_allclose(corrected.array()[:2], expected, rtol=0, atol=1e-15)
            assert wrap_angle(corrected.theta - (found.theta + dtheta)) == pytest.approx(0.0, abs=1e-15)

    def test_a_fix_does_not_move_odom_or_the_way(self) -> None:
        estimator = started()
        drive(estimator, 50)
        before = estimator.belief()

        estimator.apply("map", Fix(before.stamp_s - 0.2, Pose2(5.0, 5.0, 1.0), GOOD))

        after = estimator.belief()
        assert after.pose_odom_base == before.pose_odom_base
        assert after.travelled_m == before.travelled_m
        assert pose_of(after).distance_to(Pose2(5.0, 5.0)) < 0.06

    def test_the_pose_at_the_fix_is_the_fix_and_before_it_unchanged(self) -> None:
        estimator = started()
        drive(estimator, 50)
        before = estimator.belief(0.3)

        estimator.apply("map", Fix(0.5, Pose2(5.0, 6.0, 1.0), GOOD))

        assert estimator.belief(0.5).pose_map_base == Pose2(5.0, 6.0, 1.0)
        assert estimator.belief(0.3).pose_map_base == before.pose_map_base
        np.testing.assert_allclose(estimator.belief(0.5).covariance, 1e-6 * np.eye(3), atol=1e-15)

    def test_a_fix_ahead_of_the_motion_is_placed_when_the_motion_comes(self) -> None:
        ahead, in_order = started(), started()
        fix = Fix(1.5, Pose2(7.0, 0.0, 0.0), GOOD)
        first, second = motion(0.0, 1.0, 1.0), motion(1.0, 2.0, 4.0)
        for estimate in (first, fix, second):
            ahead.apply("any", estimate)
        for estimate in (first, second, fix):
            in_order.apply("any", estimate)

        assert pose_of(ahead.belief()).x == pytest.approx(9.0)
        np.testing.assert_allclose(pose_of(ahead.belief()).array(), pose_of(in_order.belief()).array(), atol=1e-12)

    def test_a_direction_without_information_keeps_the_belief(self) -> None:
        estimator = started(Pose2(1.0, 2.0, 0.1))
        drive(estimator, 10)
        before = pose_of(estimator.belief())

        applied = estimator.apply(
            "compass",
            Fix(estimator.belief().stamp_s, Pose2(9.0, 9.0, 0.5), information_from_sigmas(math.inf, math.inf, 0.01)),
        )

        after = pose_of(estimator.belief())
        assert applied.status == "accepted"
        assert (after.x, after.y) == pytest.approx((before.x, before.y))
        assert after.theta == pytest.approx(0.5)

    def test_the_turn_to_a_measured_heading_is_the_short_one(self) -> None:
        estimator = started(Pose2(0.0, 0.0, 3.1))
        estimator.apply("compass", Fix(0.0, Pose2(0.0, 0.0, -3.1), information_along([0, 0.1, 1.0], 0.01)))

        belief = estimator.belief(0.0)

        # 0.083 rad of turn, half of it told as an offset: the whole circle would move it by 30 m
        assert abs(pose_of(belief).y) < 0.5

    def test_fix_age_is_the_way_since(self) -> None:
        estimator = started()
        for i in range(4):
            estimator.apply("vo", motion(i, i + 1, 1.0))
        estimator.apply("map", Fix(1.5, Pose2(1.0, 0.0, 0.0), GOOD))

        assert estimator.belief(1.0).fix_age_m == math.inf
        assert estimator.belief(1.5).fix_age_m == 0.0
        assert estimator.belief(4.0).fix_age_m == pytest.approx(2.5)

    def test_lost_changes_nothing_and_is_unused(self) -> None:
        estimator = started()
        drive(estimator, 3)
        before = estimator.belief(0.1)

        applied = estimator.apply("map", Lost(0.1, "quadrants disagree"))

        assert applied == Applied("unused", "lost: quadrants disagree")
        assert estimator.belief(0.1).pose_map_base == before.pose_map_base


class TestUnknownStart:
    def test_the_pose_is_unknown_until_the_first_fix_and_then_carried(self) -> None:
        estimator = started(None)
        drive(estimator, 20, Pose2(0.01, 0.0, 0.0))
        assert estimator.belief().pose_map_base is None
        assert estimator.belief().covariance is None
        assert estimator.belief().pose_odom_base.x == pytest.approx(0.2)

        estimator.apply("map", Fix(10 / 70, Pose2(5.0, 0.0, math.pi / 2), GOOD))

        assert estimator.belief(5 / 70).pose_map_base is None
        np.testing.assert_allclose(pose_of(estimator.belief(20 / 70)).array(), [5.0, 0.1, math.pi / 2], atol=1e-12)

    def test_a_part_of_a_pose_waits_for_the_rest(self) -> None:
        estimator = started(None)
        compass = Fix(1.0, Pose2(0.0, 0.0, 0.5), information_from_sigmas(math.inf, math.inf, 0.01))

        applied = estimator.apply("compass", compass)
        estimator.apply("map", Fix(0.5, Pose2(2.0, 3.0, 0.0), GOOD))  # about an earlier instant

        assert applied.status == "unused"
        assert "says 1 of its 3 numbers" in applied.reason
        assert pose_of(estimator.belief(1.0)).theta == pytest.approx(0.5)

    def test_start_again_is_as_new(self) -> None:
        estimator = started(Pose2())
        drive(estimator, 20)
        estimator.start(Session(start_pose=None))

        assert estimator.belief().pose_map_base is None
        assert estimator.belief().travelled_m == 0.0


class TestPathOffset:
    def test_an_offset_corrects_what_it_measured(self) -> None:
        estimator = started(Pose2(1.0, 0.1, 0.05), straight_path())
        information = information_from_sigmas(math.inf, 0.01, math.inf)

        applied = estimator.apply("divs", PathOffset(0.0, 1.0, -0.2, 0.0, information))

        pose = pose_of(estimator.belief(0.0))
        assert applied.status == "accepted"
        np.testing.assert_allclose(pose.array(), [1.0, -0.2, 0.05], atol=1e-12)

    def test_a_full_offset_gives_an_unknown_pose(self) -> None:
        estimator = started(None, straight_path())

        estimator.apply("divs", PathOffset(0.0, 3.0, 0.1, 0.2, GOOD))

        np.testing.assert_allclose(pose_of(estimator.belief(0.0)).array(), [3.0, 0.1, 0.2], atol=1e-12)

    def test_an_offset_beyond_the_end_leaves_the_way_along_alone(self) -> None:
        estimator = started(Pose2(10.4, 0.1, 0.0), straight_path())

        estimator.apply("divs", PathOffset(0.0, 10.0, 0.0, 0.1, information_from_sigmas(math.inf, 0.01, 0.01)))

        np.testing.assert_allclose(pose_of(estimator.belief(0.0)).array(), [10.4, 0.0, 0.1], atol=1e-12)

    def test_without_a_path_it_is_refused(self) -> None:
        applied = started().apply("divs", PathOffset(0.0, 1.0, 0.0, 0.0, GOOD))

        assert applied.status == "refused"
        assert "this run has none" in applied.reason

    def test_the_belief_on_the_path_has_the_same_uncertainty(self) -> None:
        estimator = started(Pose2(1.0, 0.1, 0.05), straight_path())
        estimator.apply("map", Fix(0.0, Pose2(1.0, 0.1, 0.05), information_from_sigmas(0.1, 0.2, 0.3)))

        on_path = estimator.belief(0.0).on_path

        assert on_path is not None
        assert (on_path.station_m, on_path.lateral_m, on_path.heading_rad) == pytest.approx((1.0, 0.1, 0.05))
        np.testing.assert_allclose(np.linalg.inv(on_path.information), np.diag([0.01, 0.04, 0.09]), atol=1e-12)

    def test_on_a_bend_the_station_tells_of_the_heading(self) -> None:
        radius_m = 0.75  # a quarter circle, 0.05 m between the waypoints
        angles = np.arange(0.0, math.pi / 2, 0.05 / radius_m)
        path = Path(
            Waypoint(i, radius_m * a, Pose2(radius_m * math.sin(a), radius_m * (1 - math.cos(a)), a))
            for i, a in enumerate(angles.tolist())
        )
        estimator = started(None, path)

        estimator.apply("divs", PathOffset(0.0, 0.52, 0.0, 0.0, information_from_sigmas(0.1, 0.01, 0.01)))

        belief = estimator.belief(0.0)
        assert belief.covariance is not None
        assert math.sqrt(belief.covariance[2, 2]) == pytest.approx(math.hypot(0.1 / radius_m, 0.01), rel=1e-6)
        assert belief.on_path is not None
        np.testing.assert_allclose(
            np.linalg.inv(belief.on_path.information), np.diag([0.01, 1e-4, 1e-4]), rtol=1e-6, atol=1e-12
        )


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
        estimator = started(path=straight_path())
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
        assert started().apply("bad", Fix(1.0, Pose2(), np.zeros((3, 3)))) == Applied(
            "refused", "it has no information"
        )

    @pytest.mark.parametrize("stamp_s", [math.nan, math.inf])
    def test_a_stamp_that_cannot_be_is_refused(self, stamp_s: float) -> None:
        estimator = started()

        assert estimator.apply("bad", Fix(stamp_s, Pose2(), GOOD)).status == "refused"
        assert estimator.belief(1.0).stamp_s == 1.0

    def test_a_path_offset_of_nan_is_refused(self) -> None:
        applied = started(path=straight_path()).apply("bad", PathOffset(0.0, math.nan, 0.0, 0.0, GOOD))

        assert applied == Applied("refused", "the path offset is not finite")

    def test_what_is_older_than_the_history_is_late(self) -> None:
        estimator = started(history_s=1.0)
        drive(estimator, 140)  # 2 s
        before = estimator.belief()

        fix = estimator.apply("map", Fix(0.9, Pose2(9.0, 9.0, 0.0), GOOD))
        old = estimator.apply("vo", motion(0.0, 0.5, 1.0))

        assert fix.status == "late"
        assert "1.100 s old, the history reaches back 1 s" in fix.reason
        assert old.status == "late"
        assert estimator.belief().pose_map_base == before.pose_map_base

    def test_a_belief_older_than_the_history_says_its_own_stamp(self) -> None:
        estimator = started(history_s=1.0)
        drive(estimator, 210)

        belief = estimator.belief(0.5)

        assert 1.9 < belief.stamp_s <= 2.0
        assert belief.pose_map_base == estimator.belief(belief.stamp_s).pose_map_base

    def test_a_motion_without_information_still_moves_but_is_uncertain(self) -> None:
        estimator = started()

        estimator.apply("ticks", Motion(0.0, 1.0, Pose2(1.0), information_from_sigmas(0.01, math.inf, math.inf)))

        belief = estimator.belief()
        assert pose_of(belief).x == 1.0
        assert belief.covariance is not None
        assert math.sqrt(belief.covariance[0, 0]) < 0.02
        assert math.sqrt(belief.covariance[1, 1]) == pytest.approx(0.5, rel=0.05)  # the drift's 0.5 m/s


class TestCovariance:
    def test_it_is_the_first_order_propagation(self) -> None:
        rng = np.random.default_rng(5)
        estimator = started(Pose2(40.0, -30.0, 2.0))
        expected = np.diag([0.01, 0.01, math.radians(0.5)]) ** 2
        pose = Pose2(40.0, -30.0, 2.0)
        for i in range(200):
            step, sigmas = Pose2(*rng.normal([0.05, 0.0, 0.0], [0.01, 0.01, 0.1])), rng.uniform(1e-3, 5e-3, 3)
            estimator.apply("vo", Motion(i / 10, (i + 1) / 10, step, information_from_sigmas(*sigmas)))
            after = pose @ step
            before_jacobian = np.array([[1, 0, pose.y - after.y], [0, 1, after.x - pose.x], [0, 0, 1]])
            cos, sin = math.cos(pose.theta), math.sin(pose.theta)
            step_jacobian = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
            expected = before_jacobian @ expected @ before_jacobian.T
            expected += step_jacobian @ np.diag(sigmas**2) @ step_jacobian.T
            pose = after

        np.testing.assert_allclose(estimator.belief().covariance, expected, rtol=1e-9, atol=1e-15)

    def test_after_a_fix_it_grows_from_the_fixs(self) -> None:
        late, fresh = started(), started(None)
        for estimator in (late, fresh):
            drive(estimator, 100)
            estimator.apply("map", Fix(50 / 70, Pose2(1.0, 2.0, 0.7), information_from_sigmas(0.01, 0.02, 0.03)))

        np.testing.assert_allclose(late.belief().covariance, fresh.belief().covariance, atol=1e-15)
        assert np.linalg.eigvalsh(late.belief().covariance - late.belief(50 / 70).covariance)[-1] > 0

    def test_it_grows_ahead_of_the_newest_motion(self) -> None:
        estimator = started()
        drive(estimator, 10)
        now_s = estimator.belief().stamp_s

        covariance = estimator.belief(now_s + 1.0).covariance

        assert covariance is not None
        assert covariance[2, 2] == pytest.approx(math.radians(30.0) ** 2, rel=0.01)


@st.composite
def fixes(draw: st.DrawFn) -> list[Fix]:
    stamps = draw(st.lists(st.integers(0, 100), min_size=1, max_size=8, unique=True))
    number = st.floats(-5.0, 5.0, allow_nan=False)
    infinite = st.sampled_from([0.01, 0.3, math.inf])
    answer = []
    for stamp in stamps:
        sigmas = draw(st.tuples(infinite, infinite, infinite).filter(lambda s: not all(map(math.isinf, s))))
        pose = Pose2(draw(number), draw(number), draw(number))
        answer.append(Fix(stamp / 70, pose, information_from_sigmas(*sigmas)))
    return answer


@settings(max_examples=60, deadline=None)
@given(fixes(), st.randoms(use_true_random=False), st.booleans())
def test_the_order_in_which_fixes_arrive_does_not_matter(estimates: list[Fix], random, is_known: bool) -> None:
    start = Pose2(1.0, 2.0, 3.0) if is_known else None
    in_order, shuffled = started(start), started(start)
    motions = [motion(i / 70, (i + 1) / 70, 0.02, 0.001 * math.sin(i), 0.05 * math.cos(i / 9)) for i in range(100)]
    for estimate in sorted([*motions, *estimates], key=lambda e: (e.stamp_s, isinstance(e, Fix))):
        in_order.apply("any", estimate)
    late = list(estimates)
    random.shuffle(late)
    for i, step in enumerate(motions):  # each fix comes at any time, also before the motion that it is about
        shuffled.apply("vo", step)
        if late and random.random() < 0.1:
            shuffled.apply(f"map{i}", late.pop())
    for estimate in late:
        shuffled.apply("map", estimate)

    for stamp_s in (0.3, 0.71, 100 / 70, 1.6):
        first, second = in_order.belief(stamp_s), shuffled.belief(stamp_s)
        assert (first.pose_map_base is None) == (second.pose_map_base is None)
        assert first.fix_age_m == pytest.approx(second.fix_age_m, abs=1e-9)
        if first.pose_map_base is not None:
            np.testing.assert_allclose(first.pose_map_base.between(second.pose_map_base).array(), 0.0, atol=1e-9)
            np.testing.assert_allclose(first.covariance, second.covariance, rtol=1e-9, atol=1e-9)


def test_a_pose_can_be_set_and_is_driven_on() -> None:
    estimator = DeadReckoning(DeadReckoningConfig())
    estimator.start(Session())
    for i in range(10):
        estimator.apply("wheels", Motion(0.1 * i, 0.1 * (i + 1), Pose2(0.1), information_from_sigmas(1e-3, 1e-3, 1e-3)))

    assert estimator.set_pose(Pose2(5.0, 6.0, math.pi / 2), stamp_s=0.5).status == "accepted"

    pose = estimator.belief().pose_map_base
    assert pose is not None
    np.testing.assert_allclose(pose.array(), [5.0, 6.5, math.pi / 2], atol=1e-9)
