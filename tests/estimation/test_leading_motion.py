"""The scale of the surest motion, as what is corrected over seconds tells it."""

from __future__ import annotations

import math

import numpy as np

from trailmark.estimates import Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman.leading_motion import LeadingMotion
from trailmark.estimation.kalman.variance_components import Key
from trailmark.geometry import Pose2

from .conftest import kalman

CAMERA: Key = ("camera", True)
WHEELS: Key = ("wheels", True)


def look(leading: LeadingMotion, key: Key, since_s: float, until_s: float, corrected_m: float) -> None:
    """Let a motion lead while every second so much is corrected, where 1 cm is expected."""
    for stamp_s in np.arange(since_s, until_s, 1.0).tolist():
        leading.observe(stamp_s, key, np.full(3, corrected_m * stamp_s), 1e-4 * stamp_s * np.eye(3))


def test_corrections_that_are_all_to_one_side_scale_who_leads() -> None:
    leading = LeadingMotion()
    look(leading, CAMERA, 0.0, 60.0, 0.02)

    assert leading.logs[CAMERA] > 0.5


def test_who_begins_to_lead_does_not_answer_for_what_was_corrected_before() -> None:
    leading = LeadingMotion()
    look(leading, CAMERA, 0.0, 48.0, 0.02)
    look(leading, WHEELS, 48.0, 72.0, 0.001)

    assert set(leading.logs) == {CAMERA}


def test_a_new_leader_is_scaled_by_what_is_corrected_from_then_on() -> None:
    leading = LeadingMotion()
    look(leading, CAMERA, 0.0, 48.0, 0.001)
    look(leading, WHEELS, 48.0, 108.0, 0.02)

    assert set(leading.logs) == {WHEELS}


def test_a_compass_that_is_off_all_day_says_nothing_of_the_wheels() -> None:
    rng, estimator, theta = np.random.default_rng(3), kalman(), 0.0
    wheels = information_from_sigmas(2e-3, 2e-3, 4e-3)
    gyro, compass = (np.diag([0.0, 0.0, 1.0 / sigma**2]) for sigma in (1e-3, math.radians(1.0)))
    for i in range(1, 901):
        t, turn = 0.1 * i, 0.03 * math.sin(i / 30.0)
        theta += turn
        error = rng.normal(size=5) * (2e-3, 2e-3, 4e-3, 1e-3, 2e-3)
        off = math.radians(3.0) * math.sin(theta)
        estimator.apply("wheels", Motion(t - 0.1, t, Pose2(0.05 + error[0], error[1], turn + error[2]), wheels))
        estimator.apply("gyro", Motion(t - 0.1, t, Pose2(0.0, 0.0, turn + error[3]), gyro))
        estimator.apply("compass", Fix(t, Pose2(0.0, 0.0, theta + off + error[4]), compass))

    assert "wheels" not in estimator.noise_scales()
