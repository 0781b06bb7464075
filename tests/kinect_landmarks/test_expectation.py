"""What movement is expected, and what that is worth against things that move."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.geometry import Pose2, Pose3
from trailmark_kinect_landmarks.alignment import CloudAlignment, align
from trailmark_kinect_landmarks.expectation import Expectation, Expected


def _T(x: float, turn_rad: float = 0.0) -> np.ndarray:
    return Pose3.from_planar(Pose2(x, 0.0, turn_rad)).matrix()


def _driven(steps_m: list[float]) -> Expectation:
    expectation = Expectation()
    expectation.begin(0.0, _T(0.0))
    x = 0.0
    for i, step_m in enumerate(steps_m):
        x += step_m
        expectation.took(0.1 * (i + 1), _T(x))
    return expectation


def test_the_velocity_is_carried_on() -> None:
    expectation = Expectation()
    expectation.begin(0.0, _T(0.0))
    expectation.took(0.1, _T(0.03, 0.1))

    expected = expectation.pose(0.2)

    assert expected is not None
    np.testing.assert_allclose(expected, _T(0.03, 0.1) @ _T(0.03, 0.1), atol=1e-12)


def test_after_a_pause_the_velocity_is_no_longer_known() -> None:
    expectation = _driven([0.03] * 30)
    regular, late = expectation.motion(3.1, 2), expectation.motion(3.6, 2)

    assert regular is not None
    assert late is not None
    assert late.t == pytest.approx([0.9, 0.0])
    assert (late.sigma_m > 10 * regular.sigma_m).all()


def test_even_driving_is_worth_more_than_a_shaking_hand() -> None:
    even, shaky = _driven([0.03] * 40), _driven([0.03, -0.03] * 20)
    one, other = even.motion(4.1, 2), shaky.motion(4.1, 2)

    assert one is not None
    assert other is not None
    assert (one.sigma_m < 0.01).all()
    assert other.sigma_m[0] > 0.1
    assert other.sigma_m[1] < 0.01  # it shakes along one axis


def test_a_few_pictures_tell_how_even_it_drives() -> None:
    begun = _driven([0.03] * 4).motion(0.5, 2)

    assert begun is not None
    assert (begun.sigma_m < 0.01).all()


def test_nothing_is_expected_of_what_is_forgotten() -> None:
    expectation = _driven([0.03])
    expectation.forget()

    assert expectation.pose(0.2) is None
    assert expectation.motion(0.2, 3) is None
    assert expectation.last is None


@pytest.mark.parametrize("n_dimensions", [2, 3])
def test_an_expectation_knows_how_far_off_a_pose_is(n_dimensions: int) -> None:
    D = n_dimensions
    T = Pose3(0.1, 0.2, 0.0, yaw=0.3).matrix()

    off = Expected(T[:D, :D], T[:D, 3], np.full(D, 0.1), 0.1).seen_from(np.eye(D), np.zeros(D))

    np.testing.assert_allclose(off, [0.1, 0.2, 0.3] if D == 2 else [0.1, 0.2, 0.0, 0.0, 0.0, 0.3], atol=1e-12)


def test_a_crate_that_walks_before_a_far_wall_does_not_turn_the_robot() -> None:
    # Far landmarks alone forgive a shift that a turn makes up for: a near crate has it all its own way without the
    # expected movement.
    rng = np.random.default_rng(7)
    wall = np.stack([np.full(40, 5.0), np.linspace(-2.0, 2.0, 40)], axis=1)
    crate = np.stack([np.full(17, 2.2), 0.6 + 0.02 * np.arange(17)], axis=1)
    then = np.concatenate([wall, crate])
    away = np.linalg.norm(then, axis=1)
    sigma_depth, sigma_side = 1.4e-3 * away**2, away / 525.0
    now = then + rng.normal(size=then.shape) * np.stack([sigma_depth, sigma_side], axis=1) * 0.7
    now[40:, 1] += 0.05
    cov = np.zeros((57, 2, 2))
    cov[:, 0, 0], cov[:, 1, 1] = sigma_depth**2, sigma_side**2
    nothing = np.tile(np.eye(2) * 1e-6, (57, 1, 1))
    expected = Expected(np.eye(2), np.zeros(2), np.full(2, 0.005), math.radians(0.2))

    without = align(then, now, nothing, cov, rng=np.random.default_rng(1))
    found = align(then, now, nothing, cov, rng=np.random.default_rng(1), expected=expected)

    assert isinstance(without, CloudAlignment)
    assert isinstance(found, CloudAlignment)
    assert np.linalg.norm(without.t) > 0.05
    assert np.linalg.norm(found.t) < 0.01
    assert not found.inliers[40:].any()
    assert found.inliers[:40].mean() > 0.9


def test_an_expectation_that_is_far_off_is_overruled() -> None:
    rng = np.random.default_rng(3)
    then = rng.uniform((1.0, -2.0), (4.0, 2.0), (30, 2))
    true = Pose2(0.8, -0.4, 0.5)
    now = true.inverse() @ then
    cov = np.tile(np.eye(2) * 1e-4, (30, 1, 1))

    found = align(then, now, cov, cov, rng=rng, expected=Expected(np.eye(2), np.zeros(2), np.full(2, 0.003), 0.002))

    assert isinstance(found, CloudAlignment)
    np.testing.assert_allclose(found.t, [0.8, -0.4], atol=1e-9)


def _driven_fast(seconds: float, step_m: float, jump_m: float = 0.0, since_s: float = np.inf) -> Expectation:
    """30 pictures a second; from a time on each pose is led along by more and more."""
    expectation = Expectation()
    expectation.begin(0.0, _T(0.0))
    for i in range(1, round(30 * seconds) + 1):
        led_m = jump_m * max(0, i - round(30 * since_s)) if np.isfinite(since_s) else 0.0
        expectation.took(i / 30, _T(step_m * i + led_m))
    return expectation


def test_what_begins_to_lead_the_newest_poses_along_does_not_lead_the_expectation() -> None:
    # 1.7 cm a picture more, for the last two pictures
    expected = _driven_fast(2.0, 0.01, jump_m=0.017, since_s=58 / 30).motion(61 / 30, 2)

    assert expected is not None
    assert expected.t[0] == pytest.approx(0.61, abs=1e-9)
    assert expected.sigma_m[0] < 0.01


def test_of_a_hand_the_newest_poses_tell_most() -> None:
    rng = np.random.default_rng(0)
    x_m, expectation = np.cumsum(np.cumsum(rng.normal(0.0, 0.006, 90))), Expectation()
    expectation.begin(0.0, _T(0.0))
    for i, x in enumerate(x_m, start=1):
        expectation.took(i / 30, _T(float(x)))

    expected = expectation.motion(91 / 30, 2)

    assert expected is not None
    assert expected.t[0] == pytest.approx(2.0 * x_m[-1] - x_m[-2])


def test_rare_pictures_are_expected_by_the_last_two() -> None:
    expectation = _driven([0.03] * 28 + [0.05])

    expected = expectation.motion(3.0, 2)

    assert expected is not None
    assert expected.t[0] == pytest.approx(28 * 0.03 + 2 * 0.05)


def test_uneven_pictures_have_their_share_of_the_motion() -> None:
    expectation = Expectation()
    expectation.begin(0.0, _T(0.0))
    stamps = np.cumsum(np.tile([0.03, 0.036, 0.033], 30))
    for stamp_s in stamps.tolist():
        expectation.took(stamp_s, _T(0.3 * stamp_s, 0.2 * stamp_s))

    expected = expectation.motion(float(stamps[-1]) + 0.03, 2)

    assert expected is not None
    there = _T(0.3 * (stamps[-1] + 0.03), 0.2 * (stamps[-1] + 0.03))
    np.testing.assert_allclose(expected.t, there[:2, 3], atol=1e-3)  # it turns on the way
    np.testing.assert_allclose(expected.R, there[:2, :2], atol=5e-4)
