"""A question that is asked again goes on where motion has changed, with the same answer to the last bit."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from trailmark.estimates import Belief, Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman import rival_filters
from trailmark.estimation.kalman.prediction import Prediction
from trailmark.geometry import Pose2

from .conftest import kalman

STEP_S, LATE = 0.02, 5  # of the gyro; wheels tell of as many of its steps, when they are over


def beliefs_of() -> list[Belief]:
    """Return the beliefs of a drive with a gyro and slower wheels beside a compass, which turns away from both."""
    rng, estimator, found = np.random.default_rng(3), kalman(), []
    turn_only = information_from_sigmas(math.inf, math.inf, 1e-3)
    way, heading = information_from_sigmas(2e-3, 1e-3, 3e-3), information_from_sigmas(math.inf, math.inf, 0.02)
    pose = begun = Pose2()
    for i in range(1, 300):
        t = STEP_S * i
        turn = 0.3 * math.sin(0.9 * t) * STEP_S
        pose = pose @ Pose2.exp(0.8 * STEP_S, 0.0, turn)
        estimator.apply("gyro", Motion(t - STEP_S, t, Pose2(0.0, 0.0, turn + 1e-3 * rng.normal()), turn_only))
        off = 0.05 * max(t - 2.0, 0.0) + 0.01 * rng.normal()
        estimator.apply("compass", Fix(t, Pose2(0.0, 0.0, pose.theta + off), heading))
        if i % LATE == 0:
            step = begun.between(pose)
            estimator.apply("wheels", Motion(STEP_S * (i - LATE), t, step, way))
            begun = pose
        found.append(estimator.belief(t))
    return found


def predictions(monkeypatch: pytest.MonkeyPatch, drive: Callable[[], list[Belief]]) -> tuple[list[Belief], int]:
    """Return the beliefs of a drive, and how many pieces of time were predicted for them."""
    n, predict_piece = 0, Prediction.predict_piece

    def counting(*arguments: Any) -> Any:
        nonlocal n
        n += 1
        return predict_piece(*arguments)

    with monkeypatch.context() as patched:
        patched.setattr(Prediction, "predict_piece", counting)
        return drive(), n


def test_a_question_that_is_asked_again_is_not_replayed_from_its_beginning(monkeypatch: pytest.MonkeyPatch) -> None:
    again, n_again = predictions(monkeypatch, beliefs_of)
    monkeypatch.setattr(rival_filters._Question, "is_same", lambda *_: False)
    anew, n_anew = predictions(monkeypatch, beliefs_of)
    assert n_again < 0.9 * n_anew
    for one, other in zip(again, anew, strict=True):
        assert one.covariance is not None
        assert other.covariance is not None
        assert one.pose_map_base == other.pose_map_base
        assert one.covariance.tobytes() == other.covariance.tobytes()
        assert one.health == other.health
