from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.evaluation import evaluate_run_folder, read_run
from trailmark.geometry import Trajectory
from trailmark.report.series import MAX_POINTS, error_series, lanes, thin_line, way


@given(st.integers(0, 5000), st.integers(10, 400))
def test_thinning_keeps_ends_and_peaks_within_its_limit(n: int, limit: int) -> None:
    values = np.random.default_rng(n).normal(size=n)

    kept = thin_line(values, limit)

    assert len(kept) <= limit
    assert (np.diff(kept) > 0).all()
    if n:
        assert values[kept].max() == values.max()
        assert values[kept].min() == values.min()
        assert (kept[0], kept[-1]) == (0, n - 1)


def test_a_way_has_few_points_and_ends_where_it_ends() -> None:
    n = 12_345
    long = Trajectory(np.arange(n) * 0.01, np.column_stack([np.arange(n), np.zeros(n), np.zeros(n)]))

    points = way(long)

    assert len(points) <= MAX_POINTS
    np.testing.assert_array_equal(points[[0, -1], 0], [0.0, n - 1.0])


def test_a_way_is_broken_at_a_gap() -> None:
    stamps = np.array([0.0, 0.1, 0.2, 5.0, 5.1])

    points = way(Trajectory(stamps, np.zeros((5, 3))))

    np.testing.assert_array_equal(np.isnan(points[:, 0]), [False, False, False, True, False, False])


def test_a_way_of_uneven_stamps_is_one_line() -> None:
    intervals = np.tile([0.02] * 9 + [0.12], 500)  # every tenth frame was dropped
    stamps = np.cumsum(intervals)

    points = way(Trajectory(stamps, np.zeros((len(stamps), 3))))

    assert not np.isnan(points).any()


@pytest.mark.parametrize("n", [0, 1, 2])
def test_short_ways_are_drawn_as_they_are(n: int) -> None:
    assert way(Trajectory(np.arange(n, dtype=float), np.zeros((n, 3)))).shape == (n, 2)


def test_errors_over_time_start_with_the_run_and_have_few_points(fake_run: Callable[..., Path]) -> None:
    evaluated = evaluate_run_folder(read_run(fake_run(seconds=150.0)))

    series = error_series(evaluated)

    assert list(series) == ["floor", "floor_map", "klt", "fused"]
    assert all(len(item.time_s) <= MAX_POINTS + 2 for item in series.values())
    assert series["fused"].time_s[0] == 0.0
    assert np.nanmax(series["klt"].position_m) == pytest.approx(evaluated.evaluations["klt"].absolute.position.max)
    assert np.isnan(series["floor"].position_m).sum() == 1  # lost once


def test_lanes_share_each_bin_among_the_outcomes(fake_run: Callable[..., Path]) -> None:
    estimates = read_run(fake_run(seconds=20.0)).estimates
    assert estimates is not None

    floor, floor_map = lanes(estimates, ["floor", "floor_map"])

    total = sum(floor.shares.values())
    assert set(np.round(total, 12)) <= {0.0, 1.0}
    assert floor.counts == {"accepted": 340, "lost": 59}
    assert np.diff(floor_map.edges_s).min() >= 0.9  # two estimates in each bin, one comes each 0.5 s
    assert floor.edges_s[0] == 0.0


def test_no_estimates_have_no_lanes(fake_run: Callable[..., Path]) -> None:
    folder = fake_run(seconds=5.0)
    header = (folder / "estimates.csv").read_text().splitlines()[0]
    (folder / "estimates.csv").write_text(header + "\n")
    estimates = read_run(folder).estimates
    assert estimates is not None

    assert lanes(estimates, ["floor"]) == []
