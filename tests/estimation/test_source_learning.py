"""Delays of poses that show over a minute: who is told of them, whose are used, and how stamps are kept."""

from __future__ import annotations

import logging
from collections import Counter

import numpy as np
import pytest

from trailmark.estimates import Fix
from trailmark.estimation.kalman.clock_offsets import TimeOffset
from trailmark.estimation.kalman.source_learning import SourceLearning
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.geometry import Pose2

SURE, LIKELY, NOTHING = 0.03, 0.045, 0.2


def learning() -> SourceLearning:
    return SourceLearning(KalmanConfig(), Counter())


def late(late_s: float, sigma_s: float) -> dict[str, TimeOffset]:
    return {"gps": TimeOffset("wheels", late_s, sigma_s)}


@pytest.mark.parametrize("late_s", [0.2, -0.2])
def test_a_delay_that_is_likely_stays_and_is_told_once(late_s: float, caplog: pytest.LogCaptureFixture) -> None:
    learned = learning()

    with caplog.at_level(logging.WARNING):
        for sigma_s in (SURE, LIKELY, SURE, NOTHING, SURE):
            learned.follow_delays(late(late_s, sigma_s), liars=[])
            assert ("gps" in learned.clock_offsets()) == (sigma_s != NOTHING)

    assert len(caplog.records) == 1


def test_the_delay_of_a_liar_is_let_go() -> None:
    learned = learning()
    learned.follow_delays(late(0.2, SURE), liars=[])

    learned.follow_delays(late(0.2, SURE), liars=["gps"])

    assert "gps" not in learned.clock_offsets()


def test_a_pose_is_kept_with_the_stamp_that_it_was_told_with(monkeypatch: pytest.MonkeyPatch) -> None:
    learned, kept = learning(), []
    monkeypatch.setattr(learned._noise, "believed_of_fix", lambda source, fix, stated: kept.append(fix.stamp_s))
    fix, information = Fix(1.0, Pose2(), np.eye(3)), (1.0, 0.0, 0.0, 1.0, 0.0, 1.0)

    learned.believed_of_fix("gps", fix, information, moved_s=0.2)
    learned.believed_of_fix("gps", fix, information, moved_s=0.0)

    assert kept == [1.2, 1.0]
