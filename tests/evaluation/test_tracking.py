from __future__ import annotations

import numpy as np
import pytest

from trailmark.errors import DataError
from trailmark.evaluation import tracked_fraction
from trailmark.geometry import Trajectory


def _at(stamps: object) -> Trajectory:
    times = np.asarray(stamps, dtype=float)
    return Trajectory(times, np.zeros((len(times), 3)))


def test_a_trajectory_without_gaps_is_tracked_all_the_time() -> None:
    assert tracked_fraction(_at(np.arange(0.0, 10.05, 0.1)), 0.0, 10.0).fraction == pytest.approx(1.0)


def test_the_time_in_a_gap_is_not_tracked() -> None:
    stamps = np.concatenate([np.arange(0.0, 4.05, 0.1), np.arange(6.0, 10.05, 0.1)])

    tracked = tracked_fraction(_at(stamps), 0.0, 10.0)

    assert tracked.fraction == pytest.approx(0.8)
    assert tracked.metrics() == {"tracked_fraction[gap<=0.3s]": pytest.approx(0.8)}


def test_a_late_start_and_an_early_end_count() -> None:
    assert tracked_fraction(_at(np.arange(2.0, 7.05, 0.1)), 0.0, 10.0).fraction == pytest.approx(0.5)


def test_time_counts_not_answers() -> None:
    stamps = np.concatenate([np.arange(0.0, 1.0, 0.001), np.arange(1.0, 10.05, 0.1)])

    assert tracked_fraction(_at(stamps), 0.0, 10.0, max_gap_s=0.01).fraction == pytest.approx(0.1, abs=1e-3)


def test_what_lies_outside_the_span_does_not_count() -> None:
    assert tracked_fraction(_at(np.arange(0.0, 10.05, 0.1)), 4.0, 6.0).fraction == pytest.approx(1.0)
    assert tracked_fraction(_at(np.arange(0.0, 2.05, 0.1)), 4.0, 6.0).fraction == 0.0


@pytest.mark.parametrize("n", [0, 1])
def test_one_pose_covers_no_time(n: int) -> None:
    assert tracked_fraction(_at(np.arange(n)), 0.0, 1.0).fraction == 0.0


def test_an_empty_span_is_refused() -> None:
    with pytest.raises(DataError, match="needs a span of time"):
        tracked_fraction(_at([0.0, 1.0]), 3.0, 3.0)
