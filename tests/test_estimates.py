"""Estimates and their information matrices."""

from __future__ import annotations

import copy
import dataclasses
import json
import math
import operator
import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from trailmark.errors import ShapeError
from trailmark.estimates import (
    ALL_HEALTHY,
    Applied,
    Belief,
    Fix,
    Lost,
    Motion,
    PathOffset,
    information_along,
    information_from_covariance,
    information_from_sigmas,
    range_fix,
)
from trailmark.geometry import Pose2, Twist2

sigmas = st.floats(1e-6, 1e3)
squares = hnp.arrays(np.float64, (3, 3), elements=st.floats(-10, 10))


class TestInformation:
    @given(sigmas, sigmas, sigmas)
    def test_of_sigmas_is_the_inverse_of_their_covariance(self, x: float, y: float, theta: float) -> None:
        information = information_from_sigmas(x, y, theta)

        np.testing.assert_allclose(
            information @ np.diag([x * x, y * y, theta * theta]), np.eye(3), rtol=1e-9, atol=1e-12
        )

    def test_what_was_not_measured_has_none(self) -> None:
        np.testing.assert_array_equal(information_from_sigmas(0.5, math.inf, 2.0), np.diag([4.0, 0.0, 0.25]))

    @given(squares)
    def test_of_a_covariance_is_its_inverse_and_symmetric(self, square: np.ndarray) -> None:
        covariance = square @ square.T + 0.1 * np.eye(3)

        information = information_from_covariance(covariance)

        np.testing.assert_array_equal(information, information.T)
        np.testing.assert_allclose(information @ covariance, np.eye(3), atol=1e-6)

    def test_of_a_tiny_covariance_keeps_its_digits(self) -> None:
        information = information_from_covariance(np.diag([1e-12, 1e-10, 1e-14]))

        np.testing.assert_allclose(np.diag(information), [1e12, 1e10, 1e14], rtol=1e-12)

    def test_along_a_direction_has_rank_one(self) -> None:
        information = information_along([0.0, 1.0, 2.0], 0.1)

        assert np.linalg.matrix_rank(information) == 1
        np.testing.assert_allclose(information, 100.0 * np.array([[0, 0, 0], [0, 1, 2], [0, 2, 4]]))

    def test_two_directions_add_up(self) -> None:
        np.testing.assert_allclose(
            information_along([1, 0, 0], 0.1) + information_along([0, 1, 0], 0.2),
            information_from_sigmas(0.1, 0.2, math.inf),
        )

    @pytest.mark.parametrize("sigma", [0.0, -1.0, math.nan])
    def test_a_sigma_that_is_not_positive_is_refused(self, sigma: float) -> None:
        with pytest.raises(ValueError, match="must be positive"):
            information_from_sigmas(1.0, sigma, 1.0)
        with pytest.raises(ValueError, match="must be positive"):
            information_along([1, 0, 0], sigma)

    @pytest.mark.parametrize(
        ("covariance", "message"),
        [
            (np.zeros((2, 3)), "a covariance is square"),
            (np.array([[1.0, 0.5], [0.4, 1.0]]), "not symmetric"),
            (np.diag([1.0, 0.0]), "not positive definite"),
            (np.diag([1.0, -1.0]), "not positive definite"),
            (np.diag([1.0, math.nan]), "not symmetric"),
        ],
    )
    def test_what_is_no_covariance_is_refused(self, covariance: np.ndarray, message: str) -> None:
        with pytest.raises(ValueError, match=message):
            information_from_covariance(covariance)


class TestEstimates:
    INFORMATION = information_from_sigmas(0.1, 0.1, 0.01)

    def all(self) -> list[Motion | Fix | PathOffset]:
        return [
            Motion(1.0, 2.0, Pose2(), self.INFORMATION),
            Fix(2.0, Pose2(), self.INFORMATION),
            PathOffset(2.0, 3.0, 0.1, 0.01, self.INFORMATION),
        ]

    def test_all_but_lost_carry_an_information_that_cannot_be_changed(self) -> None:
        for estimate in self.all():
            with pytest.raises(ValueError, match="read-only"):
                estimate.information[0, 0] = 0.0
        assert not hasattr(Lost(2.0, "dark"), "information")

    def test_they_cannot_be_changed(self) -> None:
        for estimate in [*self.all(), Lost(2.0, "dark")]:
            with pytest.raises(FrozenInstanceError):
                estimate.stamp_s = 3.0  # type: ignore[misc]

    def test_information_has_three_rows(self) -> None:
        for make in (
            lambda matrix: Motion(1.0, 2.0, Pose2(), matrix),
            lambda matrix: Fix(2.0, Pose2(), matrix),
            lambda matrix: PathOffset(2.0, 3.0, 0.1, 0.01, matrix),
        ):
            with pytest.raises(ShapeError, match=r"shape \(3, 3\), not \(2, 2\)"):
                make(np.eye(2))

    @pytest.mark.parametrize("since_s", [2.0, 2.1, math.nan])
    def test_a_motion_ends_after_it_begins(self, since_s: float) -> None:
        with pytest.raises(ShapeError, match="must end after it begins"):
            Motion(since_s, 2.0, Pose2(), self.INFORMATION)

    def test_details_default_to_none_and_cannot_be_shared_by_accident(self) -> None:
        first, second = Lost(1.0, "dark"), Lost(2.0, "dark")

        assert dict(first.details) == dict(second.details) == {}
        with pytest.raises(TypeError):
            first.details["score"] = 1.0  # type: ignore[index]


def test_a_belief_starts_with_nothing_known() -> None:
    belief = Belief(5.0)

    assert (belief.pose_map_base, belief.covariance, belief.on_path) == (None, None, None)
    assert (belief.pose_odom_base, belief.twist, belief.travelled_m) == (Pose2(), Twist2(), 0.0)
    assert (belief.fix_age_m, belief.motion_age_s) == (math.inf, math.inf)


