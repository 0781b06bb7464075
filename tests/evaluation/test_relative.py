from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.errors import ConfigError
from trailmark.evaluation import Pairs, associate, drift, relative_error
from trailmark.evaluation.relative import between, default_distance_m
from trailmark.geometry import Pose2, Trajectory


def _stretched(trajectory: Trajectory, factor: float) -> Trajectory:
    return Trajectory(trajectory.stamps_s, trajectory.poses * [factor, factor, 1.0])


def test_a_scale_error_of_two_percent_is_two_percent_of_every_distance(straight: Trajectory) -> None:
    pairs = associate(_stretched(straight, 1.02), straight)

    error = relative_error(pairs, 1.0, "m")

    assert error is not None
    assert error.n == 91  # 101 poses 0.1 m apart: the last 10 have none 1 m ahead
    assert error.metrics()["rpe_rmse_m[1m,n=91]"] == pytest.approx(0.02)
    assert error.metrics()["rpe_heading_rmse_deg[1m,n=91]"] == pytest.approx(0.0, abs=1e-9)


def test_over_a_time_the_same_error_grows_with_the_speed(straight: Trajectory) -> None:
    error = relative_error(associate(_stretched(straight, 1.02), straight), 2.0, "s")

    assert error is not None
    assert error.metrics()["rpe_mean_m[2s,n=81]"] == pytest.approx(0.04)


def test_a_constant_turn_rate_error_is_found_in_degrees_per_metre(straight: Trajectory) -> None:
    turning = straight.poses + np.outer(straight.travelled_m(), [0.0, 0.0, math.radians(0.5)])

    found = drift(associate(Trajectory(straight.stamps_s, turning), straight))

    assert found is not None
    assert found.deg_per_m == pytest.approx(0.5)


def test_drift_of_a_stretched_way_is_its_scale_error(figure_eight: Trajectory) -> None:
    found = drift(associate(_stretched(figure_eight, 1.05), figure_eight), lengths_m=[0.2])

    assert found is not None
    assert found.percent == pytest.approx(5.0, rel=0.01)  # a chord is a little shorter than its way


def test_drift_names_the_lengths_it_was_taken_over(straight: Trajectory) -> None:
    found = drift(associate(_stretched(straight, 1.01), straight))

    assert found is not None
    assert found.metrics() == {
        "drift_percent[1-8m,n=448]": pytest.approx(1.0),
        "drift_deg_per_m[1-8m,n=448]": pytest.approx(0.0, abs=1e-9),
    }


def test_pieces_across_a_gap_do_not_count(straight: Trajectory) -> None:
    kept = (straight.stamps_s < 4.0) | (straight.stamps_s > 6.0)
    gappy = Trajectory(straight.stamps_s[kept], straight.poses[kept])

    error = relative_error(associate(gappy, straight), 1.0, "m")

    assert error is not None
    assert error.n == 31 + 30  # 40 poses before the gap, 40 after; 3.0 m takes 3.9 m, a tenth short


def test_a_way_shorter_than_the_distance_has_no_relative_error(straight: Trajectory, static: Trajectory) -> None:
    assert relative_error(associate(straight, straight), 11.0, "m") is None
    assert drift(associate(static, static)) is None
    assert drift(associate(straight, straight), lengths_m=[20.0]) is None


@pytest.mark.parametrize("delta", [0.0, -1.0, math.nan])
def test_a_delta_must_be_positive(delta: float, straight: Trajectory) -> None:
    with pytest.raises(ConfigError, match="positive distance or time"):
        relative_error(associate(straight, straight), delta, "m")


@pytest.mark.parametrize(
    ("length_m", "expected"), [(10.0, 1.0), (9.99, 0.5), (35.0, 2.0), (50.0, 5.0), (0.3, 0.02), (1234.0, 100.0)]
)
def test_the_default_distance_is_a_round_number_at_most_a_tenth_of_the_way(length_m: float, expected: float) -> None:
    assert default_distance_m(length_m) == pytest.approx(expected)


def test_no_way_has_no_default_distance() -> None:
    assert default_distance_m(0.0) is None


@given(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0), st.floats(-3.0, 3.0))
def test_relative_errors_need_no_alignment(x: float, y: float, theta: float) -> None:
    phase = np.linspace(0.0, 6.0, 80)
    truth = Trajectory(phase, np.column_stack([np.sin(phase), np.cos(phase), -phase]))
    noise = np.random.default_rng(7).normal(size=truth.poses.shape) * 0.02
    estimate = Trajectory(truth.stamps_s, truth.poses + noise)

    here, there = (
        relative_error(associate(item, truth), 1.0, "m")
        for item in (estimate, estimate.transformed(Pose2(x, y, theta)))
    )

    assert here is not None
    assert there is not None
    assert there.position.rmse == pytest.approx(here.position.rmse, abs=1e-9)


def test_between_is_that_of_poses() -> None:
    a, b = Pose2(1.0, 2.0, 3.0), Pose2(-1.0, 0.5, -3.0)

    np.testing.assert_allclose(between(a.array()[None], b.array()[None])[0], a.between(b).array(), atol=1e-12)


def test_every_pair_is_at_most_a_tenth_off_its_delta(figure_eight: Trajectory) -> None:
    pairs: Pairs = associate(figure_eight, figure_eight)
    step_m = float(np.diff(figure_eight.travelled_m()).max())

    assert relative_error(pairs, step_m / 5.0, "m") is None  # no two poses are that near
