"""Which estimates can be judged, by what is known of the truth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.evaluation.estimates_table import EstimateTable
from trailmark.evaluation.known_truth import where_truth_is_known
from trailmark.evaluation.measured_noise import measured_noise
from trailmark.geometry import Pose2, Trajectory


def way(stamps_s: np.ndarray) -> Trajectory:
    """Return a circle of 5 m at 1 m/s."""
    return Trajectory.from_poses(
        (t, Pose2(5.0 * math.sin(t / 5), 5.0 - 5.0 * math.cos(t / 5), t / 5)) for t in stamps_s.tolist()
    )


def said(kind: str, stamps_s: np.ndarray, sigma: float = 0.01, dt_s: float = 0.1) -> EstimateTable:
    """Return what a localizer says at stamps, with the standard deviation that it states."""
    rng, n = np.random.default_rng(7), len(stamps_s)
    truth = way(np.unique(np.round(np.concatenate([stamps_s - dt_s, stamps_s]), 6)))
    since, now = truth.at(np.round(stamps_s - dt_s, 6)), truth.at(np.round(stamps_s, 6))
    if kind == "motion":
        exact = [since[i][1].between(now[i][1]).array() for i in range(n)]
    else:
        exact = [now[i][1].array() for i in range(n)]
    return EstimateTable(
        arrived_s=stamps_s,
        since_s=stamps_s - dt_s if kind == "motion" else np.full(n, np.nan),
        stamp_s=stamps_s,
        source=np.full(n, "one"),
        kind=np.full(n, kind),
        outcome=np.full(n, "accepted"),
        reason=np.full(n, ""),
        numbers=np.array(exact) + rng.normal(scale=sigma, size=(n, 3)),
        information=np.repeat(np.eye(3)[None] / sigma**2, n, axis=0),
        nis=np.full(n, np.nan),
        dof=np.full(n, np.nan),
    )


STAMPS = np.round(np.arange(1, 600) * 0.1, 6)
WITH_GAP = STAMPS[(STAMPS <= 20.0) | (STAMPS >= 35.0)]


@pytest.mark.parametrize("kind", ["fix", "motion"])
def test_noise_is_not_measured_in_a_gap_of_the_truth(kind: str) -> None:
    estimates = said(kind, STAMPS[1:])

    with_gap = measured_noise(where_truth_is_known(estimates, way(WITH_GAP)), way(WITH_GAP))["one"]
    whole = measured_noise(where_truth_is_known(estimates, way(STAMPS)), way(STAMPS))["one"]

    np.testing.assert_allclose(with_gap.rms, whole.rms, rtol=0.2)
    assert with_gap.n < 0.8 * whole.n


def test_the_first_step_into_a_long_gap_is_not_judged_either() -> None:
    found = where_truth_is_known(said("fix", STAMPS[1:]), way(WITH_GAP))

    assert set(found.stamp_s) == set(WITH_GAP[1:])


def test_a_motion_that_ends_or_begins_in_a_gap_is_left_out_and_one_over_a_short_gap_is_not() -> None:
    stamps = np.round(np.arange(1, 60) * 1.0, 6)
    truth = way(STAMPS[(STAMPS <= 20.2) | (STAMPS >= 20.8)])
    gap = way(STAMPS[(STAMPS <= 19.5) | (STAMPS >= 20.5)])

    over_it = where_truth_is_known(said("motion", stamps[1:], dt_s=1.0), truth)
    into_it = where_truth_is_known(said("motion", stamps[1:], dt_s=1.0), gap)

    assert {21.0} <= set(over_it.stamp_s)
    assert {20.0, 21.0}.isdisjoint(into_it.stamp_s)
    assert {19.0, 22.0} <= set(into_it.stamp_s)


def test_truth_of_one_pose_a_second_is_interpolated() -> None:
    sparse = way(np.arange(0.0, 60.0))

    assert len(where_truth_is_known(said("fix", STAMPS[1:580]), sparse)) == 579


def test_the_largest_difference_is_heeded() -> None:
    sparse = way(np.arange(0.0, 60.0))

    found = where_truth_is_known(said("fix", STAMPS[1:580]), sparse, max_difference_s=0.15)

    apart_s = np.abs(found.stamp_s - np.round(found.stamp_s))
    assert apart_s.max() < 0.15
    assert len(found) == 173


def test_a_truth_of_one_pose_judges_nothing() -> None:
    assert len(where_truth_is_known(said("fix", STAMPS[1:]), way(STAMPS[:1]))) == 0
