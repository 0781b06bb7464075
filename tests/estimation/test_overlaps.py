"""Motions of one localizer that cover the same time: it counts once, and that is said."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from trailmark.estimates import Motion, information_from_sigmas
from trailmark.estimation.dead_reckoning import DeadReckoning
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.smoother.estimator import Smoother
from trailmark.estimation.smoother_config import SmootherConfig
from trailmark.geometry import Pose2, wrap_angle
from trailmark.interfaces import Estimator, Session

_SIGMAS = (0.005, 0.003, 0.005)
_DT_S = 0.05
_ALL = pytest.mark.parametrize("name", ["kalman", "smoother", "dead_reckoning"])


def _estimator(name: str) -> Estimator:
    made: dict[str, Estimator] = {
        "kalman": Kalman(KalmanConfig()),
        "smoother": Smoother(SmootherConfig()),
        "dead_reckoning": DeadReckoning(DeadReckoningConfig()),
    }
    made[name].start(Session(start_pose=Pose2()))
    return made[name]


def _way(duration_s: float, seed: int = 0) -> list[Pose2]:
    """Return poses every 50 ms of a robot that drives, stands and turns by turns."""
    poses, speed_mps = [Pose2()], 0.5
    for index in range(round(duration_s / _DT_S)):
        at_s = index * _DT_S
        speed_mps += 0.2 * (0.5 + 0.5 * math.sin(0.7 * at_s + seed) - speed_mps)
        poses.append(poses[-1] @ Pose2(speed_mps * _DT_S, 0.0, 0.4 * math.sin(0.31 * at_s + seed) * _DT_S))
    return poses


def _key_frames(
    poses: Sequence[Pose2], length_s: float, hop_s: float, rng: np.random.Generator | None = None
) -> list[Motion]:
    length, hop = round(length_s / _DT_S), round(hop_s / _DT_S)
    motions = []
    for first in range(0, len(poses) - length, hop):
        step = poses[first].between(poses[first + length]).array()
        told = step if rng is None else step + rng.normal(0.0, _SIGMAS)
        since_s, stamp_s = round(first * _DT_S, 9), round((first + length) * _DT_S, 9)
        motions.append(Motion(since_s, stamp_s, Pose2.from_array(told), information_from_sigmas(*_SIGMAS)))
    return motions


def _squares(estimator: Estimator, truth: Pose2, stamp_s: float) -> np.ndarray:
    belief = estimator.belief(stamp_s)
    assert belief.pose_map_base is not None
    assert belief.covariance is not None
    errors = belief.pose_map_base.array() - truth.array()
    errors[2] = wrap_angle(float(errors[2]))
    return np.asarray(errors**2 / np.diag(belief.covariance))


@_ALL
def test_steps_of_key_frames_end_where_they_were_told_to_end(name: str) -> None:
    """0 to 2, 1 to 3, 2 to 4 s: without noise the robot is exactly where it is, at every other key frame."""
    poses, estimator = _way(12.1), _estimator(name)

    for motion in _key_frames(poses, 2.0, 1.0):
        assert estimator.apply("vo", motion).status == "accepted"
        truth = poses[round(motion.stamp_s / _DT_S)]
        assert (_squares(estimator, truth, motion.stamp_s) < 9.0).all()
        if motion.stamp_s % 2.0 == 0.0:
            believed = estimator.belief(motion.stamp_s).pose_map_base
            assert believed is not None
            np.testing.assert_allclose(believed.array(), truth.array(), atol=1e-9)


@_ALL
@pytest.mark.parametrize(("length_s", "hop_s"), [(2.0, 1.0), (3.0, 1.0), (1.0, 0.8), (1.0, 0.1)])
def test_time_that_was_told_twice_makes_nobody_too_certain(name: str, length_s: float, hop_s: float) -> None:
    squares = []
    for seed in range(4):
        poses, estimator = _way(20.1, seed), _estimator(name)
        for motion in _key_frames(poses, length_s, hop_s, np.random.default_rng(seed)):
            estimator.apply("vo", motion)
            squares.append(_squares(estimator, poses[round(motion.stamp_s / _DT_S)], motion.stamp_s))

    assert 0.05 < np.mean(squares) < 1.5
    assert np.max(squares) < 16.0


@_ALL
def test_it_is_said_in_the_health_and_counted(name: str) -> None:
    estimator = _estimator(name)
    motions = _key_frames(_way(6.1), 2.0, 1.0)
    for motion in motions:
        estimator.apply("vo", motion)

    assert "overlap" in estimator.belief().health["vo"]
    assert estimator.counters()["overlaps.vo"] == len(motions) - 1


@_ALL
def test_stamps_that_are_not_exact_are_no_overlap(name: str) -> None:
    estimator = _estimator(name)
    for index in range(40):
        begun_s = 0.05 * index - (5e-4 if index else 0.0)
        estimator.apply("wheels", Motion(begun_s, 0.05 * (index + 1), Pose2(0.01), information_from_sigmas(*_SIGMAS)))

    assert not estimator.belief().health
    assert "overlaps.wheels" not in estimator.counters()


@_ALL
def test_a_motion_within_another_adds_nothing(name: str) -> None:
    estimator = _estimator(name)
    information = information_from_sigmas(*_SIGMAS)
    estimator.apply("vo", Motion(0.0, 2.0, Pose2(1.0), information))

    applied = estimator.apply("vo", Motion(0.5, 1.5, Pose2(3.0), information))

    assert applied.status in ("unused", "refused")
    assert "already" in applied.reason
    believed = estimator.belief(2.0).pose_map_base
    assert believed is not None
    assert believed.x == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["kalman", "smoother"])
@pytest.mark.parametrize(("length_s", "hop_s"), [(2.0, 1.0), (1.0, 0.3), (0.7, 0.05)])
def test_the_order_of_arrival_changes_nothing(name: str, length_s: float, hop_s: float) -> None:
    motions = _key_frames(_way(4.1), length_s, hop_s, np.random.default_rng(3))
    beliefs = []
    for seed in (None, 1, 2, 3):
        estimator = _estimator(name)
        order = np.arange(len(motions)) if seed is None else np.random.default_rng(seed).permutation(len(motions))
        for index in order:
            estimator.apply("vo", motions[index])
        beliefs.append(estimator.belief(4.0))

    for belief in beliefs[1:]:
        assert belief.pose_map_base is not None
        assert beliefs[0].pose_map_base is not None
        np.testing.assert_allclose(belief.pose_map_base.array(), beliefs[0].pose_map_base.array(), atol=1e-9)
        np.testing.assert_allclose(belief.covariance, beliefs[0].covariance, atol=1e-9)
