"""A late fix moves base in the map, not its way: what motion said is not worked out again."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from trailmark.estimates import Belief, Fix
from trailmark.estimation.kalman.prediction import Prediction
from trailmark.geometry import Pose2

from .conftest import GOOD, ONE_FRAME, kalman, motion, pose_of

N, LATE, RATE_HZ = 40, 20, 50.0


def belief_after_a_late_fix() -> Belief:
    """Return the belief at the end of a drive, after a fix that is about the end of an earlier motion."""
    estimator = kalman()
    for i in range(N):
        estimator.apply("vo", motion(i / RATE_HZ, (i + 1) / RATE_HZ, ONE_FRAME.x, theta=ONE_FRAME.theta))
        estimator.belief((i + 1) / RATE_HZ)
    counted = estimator.counters().get("replayed", 0)
    estimator.apply("map", Fix((N - LATE) / RATE_HZ, Pose2(0.0741, 1e-3, 0.2), GOOD))
    assert estimator.counters()["replayed"] == counted + 1
    return estimator.belief(N / RATE_HZ)


def test_a_late_fix_does_not_weigh_the_motions_after_it_again(monkeypatch: pytest.MonkeyPatch) -> None:
    n, new_way = 0, Prediction._new_way

    def counting(*arguments: Any) -> Any:
        nonlocal n
        n += 1
        return new_way(*arguments)

    monkeypatch.setattr(Prediction, "_new_way", counting)
    kept = belief_after_a_late_fix()
    assert n == N

    monkeypatch.setattr("trailmark.estimation.kalman.prediction._N_WAYS", 0)
    anew = belief_after_a_late_fix()
    assert n == 2 * N + LATE + 1  # and that of the instant itself
    assert pose_of(kept) == pose_of(anew)
    assert np.array_equal(kept.covariance, anew.covariance)
    assert (kept.twist, kept.travelled_m, kept.pose_odom_base) == (anew.twist, anew.travelled_m, anew.pose_odom_base)
