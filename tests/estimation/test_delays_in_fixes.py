"""What is not the fault of honest wheels: poses that are late, poses with a coarse heading, and chance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from trailmark.estimates import Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman.clock_offsets import TimeOffset
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.geometry import Pose2, wrap_angle

from .conftest import kalman

WHEELS = np.array([0.016, 0.0063, 0.0063])
GOOD_WHEELS = np.array([0.0032, 0.0016, 0.0016])
POSES = (0.05, 0.05, 0.03)


@dataclass
class Drive:
    """What became of a drive.

    That is NEES per degree of freedom in its last quarter, the largest scale of the wheels, and whether poses were ever
    held to be late.
    """

    nees: float
    largest_scale: float
    was_late: bool
    estimator: Kalman

    @property
    def late(self) -> TimeOffset | None:
        """By how much the poses are found to be late at the end."""
        return self.estimator.clock_offsets().get("poses")


@cache
def drive(
    seed: int,
    *,
    delay_s: float = 0.0,
    heading: float = POSES[2],
    stops: bool = False,
    good: bool = False,
    lasting_s: float = 0.0,
    clock_offsets: str = "use",
) -> Drive:
    """Drive for 120 s with honest wheels, and poses twice a second that tell where base was `delay_s` ago.

    The errors of the poses are an AR(1) process that lasts for `lasting_s`.
    """
    rng, estimator = np.random.default_rng(seed), kalman(clock_offsets=clock_offsets)
    wheels, sigmas = GOOD_WHEELS if good else WHEELS, np.array([*POSES[:2], heading])
    poses, squares, largest, was_late = [Pose2()], [], 1.0, False
    r = math.exp(-0.5 / lasting_s) if lasting_s else 0.0
    error = rng.normal(size=3) * sigmas if lasting_s else np.zeros(3)
    for i in range(1, 1201):
        t = 0.1 * i
        speed_mps, turn_radps = 0.6 + 0.3 * math.sin(t / 7.0), 0.5 * math.sin(t / 5.0) + 0.2 * math.sin(t / 1.7)
        if stops:
            speed_mps, turn_radps = (0.5, 0.3 * math.sin(t / 3.0)) if t % 20.0 < 10.0 else (0.0, 0.0)
        step = Pose2.exp(speed_mps * 0.1, 0.0, turn_radps * 0.1)
        poses.append(poses[-1] @ step)
        dx, dy, turn = rng.normal(size=3) * wheels
        told = Pose2(step.x + dx, step.y + dy, step.theta + turn)
        estimator.apply("wheels", Motion(t - 0.1, t, told, information_from_sigmas(*wheels.tolist())))
        if i % 5 == 0:
            seen = poses[max(i - round(10.0 * delay_s), 0)]
            error = r * error + math.sqrt(1.0 - r * r) * rng.normal(size=3) * sigmas
            pose = Pose2(seen.x + error[0], seen.y + error[1], seen.theta + error[2])
            estimator.apply("poses", Fix(t, pose, information_from_sigmas(*sigmas.tolist())))
            largest = max(largest, estimator.noise_scales().get("wheels", 1.0))
            was_late = was_late or "poses" in estimator.clock_offsets()
            belief = estimator.belief(t)
            assert belief.pose_map_base is not None
            away = belief.pose_map_base.array() - poses[-1].array()
            away[2] = wrap_angle(float(away[2]))
            squares.append(float(away @ np.linalg.solve(belief.covariance, away)) / 3.0)
    return Drive(float(np.mean(squares[-len(squares) // 4 :])), largest, was_late, estimator)


@pytest.mark.parametrize(("delay_s", "stops"), [(0.2, False), (0.3, True)])
def test_poses_that_are_late_are_found_out_and_no_fault_of_the_wheels(delay_s: float, stops: bool) -> None:
    done = drive(1, delay_s=delay_s, stops=stops)

    assert done.late is not None
    assert abs(done.late.late_s - delay_s) < 4.0 * done.late.sigma_s
    assert done.largest_scale == 1.0
    assert done.nees < 2.0


def test_of_late_poses_that_are_taken_at_their_stamps_the_wheels_learn_nothing() -> None:
    done = drive(1, delay_s=0.2, clock_offsets="tell")

    assert done.late is not None
    assert "poses" in done.estimator.belief().health
    assert done.largest_scale == 1.0


@pytest.mark.parametrize(("seed", "lasting_s"), [(6, 0.0), (0, 3.0), (2, 1.0)])
def test_poses_in_time_are_never_held_to_be_late(seed: int, lasting_s: float) -> None:
    assert not drive(seed, lasting_s=lasting_s).was_late


def test_a_coarse_heading_is_no_fault_of_the_wheels() -> None:
    done = drive(1, heading=0.6)

    assert done.largest_scale == 1.0
    assert 0.5 < done.nees < 1.5


def test_the_chance_of_a_few_long_ways_is_no_fault_of_good_wheels() -> None:
    assert drive(0, stops=True, good=True).largest_scale == 1.0
