from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.errors import DataError
from trailmark.evaluation import absolute_error, align, associate, end_error, summarize
from trailmark.geometry import Pose2, Trajectory


def test_a_summary_by_hand() -> None:
    summary = summarize(np.array([3.0, -4.0, 0.0, 0.0]))

    assert (summary.rmse, summary.mean, summary.median, summary.max) == (2.5, 1.75, 1.5, 4.0)


def test_nothing_cannot_be_summarized() -> None:
    with pytest.raises(DataError, match="0 values"):
        summarize(np.array([]))


def test_offsets_of_3_cm_and_4_cm_are_5_cm_of_error_without_alignment(straight: Trajectory) -> None:
    pairs = associate(Trajectory(straight.stamps_s, straight.poses + np.array([0.03, 0.04, 0.1])), straight)

    metrics = absolute_error(pairs, align(pairs, "none")).metrics()

    assert metrics["ate_rmse_m[none,n=101]"] == pytest.approx(0.05)
    assert metrics["ate_heading_max_deg[none,n=101]"] == pytest.approx(math.degrees(0.1))


def test_heading_errors_are_wrapped() -> None:
    truth = Trajectory([0.0, 1.0], [[0.0, 0.0, 3.1], [1.0, 0.0, 3.1]])
    estimate = Trajectory([0.0, 1.0], [[0.0, 0.0, -3.1], [1.0, 0.0, -3.1]])
    pairs = associate(estimate, truth)

    assert absolute_error(pairs, align(pairs, "none")).heading.max == pytest.approx(2.0 * math.pi - 6.2)


def test_the_end_error_is_that_of_the_last_pose_after_the_start_is_laid_on_the_truth(straight: Trajectory) -> None:
    stretched = Trajectory(straight.stamps_s, straight.poses * [1.02, 1.0, 1.0]).transformed(Pose2(5.0, 5.0, 1.0))
    pairs = associate(stretched, straight)

    metrics = end_error(pairs, align(pairs, "origin")).metrics()

    assert metrics["end_error_m[origin]"] == pytest.approx(0.2)
    assert metrics["end_error_percent[origin]"] == pytest.approx(2.0)
    assert metrics["end_heading_error_deg[origin]"] == pytest.approx(0.0, abs=1e-9)


def test_a_way_of_no_length_has_no_share_of_it(static: Trajectory) -> None:
    pairs = associate(static, static)

    assert set(end_error(pairs, align(pairs, "origin")).metrics()) == {
        "end_error_m[origin]",
        "end_heading_error_deg[origin]",
    }