def test_an_applied_estimate_needs_no_more_than_its_status() -> None:
    assert Applied("accepted") == Applied("accepted", "", None, None)


class TestRangeFix:
    """A distance to a beacon, linearised at the belief."""

    def test_worked_by_hand(self) -> None:
        belief = Belief(2.5, Pose2(3.0, 4.0, 0.3), np.zeros((3, 3)))

        fix = range_fix(belief, (0.0, 0.0), 5.5, 0.1)

        assert isinstance(fix, Fix)
        assert fix.stamp_s == 2.5
        np.testing.assert_allclose(fix.pose_map_base.array(), [3.3, 4.4, 0.3], atol=1e-12)
        direction = np.array([0.6, 0.8, 0.0])
        np.testing.assert_allclose(fix.information, 100.0 * np.outer(direction, direction), atol=1e-9)

    @given(st.floats(-3.0, 3.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
    def test_its_direction_is_the_derivative_of_the_range(self, theta: float, x: float, y: float) -> None:
        pose, beacon = Pose2(1.0, -2.0, theta), np.array([6.0, 3.0])

        fix = range_fix(Belief(0.0, pose, np.zeros((3, 3))), (6.0, 3.0), 7.0, 1.0, antenna_base=(x, y))

        def measured(values: np.ndarray) -> float:
            return float(np.linalg.norm(Pose2.from_array(values) @ np.array([x, y]) - beacon))

        steps = 1e-6 * np.eye(3)
        rows = [(measured(pose.array() + step) - measured(pose.array() - step)) / 2e-6 for step in steps]
        assert isinstance(fix, Fix)
        np.testing.assert_allclose(fix.information, np.outer(rows, rows), atol=1e-7)
        assert measured(fix.pose_map_base.array()) == pytest.approx(7.0, abs=1e-9)

    def test_what_the_tangent_misses_is_accounted_for(self) -> None:
        rng = np.random.default_rng(7)
        spread = np.diag([0.01, 0.4, 0.02]) ** 2
        where = rng.multivariate_normal([2.0, 0.0, 0.0], spread, 200_000)
        ranges = np.hypot(where[:, 0], where[:, 1]) + rng.normal(0.0, 0.02, len(where))

        fix = range_fix(Belief(0.0, Pose2(2.0, 0.0, 0.0), spread), (0.0, 0.0), 2.0, 0.02)

        assert isinstance(fix, Fix)
        assert 2.0 - fix.pose_map_base.x == pytest.approx(ranges.mean() - 2.0, abs=2e-3)
        innovation_sigma = math.sqrt(1.0 / fix.information[0, 0] + spread[0, 0])
        assert innovation_sigma == pytest.approx(ranges.std(), rel=0.05)

    @pytest.mark.parametrize(
        ("belief", "reason"),
        [
            (Belief(1.0), "nothing is believed yet"),
            (Belief(1.0, Pose2()), "on top of the beacon"),
            (Belief(1.0, Pose2(0.5, 0.0, 0.0), np.eye(3)), "0.5 m away, its direction is a guess"),
        ],
    )
    def test_where_the_direction_is_unknown_it_is_lost(self, belief: Belief, reason: str) -> None:
        lost = range_fix(belief, (0.0, 0.0), 1.0, 0.1)

        assert isinstance(lost, Lost)
        assert lost.stamp_s == 1.0
        assert reason in lost.reason

    def test_what_cannot_be_a_range_is_refused(self) -> None:
        belief = Belief(0.0, Pose2(1.0, 0.0, 0.0))

        for range_m in (-1.0, math.nan, math.inf):
            with pytest.raises(ValueError, match="finite and not negative"):
                range_fix(belief, (0.0, 0.0), range_m, 0.1)
        with pytest.raises(ValueError, match="must be positive, not 0"):
            range_fix(belief, (0.0, 0.0), 1.0, 0.0)


def test_the_information_of_a_covariance_is_what_numpy_gives_bit_by_bit() -> None:
    rng = np.random.default_rng(3)
    n_checked = 0
    for _ in range(500):
        root = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-6.0, 3.0, size=(3, 1))
        covariance = root @ root.T
        covariance = (covariance + covariance.T) / 2.0
        try:
            factor = np.linalg.inv(np.linalg.cholesky(covariance))
        except np.linalg.LinAlgError:
            continue
        n_checked += 1
        assert information_from_covariance(covariance).tobytes() == (factor.T @ factor).tobytes()
    assert n_checked > 450


@pytest.mark.parametrize("bad", [-1.0, 0.0, float("nan")])
def test_a_covariance_without_an_inverse_is_refused_without_a_warning(bad: float, recwarn) -> None:
    with pytest.raises(ValueError, match=r"not symmetric|not positive definite"):
        information_from_covariance(np.diag([1.0, 1.0, bad]))

    assert not recwarn.list


def test_the_health_of_which_nothing_is_to_be_said_is_one_for_all_and_cannot_be_written_to() -> None:
    belief = Belief(1.0)
    assert belief.health is ALL_HEALTHY
    assert pickle.loads(pickle.dumps(belief)).health is ALL_HEALTHY
    assert copy.deepcopy(belief).health is ALL_HEALTHY
    assert json.dumps(dataclasses.asdict(belief)["health"]) == "{}"
    for write in (
        lambda health: health.__setitem__("wheels", "silent"),
        lambda health: health.update(wheels="silent"),
        lambda health: health.setdefault("wheels", "silent"),
        lambda health: operator.ior(health, {"wheels": "silent"}),
    ):
        with pytest.raises(TypeError, match="cannot be written to"):
            write(belief.health)
    assert belief.health == {}
