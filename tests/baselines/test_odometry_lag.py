"""Readings of wheels that the body follows late, stamps of arrival, and turns about another place than base."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Motion
from trailmark.evaluation.chaining import chain_windows, covariances_of
from trailmark.evaluation.silent import FLOORS, are_silently_wrong
from trailmark.geometry import Pose2

from .test_odometry import at, localizer, observed, sigmas


def _as_one(motions: list[Motion]) -> tuple[np.ndarray, np.ndarray]:
    """Return motions that follow each other as one, (3,), and its covariance, (3, 3)."""
    steps = np.array([one.pose_since_now.array() for one in motions])
    own = covariances_of(np.array([one.information for one in motions]))
    chained, spreads, _, _ = chain_windows(steps, own, [(0, len(motions))])
    return chained[0], spreads[0]


def _commanded(lag_s: float, speed_mps: float = 0.5, yaw_radps: float = 1.5) -> tuple[list, np.ndarray]:
    """Return readings that are commands, and where a body is that follows them late, 0.3 s after its start."""
    told, body, speed = Pose2(), Pose2(), np.zeros(2)
    frames = [at(0.0, told)]
    for i in range(1, 66):
        wanted = np.array([speed_mps, yaw_radps]) if i > 50 else np.zeros(2)
        speed += (wanted - speed) * (1.0 - math.exp(-0.02 / lag_s))
        told = told @ Pose2.exp(wanted[0] * 0.02, 0.0, wanted[1] * 0.02)
        body = body @ Pose2.exp(speed[0] * 0.02, 0.0, speed[1] * 0.02)
        frames.append(at(0.02 * i, told))
    return frames, body.array()


@pytest.mark.parametrize("lag_s", [0.2, 0.3])
def test_a_body_that_follows_commands_late_is_no_silent_error(lag_s: float) -> None:
    frames, true = _commanded(lag_s)

    way, spread = _as_one(observed(localizer(), *frames)[50:])
    _, without = _as_one(observed(localizer(lag_s=0.0), *frames)[50:])

    error = (way - true)[None]
    assert not are_silently_wrong(error, spread[None], FLOORS["motion"]).any()
    assert (error**2 / np.diag(spread)).max() < 9.0
    assert are_silently_wrong(error, without[None], FLOORS["motion"]).any()


def test_a_steady_speed_is_as_certain_as_without_a_lag() -> None:
    frames = [at(0.1 * i, Pose2.exp(0.03 * i, 0.0, 0.02 * i)) for i in range(50)]

    lagging, plain = observed(localizer(), *frames), observed(localizer(lag_s=0.0), *frames)

    for one, other in zip(lagging, plain):
        np.testing.assert_allclose(sigmas(one), sigmas(other), rtol=1e-6)


def test_a_stop_is_uncertain_by_the_lag_however_it_is_cut() -> None:
    for dt_s in (0.01, 0.05, 0.2):
        moving = [at(dt_s * i, Pose2(0.5 * dt_s * i)) for i in range(math.ceil(1.0 / dt_s) + 1)]
        end_s, end = moving[-1].stamp_s, moving[-1].payload.pose_start_base
        standing = [at(end_s + dt_s * i, end) for i in range(1, math.ceil(2.0 / dt_s) + 1)]
        keys = {"distance_sigma": 1e-6, "rest_sigma": 1e-6, "lag_s": 0.2}

        motions = observed(localizer(**keys), *moving, *standing)

        _, spread = _as_one(motions)
        assert 0.7 < math.sqrt(spread[0, 0]) / (0.2 * 0.5) < 1.1


def test_stamps_of_arrival_are_no_silent_errors() -> None:
    """A reading is told up to 0.1 s late, now more and now less, as by a busy logger."""
    rng = np.random.default_rng(7)
    taken_s = 0.2 * np.arange(300)
    stamps_s = taken_s + rng.uniform(0.0, 0.1, 300)

    motions = observed(localizer(), *[at(float(s), Pose2(0.4 * float(t))) for s, t in zip(stamps_s, taken_s)])

    errors = np.array([one.pose_since_now.array() - [0.4 * (one.stamp_s - one.since_s), 0, 0] for one in motions])
    own = covariances_of(np.array([one.information for one in motions]))
    assert np.abs(errors[:, 0]).max() > 0.03
    assert are_silently_wrong(errors, own, FLOORS["motion"]).mean() <= 0.001
    assert 0.2 < 3.0 * np.mean(errors[:, 0] ** 2 / own[:, 0, 0]) < 15.0  # of three numbers one errs


def test_a_turn_about_a_place_beside_base_is_no_silent_error() -> None:
    """Skidding wheels turn about a point 4 cm in front of what is declared to be base."""
    frames = [at(0.1 * i, Pose2(0.0, 0.0, 0.05 * i)) for i in range(32)]
    true = Pose2(-0.04) @ Pose2(theta=1.55) @ Pose2(0.04)

    way, spread = _as_one(observed(localizer(), *frames))

    assert not are_silently_wrong((way - true.array())[None], spread[None], FLOORS["motion"]).any()


def test_behind_a_gap_or_a_restart_the_speed_before_is_forgotten() -> None:
    usual, _, after_gap = observed(
        localizer(), at(0.0, Pose2()), at(0.1, Pose2(0.05)), at(5.0, Pose2(0.1)), at(5.1, Pose2(0.2))
    )
    _, _, after_jump = observed(
        localizer(), at(0.0, Pose2()), at(0.1, Pose2(0.0)), at(0.2, Pose2(9.0)), at(0.3, Pose2(9.05))
    )

    np.testing.assert_allclose(sigmas(after_jump), sigmas(usual))
    assert sigmas(after_gap)[0] < 0.02
