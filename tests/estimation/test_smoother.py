"""The fixed-lag smoother: the poses of a window, what leaves it, and what does not fit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import approx_fprime, least_squares

from trailmark.arrays import Floats
from trailmark.estimates import Estimate, Fix, Motion, PathOffset, information_from_sigmas
from trailmark.estimation.smoother.estimator import Smoother
from trailmark.estimation.smoother.robust import bounded_chi_squares, weights_of
from trailmark.estimation.smoother_config import RobustLoss, SmootherConfig
from trailmark.geometry import Pose2, wrap_angle
from trailmark.interfaces import Session
from trailmark.paths import Path, Waypoint

_DT_S = 0.1
_STEP_SIGMAS = (0.02, 0.01, 0.02)
_FIX_SIGMAS = (0.1, 0.1, 0.05)


_ORIGIN = Pose2()


def started(start: Pose2 | None = _ORIGIN, path: Path | None = None, **keys: object) -> Smoother:
    smoother = Smoother(SmootherConfig.model_validate(keys))
    smoother.start(Session("estimator", start_pose=start, path=path))
    return smoother


def true_pose(step: int) -> Pose2:
    return Pose2.exp(0.05 * step, 0.0, 0.01 * step)


def motion(step: int, rng: np.random.Generator | None = None) -> Motion:
    noise = np.zeros(3) if rng is None else rng.normal(0.0, _STEP_SIGMAS)
    pose = true_pose(step - 1).between(true_pose(step))
    noisy = Pose2(pose.x + noise[0], pose.y + noise[1], pose.theta + noise[2])
    return Motion((step - 1) * _DT_S, step * _DT_S, noisy, information_from_sigmas(*_STEP_SIGMAS))


def fix(step: int, off: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Fix:
    pose = true_pose(step)
    measured = Pose2(pose.x + off[0], pose.y + off[1], pose.theta + off[2])
    return Fix(step * _DT_S, measured, information_from_sigmas(*_FIX_SIGMAS))


def drive(n_steps: int, seed: int = 7) -> list[tuple[str, Estimate]]:
    """Motions, and a fix after every fifth."""
    rng = np.random.default_rng(seed)
    told: list[tuple[str, Estimate]] = []
    for step in range(1, n_steps + 1):
        told.append(("wheels", motion(step, rng)))
        if step % 5 == 0:
            dx, dy, turn = rng.normal(0.0, _FIX_SIGMAS)
            told.append(("fixes", fix(step, (dx, dy, turn))))
    return told


def tell(smoother: Smoother, told: list[tuple[str, Estimate]]) -> list[str]:
    return [smoother.apply(source, estimate).status for source, estimate in told]


def believed(smoother: Smoother, stamp_s: float | None = None) -> tuple[Floats, Floats]:
    belief = smoother.belief(stamp_s)
    assert belief.pose_map_base is not None
    assert belief.covariance is not None
    return belief.pose_map_base.array(), belief.covariance


def least_squares_poses(told: list[tuple[str, Estimate]], n_steps: int) -> tuple[Floats, Floats]:
    """The twin: every pose of every motion in one dense problem; poses and their covariance."""

    def residuals(flat: Floats) -> Floats:
        poses = [Pose2(*row) for row in flat.reshape(-1, 3).tolist()]
        found = [poses[0].array() / [0.01, 0.01, math.radians(0.5)]]
        for _, estimate in told:
            if isinstance(estimate, Motion):
                step = round(estimate.stamp_s / _DT_S)
                away = poses[step - 1].between(poses[step]).array() - estimate.pose_since_now.array()
                found.append(away / _STEP_SIGMAS)
            elif isinstance(estimate, Fix):
                away = poses[round(estimate.stamp_s / _DT_S)].array() - estimate.pose_map_base.array()
                found.append(away / _FIX_SIGMAS)
            found[-1][2] = wrap_angle(float(found[-1][2]))
        return np.concatenate(found)

    begin = np.array([true_pose(step).array() for step in range(n_steps + 1)]).ravel()
    solved = least_squares(residuals, begin, xtol=1e-12, ftol=1e-12)
    return solved.x.reshape(-1, 3), np.linalg.inv(solved.jac.T @ solved.jac)


def test_poses_and_covariances_are_those_of_dense_least_squares() -> None:
    told = drive(20)
    smoother = started(loss="none", gate="off")

    tell(smoother, told)

    poses, covariance = least_squares_poses(told, 20)
    for step in (20, 10, 5):  # the newest, and two of the past
        pose, spread = believed(smoother, step * _DT_S)
        at = slice(3 * step, 3 * step + 3)
        # Motions are added up once, so that the bend of a pair of them is linearised: some 0.1 mm here.
        np.testing.assert_allclose(pose, poses[step], atol=1e-3)
        np.testing.assert_allclose(np.sqrt(spread.diagonal()), np.sqrt(covariance[at, at].diagonal()), rtol=0.02)


def test_what_leaves_the_window_goes_on_to_count() -> None:
    told = drive(300)
    short, long = started(lag_s=2.0), started(lag_s=50.0)

    tell(short, told)
    tell(long, told)

    (pose, spread), (expected, covariance) = believed(short), believed(long)
    np.testing.assert_allclose(pose, expected, atol=2e-3)  # 2 % of a fix's sigma: derivatives of another instant
    np.testing.assert_allclose(spread, covariance, rtol=0.02, atol=1e-6)


@pytest.mark.parametrize("late", ["fixes", "wheels"])
def test_what_comes_late_counts_as_if_it_had_come_in_time(late: str) -> None:
    told = drive(60)
    in_time, smoother = started(), started()
    of_late = [one for one in told if one[0] == late and one[1].stamp_s > 3.0]
    order = [one for one in told if one not in of_late] + of_late

    tell(in_time, told)
    statuses = tell(smoother, order)

    assert set(statuses) == {"accepted"}
    np.testing.assert_allclose(believed(smoother)[0], believed(in_time)[0], atol=1e-4)
    np.testing.assert_allclose(believed(smoother)[1], believed(in_time)[1], rtol=1e-3, atol=1e-9)


def test_what_is_older_than_the_window_is_late() -> None:
    smoother = started(lag_s=2.0)
    tell(smoother, drive(60))

    before = believed(smoother)[0]

    assert smoother.apply("fixes", fix(30)).status == "late"
    np.testing.assert_array_equal(believed(smoother)[0], before)


def test_an_outlier_is_gated_and_moves_the_belief_by_less_than_a_millimetre() -> None:
    smoother = started()
    tell(smoother, drive(50))
    before = believed(smoother)[0]

    applied = smoother.apply("fixes", fix(50, (3.0, 0.0, 0.0)))

    assert applied.status == "gated"
    assert applied.nis is not None
    assert applied.nis > 16.3
    np.testing.assert_allclose(believed(smoother)[0], before, atol=1e-3)


def test_an_outlier_that_was_believed_is_let_go_when_others_contradict_it() -> None:
    """While nothing else is known an outlier cannot be told from a fix: the window turns that verdict later."""
    smoother = started(start_sigma_m=3.0)
    assert smoother.apply("fixes", fix(0, (2.0, 2.0, 0.0))).status == "accepted"
    assert math.hypot(*believed(smoother)[0][:2]) > 2.0

    for step in range(1, 31):
        smoother.apply("wheels", motion(step))
        smoother.apply("others", fix(step))

    away = believed(smoother)[0] - true_pose(30).array()
    assert np.hypot(*away[:2]) < 0.03  # `kalman`, which takes the others for outliers at first, is 2.8 m off then


def test_a_belief_that_is_wrong_is_wide_and_then_given_up() -> None:
    smoother = started(Pose2(4.0, 0.0, math.pi / 2.0))
    n_until_found = None
    for step in range(1, 101):
        smoother.apply("wheels", motion(step))
        if step % 5 == 0:
            smoother.apply("fixes", fix(step))
        pose, covariance = believed(smoother)
        away = np.hypot(*(pose - true_pose(step).array())[:2])
        if n_until_found is None and away < 0.2:
            n_until_found = step
        if step >= 20 and n_until_found is None:
            assert math.sqrt(covariance[0, 0] + covariance[1, 1]) > away / 5.0

    assert n_until_found is not None
    assert n_until_found <= 30
    assert smoother.counters()["recoveries"] == 1
    assert np.hypot(*(believed(smoother)[0] - true_pose(100).array())[:2]) < 0.1


def test_a_contradiction_that_another_localizer_denies_widens_nothing() -> None:
    smoother = started()
    for step in range(1, 101):
        smoother.apply("wheels", motion(step))
        smoother.apply("right", fix(step))
        smoother.apply("wrong", fix(step, (2.0, 0.0, 0.0)))

    pose, covariance = believed(smoother)
    assert np.hypot(*(pose - true_pose(100).array())[:2]) < 0.02
    assert math.sqrt(covariance[0, 0]) < 0.05
    assert "contradicts" in smoother.belief().health["wrong"]


def test_a_gap_makes_the_belief_wide_and_a_fix_after_it_is_taken() -> None:
    smoother = started()
    tell(smoother, drive(50))

    smoother.apply("fixes", fix(100, (1.5, 0.0, 0.0)))
    wide = math.sqrt(believed(smoother, 9.9)[1][0, 0])

    assert wide > 0.5
    assert smoother.belief().motion_age_s == pytest.approx(5.0)
    assert abs(believed(smoother)[0][0] - fix(100, (1.5, 0.0, 0.0)).pose_map_base.x) < 0.1


def test_a_gyro_beside_wheels_is_weighed_by_its_certainty() -> None:
    smoother = started()
    for step in range(1, 101):
        told = motion(step)
        slipping = Pose2(told.pose_since_now.x, told.pose_since_now.y, told.pose_since_now.theta + 0.01)
        smoother.apply("wheels", Motion(told.since_s, told.stamp_s, slipping, told.information))
        gyro = information_from_sigmas(math.inf, math.inf, 0.001)
        smoother.apply("gyro", Motion(told.since_s, told.stamp_s, Pose2(0.0, 0.0, told.pose_since_now.theta), gyro))

    expected = 100 * 0.01 * 0.001**2 / (0.001**2 + 0.02**2)  # what is left of a radian
    assert believed(smoother)[0][2] - true_pose(100).theta == pytest.approx(expected, rel=0.01)


def test_path_offsets_hold_the_robot_to_the_taught_path() -> None:
    path = Path([Waypoint(index, 0.5 * index, Pose2(0.5 * index)) for index in range(20)])
    smoother = started(path=path, start_sigma_m=0.5)
    information = information_from_sigmas(math.inf, 0.02, 0.02)
    for step in range(1, 41):
        told = Motion((step - 1) * _DT_S, step * _DT_S, Pose2(0.1), information_from_sigmas(*_STEP_SIGMAS))
        smoother.apply("wheels", told)
        assert smoother.apply("path", PathOffset(step * _DT_S, 0.1 * step, 0.3, 0.0, information)).status == "accepted"

    belief = smoother.belief()
    assert belief.on_path is not None
    assert belief.on_path.lateral_m == pytest.approx(0.3, abs=0.01)
    assert belief.on_path.station_m == pytest.approx(4.0, abs=0.1)


def test_without_a_start_parts_are_unused_and_a_whole_pose_begins() -> None:
    smoother = started(None)
    part = Fix(1.0, Pose2(), information_from_sigmas(0.1, 0.1, math.inf))

    assert smoother.apply("parts", part).status == "unused"
    assert smoother.belief().pose_map_base is None
    assert smoother.apply("fixes", fix(20)).status == "accepted"
    np.testing.assert_allclose(believed(smoother)[0], true_pose(20).array())


def test_odometry_does_not_jump_when_motion_comes_late() -> None:
    smoother = started()
    tell(smoother, drive(20))
    before = smoother.belief().pose_odom_base

    quick = Motion(1.0, 2.0, Pose2(2.0), information_from_sigmas(0.001, 0.001, 0.001))
    smoother.apply("late", quick)

    assert smoother.belief(2.0).pose_odom_base.distance_to(before) < 1e-12


@pytest.mark.parametrize("loss", ["dcs", "huber"])
def test_weights_are_derivatives_of_what_is_least(loss: RobustLoss) -> None:
    limits, squares = np.full(6, 9.0), np.array([0.5, 4.0, 8.9, 9.5, 40.0, 900.0])

    weights = weights_of(loss, squares, limits)

    def total(chi_squares: Floats) -> float:
        return float(bounded_chi_squares(loss, chi_squares, limits).sum())

    np.testing.assert_allclose(weights, approx_fprime(squares, total, 1e-6), atol=1e-4)


def test_a_config_with_a_window_longer_than_a_jump_is_refused() -> None:
    with pytest.raises(ValueError, match="must be longer than lag_s"):
        SmootherConfig(lag_s=90.0)
    with pytest.raises(ValueError, match="gate must be a probability"):
        SmootherConfig(gate=1.5)


@pytest.mark.parametrize("start", [None, _ORIGIN])
def test_fixes_alone_are_followed_while_nobody_tells_motion(start: Pose2 | None) -> None:
    smoother, rng = started(start), np.random.default_rng(5)
    for step in range(5, 301, 5):
        dx, dy, turn = rng.normal(0.0, _FIX_SIGMAS)
        assert smoother.apply("fixes", fix(step, (dx, dy, turn))).status == "accepted"

    belief = smoother.belief()
    assert belief.pose_map_base is not None
    assert belief.covariance is not None
    away = true_pose(300).between(belief.pose_map_base)
    assert math.hypot(away.x, away.y) < 4.0 * math.sqrt(float(np.trace(belief.covariance[:2, :2])))
