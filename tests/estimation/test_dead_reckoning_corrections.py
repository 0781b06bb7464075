"""Dead reckoning corrected: fixes and path offsets at their own stamp, in any order, and poses that are told."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trailmark.estimates import (
    Applied,
    Fix,
    Lost,
    PathOffset,
    information_along,
    information_from_sigmas,
)
from trailmark.geometry import Pose2, wrap_angle
from trailmark.interfaces import Session
from trailmark.paths import Path, Waypoint

from .conftest import GOOD, dead_reckoning, drive, motion, pose_of


class TestFix:
    def test_a_late_fix_is_equation_5(self) -> None:
        rng = np.random.default_rng(7)
        for _ in range(50):
            start = Pose2(*rng.uniform(-0.5, 0.5, 2), rng.uniform(-3, 3))
            estimator = dead_reckoning(start)
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
        estimator = dead_reckoning()
        drive(estimator, 50)
        before = estimator.belief()

        estimator.apply("map", Fix(before.stamp_s - 0.2, Pose2(5.0, 5.0, 1.0), GOOD))

        after = estimator.belief()
        assert after.pose_odom_base == before.pose_odom_base
        assert after.travelled_m == before.travelled_m
        assert pose_of(after).distance_to(Pose2(5.0, 5.0)) < 0.06

    def test_the_pose_at_the_fix_is_the_fix_and_before_it_unchanged(self) -> None:
        estimator = dead_reckoning()
        drive(estimator, 50)
        before = estimator.belief(0.3)

        estimator.apply("map", Fix(0.5, Pose2(5.0, 6.0, 1.0), GOOD))

        assert estimator.belief(0.5).pose_map_base == Pose2(5.0, 6.0, 1.0)
        assert estimator.belief(0.3).pose_map_base == before.pose_map_base
        np.testing.assert_allclose(estimator.belief(0.5).covariance, 1e-6 * np.eye(3), atol=1e-15)

    def test_a_fix_ahead_of_the_motion_is_placed_when_the_motion_comes(self) -> None:
        ahead, in_order = dead_reckoning(), dead_reckoning()
        fix = Fix(1.5, Pose2(7.0, 0.0, 0.0), GOOD)
        first, second = motion(0.0, 1.0, 1.0), motion(1.0, 2.0, 4.0)
        for estimate in (first, fix, second):
            ahead.apply("any", estimate)
        for estimate in (first, second, fix):
            in_order.apply("any", estimate)

        assert pose_of(ahead.belief()).x == pytest.approx(9.0)
        np.testing.assert_allclose(pose_of(ahead.belief()).array(), pose_of(in_order.belief()).array(), atol=1e-12)

    def test_a_direction_without_information_keeps_the_belief(self) -> None:
        estimator = dead_reckoning(Pose2(1.0, 2.0, 0.1))
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
        estimator = dead_reckoning(Pose2(0.0, 0.0, 3.1))
        estimator.apply("compass", Fix(0.0, Pose2(0.0, 0.0, -3.1), information_along([0, 0.1, 1.0], 0.01)))

        belief = estimator.belief(0.0)

        # 0.083 rad of turn, half of it told as an offset: the whole circle would move it by 30 m
        assert abs(pose_of(belief).y) < 0.5

    def test_fix_age_is_the_way_since(self) -> None:
        estimator = dead_reckoning()
        for i in range(4):
            estimator.apply("vo", motion(i, i + 1, 1.0))
        estimator.apply("map", Fix(1.5, Pose2(1.0, 0.0, 0.0), GOOD))

        assert estimator.belief(1.0).fix_age_m == math.inf
        assert estimator.belief(1.5).fix_age_m == 0.0
        assert estimator.belief(4.0).fix_age_m == pytest.approx(2.5)

    def test_lost_changes_nothing_and_is_unused(self) -> None:
        estimator = dead_reckoning()
        drive(estimator, 3)
        before = estimator.belief(0.1)

        applied = estimator.apply("map", Lost(0.1, "quadrants disagree"))

        assert applied == Applied("unused", "lost: quadrants disagree")
        assert estimator.belief(0.1).pose_map_base == before.pose_map_base


class TestUnknownStart:
    def test_the_pose_is_unknown_until_the_first_fix_and_then_carried(self) -> None:
        estimator = dead_reckoning(None)
        drive(estimator, 20, Pose2(0.01, 0.0, 0.0))
        assert estimator.belief().pose_map_base is None
        assert estimator.belief().covariance is None
        assert estimator.belief().pose_odom_base.x == pytest.approx(0.2)

        estimator.apply("map", Fix(10 / 70, Pose2(5.0, 0.0, math.pi / 2), GOOD))

        assert estimator.belief(5 / 70).pose_map_base is None
        np.testing.assert_allclose(pose_of(estimator.belief(20 / 70)).array(), [5.0, 0.1, math.pi / 2], atol=1e-12)

    def test_a_part_of_a_pose_waits_for_the_rest(self) -> None:
        estimator = dead_reckoning(None)
        compass = Fix(1.0, Pose2(0.0, 0.0, 0.5), information_from_sigmas(math.inf, math.inf, 0.01))

        applied = estimator.apply("compass", compass)
        estimator.apply("map", Fix(0.5, Pose2(2.0, 3.0, 0.0), GOOD))  # about an earlier instant

        assert applied.status == "unused"
        assert "says 1 of its 3 numbers" in applied.reason
        assert pose_of(estimator.belief(1.0)).theta == pytest.approx(0.5)

    def test_start_again_is_as_new(self) -> None:
        estimator = dead_reckoning(Pose2())
        drive(estimator, 20)
        estimator.start(Session(start_pose=None))

        assert estimator.belief().pose_map_base is None
        assert estimator.belief().travelled_m == 0.0


def straight_path(length_m: float = 10.0) -> Path:
    n = round(length_m / 0.05) + 1
    return Path(Waypoint(i, 0.05 * i, Pose2(0.05 * i, 0.0, 0.0)) for i in range(n))


class TestPathOffset:
    def test_an_offset_corrects_what_it_measured(self) -> None:
        estimator = dead_reckoning(Pose2(1.0, 0.1, 0.05), straight_path())
        information = information_from_sigmas(math.inf, 0.01, math.inf)

        applied = estimator.apply("divs", PathOffset(0.0, 1.0, -0.2, 0.0, information))

        pose = pose_of(estimator.belief(0.0))
        assert applied.status == "accepted"
        np.testing.assert_allclose(pose.array(), [1.0, -0.2, 0.05], atol=1e-12)

    def test_a_full_offset_gives_an_unknown_pose(self) -> None:
        estimator = dead_reckoning(None, straight_path())

        estimator.apply("divs", PathOffset(0.0, 3.0, 0.1, 0.2, GOOD))

        np.testing.assert_allclose(pose_of(estimator.belief(0.0)).array(), [3.0, 0.1, 0.2], atol=1e-12)

    def test_an_offset_beyond_the_end_leaves_the_way_along_alone(self) -> None:
        estimator = dead_reckoning(Pose2(10.4, 0.1, 0.0), straight_path())

        estimator.apply("divs", PathOffset(0.0, 10.0, 0.0, 0.1, information_from_sigmas(math.inf, 0.01, 0.01)))

        np.testing.assert_allclose(pose_of(estimator.belief(0.0)).array(), [10.4, 0.0, 0.1], atol=1e-12)

    def test_without_a_path_it_is_refused(self) -> None:
        applied = dead_reckoning().apply("divs", PathOffset(0.0, 1.0, 0.0, 0.0, GOOD))

        assert applied.status == "refused"
        assert "this run has none" in applied.reason

    def test_the_belief_on_the_path_has_the_same_uncertainty(self) -> None:
        estimator = dead_reckoning(Pose2(1.0, 0.1, 0.05), straight_path())
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
        estimator = dead_reckoning(None, path)

        estimator.apply("divs", PathOffset(0.0, 0.52, 0.0, 0.0, information_from_sigmas(0.1, 0.01, 0.01)))

        belief = estimator.belief(0.0)
        assert belief.covariance is not None
        assert math.sqrt(belief.covariance[2, 2]) == pytest.approx(math.hypot(0.1 / radius_m, 0.01), rel=1e-6)
        assert belief.on_path is not None
        np.testing.assert_allclose(
            np.linalg.inv(belief.on_path.information), np.diag([0.01, 1e-4, 1e-4]), rtol=1e-6, atol=1e-12
        )


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
    in_order, shuffled = dead_reckoning(start), dead_reckoning(start)
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
    estimator = dead_reckoning(None)
    for i in range(10):
        estimator.apply("wheels", motion(0.1 * i, 0.1 * (i + 1), 0.1))

    assert estimator.set_pose(Pose2(5.0, 6.0, math.pi / 2), stamp_s=0.5).status == "accepted"

    np.testing.assert_allclose(pose_of(estimator.belief()).array(), [5.0, 6.5, math.pi / 2], atol=1e-9)
