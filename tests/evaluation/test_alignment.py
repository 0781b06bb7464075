from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.errors import ConfigError
from trailmark.evaluation import absolute_error, align, associate
from trailmark.geometry import Pose2, Trajectory

POSES = st.builds(Pose2, st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.floats(-math.pi, math.pi, exclude_max=True))


def _wavy(n: int = 60) -> Trajectory:
    x = np.linspace(0.0, 6.0, n)
    return Trajectory(np.arange(n) * 0.1, np.column_stack([x, np.sin(x), np.arctan(np.cos(x))]))


def _line(n: int = 30) -> Trajectory:
    x = np.linspace(0.0, 3.0, n)
    return Trajectory(np.arange(n) * 0.1, np.column_stack([x, np.zeros(n), np.zeros(n)]))


@given(POSES)
@pytest.mark.parametrize("truth", [_wavy(), _line()], ids=["curved", "straight"])
def test_se2_undoes_any_rigid_motion(truth: Trajectory, pose: Pose2) -> None:
    pairs = associate(truth.transformed(pose), truth)

    alignment = align(pairs, "se2")
    error = absolute_error(pairs, alignment)

    assert (alignment.used, alignment.reason) == ("se2", "")
    assert error.position.max < 1e-9
    assert error.heading.max < 1e-9


@given(POSES)
def test_the_error_under_se2_ignores_a_rigid_motion_of_a_noisy_estimate(pose: Pose2) -> None:
    truth = _wavy()
    noise = np.random.default_rng(7).normal(size=truth.poses.shape) * [0.05, 0.05, 0.01]
    estimate = Trajectory(truth.stamps_s, truth.poses + noise)

    still, moved = (associate(item, truth) for item in (estimate, estimate.transformed(pose)))

    expected, actual = (absolute_error(pairs, align(pairs, "se2")) for pairs in (still, moved))
    assert actual.position.rmse == pytest.approx(expected.position.rmse, abs=1e-9)
    assert actual.heading.rmse == pytest.approx(expected.heading.rmse, abs=1e-9)


def test_no_rigid_motion_does_better_than_se2(figure_eight: Trajectory, noisy: Callable[..., Trajectory]) -> None:
    pairs = associate(noisy(figure_eight, 0.1), figure_eight)
    best = align(pairs, "se2")

    def rmse(pose: Pose2) -> float:
        offsets = pairs.estimate.transformed(pose).positions - pairs.truth.positions
        return float(np.sqrt((offsets**2).sum(axis=1).mean()))

    for step in (Pose2(1e-3, 0, 0), Pose2(0, 1e-3, 0), Pose2(0, 0, 1e-3), Pose2(0, 0, -1e-3), Pose2(-1e-3, 0, 0)):
        assert rmse(step @ best.pose_truth_estimate) > rmse(best.pose_truth_estimate)


def test_origin_lays_the_first_pose_on_the_first_true_pose(straight: Trajectory) -> None:
    estimate = straight.transformed(Pose2(3.0, 4.0, 1.0))
    pairs = associate(estimate, straight)

    alignment = align(pairs, "origin")

    assert alignment.used == "origin"
    np.testing.assert_allclose(alignment.apply(estimate).poses, straight.poses, atol=1e-12)


def test_none_leaves_everything_where_it_is(straight: Trajectory) -> None:
    pairs = associate(straight.transformed(Pose2(3.0, 4.0, 0.0)), straight)

    alignment = align(pairs, "none")

    assert alignment.pose_truth_estimate == Pose2()
    assert absolute_error(pairs, alignment).position.mean == pytest.approx(5.0)


def test_a_straight_line_with_noise_is_aligned_by_its_direction(
    straight: Trajectory, noisy: Callable[..., Trajectory]
) -> None:
    turned = noisy(straight, 0.01).transformed(Pose2(0.0, 0.0, 2.0))

    alignment = align(associate(turned, straight), "se2")

    assert alignment.used == "se2"
    assert alignment.pose_truth_estimate.theta == pytest.approx(-2.0, abs=2e-3)


@pytest.mark.parametrize("which", ["estimate", "truth", "estimate and the truth"])
def test_where_one_stands_still_se2_falls_back_to_origin_and_says_so(
    which: str, straight: Trajectory, static: Trajectory
) -> None:
    estimate = static if "estimate" in which else straight
    truth = static if "truth" in which else straight

    alignment = align(associate(estimate, truth), "se2")

    assert (alignment.asked, alignment.used) == ("se2", "origin")
    assert alignment.reason == f"the {which} stands still, so no direction can be told"
    assert alignment.document()["used"] == "origin"


def test_an_unknown_alignment_is_refused_with_the_known_ones(straight: Trajectory) -> None:
    with pytest.raises(ConfigError, match="no alignment named 'sim3'; available: none, origin, se2"):
        align(associate(straight, straight), "sim3")  # type: ignore[arg-type]
