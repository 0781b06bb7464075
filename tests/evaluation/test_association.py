from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.errors import DataError
from trailmark.evaluation import associate
from trailmark.evaluation.association import poses_at, usual_interval_s
from trailmark.geometry import Trajectory


def _along_x(stamps: object, speed_mps: float = 1.0) -> Trajectory:
    times = np.asarray(stamps, dtype=float)
    return Trajectory(times, np.column_stack([speed_mps * times, np.zeros_like(times), np.zeros_like(times)]))


def test_the_truth_is_interpolated_at_the_stamps_of_a_sparser_estimate() -> None:
    pairs = associate(_along_x([0.05, 0.55, 1.05]), _along_x(np.arange(0.0, 2.0, 0.1)))

    assert pairs.interpolated == "truth"
    np.testing.assert_allclose(pairs.truth.stamps_s, [0.05, 0.55, 1.05])
    np.testing.assert_allclose(pairs.truth.positions[:, 0], [0.05, 0.55, 1.05], atol=1e-12)


def test_a_denser_estimate_is_interpolated_at_the_stamps_of_the_truth() -> None:
    pairs = associate(_along_x(np.arange(0.0, 2.0, 0.01)), _along_x([0.505, 1.005, 1.505]))

    assert pairs.interpolated == "estimate"
    np.testing.assert_allclose(pairs.estimate.positions[:, 0], [0.505, 1.005, 1.505], atol=1e-12)


def test_equal_rates_interpolate_the_truth_whatever_the_last_bits_say() -> None:
    stamps = np.arange(0.0, 1.0, 0.1)

    assert associate(_along_x(stamps * (1.0 - 1e-9)), _along_x(stamps)).interpolated == "truth"


def test_nothing_is_extrapolated() -> None:
    pairs = associate(_along_x([-1.0, 0.0, 0.5, 1.0, 5.0]), _along_x(np.arange(0.0, 1.05, 0.1)))

    np.testing.assert_allclose(pairs.estimate.stamps_s, [0.0, 0.5, 1.0])
    assert (pairs.n_estimate, pairs.n_truth, len(pairs)) == (5, 11, 3)


def test_stamps_inside_a_gap_of_the_truth_are_left_out() -> None:
    truth = _along_x([0.0, 0.1, 0.2, 0.3, 5.3, 5.4, 5.5])

    pairs = associate(_along_x(np.arange(0.0, 5.5, 0.25)), truth)

    np.testing.assert_allclose(pairs.estimate.stamps_s, [0.0, 0.25, 5.25])
    assert pairs.max_difference_s == pytest.approx(0.15)


def test_stamps_that_come_in_bursts_lose_no_pairs() -> None:
    truth = _along_x(np.sort(np.concatenate([np.arange(0.0, 10.0, 0.02), np.arange(0.001, 10.0, 0.02)])))

    pairs = associate(_along_x(np.arange(0.0, 9.9, 0.1)), truth)

    assert len(pairs) == 99
    assert usual_interval_s(truth.stamps_s) == pytest.approx(0.019)


def test_a_wider_tolerance_bridges_the_gap() -> None:
    truth = _along_x([0.0, 0.1, 0.2, 0.3, 5.3, 5.4, 5.5])

    pairs = associate(_along_x(np.arange(0.0, 5.5, 0.25)), truth, max_difference_s=10.0)

    assert len(pairs) == 22


def test_headings_take_the_short_turn_across_pi() -> None:
    truth = Trajectory([0.0, 1.0], [[0.0, 0.0, math.pi - 0.1], [0.0, 0.0, -math.pi + 0.1]])
    estimate = Trajectory([0.0, 0.5, 1.0], np.zeros((3, 3)))

    pairs = associate(estimate, truth, interpolate="truth")

    assert abs(pairs.truth.headings[1]) == pytest.approx(math.pi)


@pytest.mark.parametrize(("n", "count"), [(0, "no poses"), (1, "1 pose")])
def test_too_short_an_estimate_is_refused(n: int, count: str) -> None:
    short = Trajectory(np.arange(n, dtype=float), np.zeros((n, 3)))

    with pytest.raises(DataError, match=rf"the estimate has {count}; at least 2"):
        associate(short, _along_x([0.0, 1.0]))
    with pytest.raises(DataError, match=rf"the ground truth has {count}; at least 2"):
        associate(_along_x([0.0, 1.0]), short)


def test_clocks_without_overlap_are_refused_with_both_spans() -> None:
    epoch = Trajectory([1.3e9, 1.3e9 + 1.0], np.zeros((2, 3)))

    with pytest.raises(DataError, match=r"covers 0.000 to 1.000 s, the ground truth 1300000000.000 .* clocks the same"):
        associate(_along_x([0.0, 1.0]), epoch)


def test_poses_are_looked_up_in_any_order_and_unknown_ones_are_nan() -> None:
    truth = _along_x(np.arange(0.0, 1.05, 0.1))

    poses = poses_at(truth, np.array([0.75, 0.25, 0.25, -1.0, 3.0]), 0.1)

    np.testing.assert_allclose(poses[:3, 0], [0.75, 0.25, 0.25], atol=1e-12)
    assert np.isnan(poses[3:]).all()


def test_one_pose_alone_is_no_trajectory_to_look_up_in() -> None:
    alone = Trajectory([0.0], [[1.0, 2.0, 3.0]])

    assert np.isnan(poses_at(alone, np.array([0.0]), 1.0)).all()
    assert usual_interval_s(alone.stamps_s) == math.inf


def test_several_stamps_a_nanosecond_before_the_truth_begins_are_pairs() -> None:
    truth = Trajectory(np.arange(100.0, 103.0, 0.1), np.zeros((30, 3)))
    stamps = np.concatenate([[100.0 - 2e-9, 100.0 - 1e-9], np.arange(100.1, 102.0, 0.1)])

    pairs = associate(Trajectory(stamps, np.zeros((len(stamps), 3))), truth, interpolate="truth")

    assert len(pairs) == len(stamps)
    assert (np.diff(pairs.truth.stamps_s) > 0.0).all()
