"""Absolute poses that do not fit a belief that motion alone has led: while nothing decides, it covers both."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

from trailmark.estimates import Belief, Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman import moved_belief
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman.lasting_errors import NO_ERRORS, LastingVariances
from trailmark.estimation.kalman.way_errors import added_errors
from trailmark.geometry import Pose2

from .conftest import kalman, pose_of

DT_S, SPEED_MPS = 0.05, 0.5
SIGMAS = {"wheels": (4e-3, 2e-3, 5e-3), "camera": (1e-4, 1e-4, 1e-4)}
LASER_SIGMAS = (0.01, 0.01, 0.01)


class Drive:
    """A straight way at 0.5 m/s, which begins at rest, with motions and a laser that tells whole poses.

    Attributes
    ----------
    sigmas_off : list of float
        How far the position is off, in standard deviations, at each instant.
    told : list of mapping of str to str
        The health at each.
    """

    def __init__(self, *motions: str, scale: float = 1.0, seed: int = 3) -> None:
        self.estimator: Kalman = kalman()
        self.sigmas_off: list[float] = []
        self.told: list[Mapping[str, str]] = []
        self.stamp_s = self.x_m = 0.0
        self._motions, self._scale = motions, scale
        self._rng = np.random.default_rng(seed)

    def go(
        self,
        until_s: float,
        *,
        every_s: float = math.inf,
        off: tuple[float, float, float] = (0.0, 0.0, 0.0),
        laser: str = "laser",
    ) -> Belief:
        """Drive on, with poses that are off by so much; return the belief at the end."""
        next_s = self.stamp_s + every_s
        while self.stamp_s < until_s - 1e-6:
            since_s, self.stamp_s = self.stamp_s, round(self.stamp_s + DT_S, 6)
            way_m = min(SPEED_MPS, 1.5 * self.stamp_s) * DT_S
            self.x_m += way_m
            for name in self._motions:
                x, y, turn = (self._rng.normal(size=3) * SIGMAS[name]).tolist()
                step = Pose2(self._scale * way_m + x, y, turn)
                information = information_from_sigmas(*SIGMAS[name])
                self.estimator.apply(name, Motion(since_s, self.stamp_s, step, information))
            if self.stamp_s > next_s - 1e-6:
                next_s += every_s
                dx, dy, turn = (self._rng.normal(size=3) * LASER_SIGMAS).tolist()
                pose = Pose2(self.x_m + off[0] + dx, off[1] + dy, off[2] + turn)
                self.estimator.apply(laser, Fix(self.stamp_s, pose, information_from_sigmas(*LASER_SIGMAS)))
            belief = self.estimator.belief(self.stamp_s)
            assert belief.covariance is not None
            away = np.array([pose_of(belief).x - self.x_m, pose_of(belief).y])
            self.sigmas_off.append(math.sqrt(float(away @ np.linalg.solve(belief.covariance[:2, :2], away))))
            self.told.append(belief.health)
        return belief


@pytest.mark.parametrize("off", [(0.3, 0.0, 0.0), (0.0, -0.5, 0.0), (0.2, 0.2, 0.1)])
@pytest.mark.parametrize("begin_s", [10.0, 15.0])
def test_poses_that_begin_late_beside_motion_leave_a_belief_that_covers_both(
    begin_s: float, off: tuple[float, float, float]
) -> None:
    drive = Drive("wheels", "camera")
    drive.go(begin_s)

    belief = drive.go(begin_s + 15.0, every_s=0.5, off=off)

    assert max(drive.sigmas_off) < 5.0
    assert belief.health["laser"]


def test_a_move_that_another_laser_confirms_is_no_question() -> None:
    drive = Drive("camera")
    drive.go(10.0)
    drive.go(15.0, every_s=0.5, off=(0.3, 0.0, 0.0))

    belief = drive.go(17.0, every_s=0.5, off=(0.3, 0.0, 0.0), laser="beacons")

    assert not belief.health
    assert belief.covariance is not None
    assert belief.covariance[0, 0] ** 0.5 < 0.03


def test_poses_that_go_on_to_agree_win_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(moved_belief, "LASTS_S", 2.0)  # in place of half a minute
    drive = Drive("camera")
    drive.go(10.0)

    early, late = (drive.go(until_s, every_s=0.5, off=(0.3, 0.0, 0.0)) for until_s in (13.0, 25.0))

    assert early.covariance is not None
    assert late.covariance is not None
    assert early.covariance[0, 0] ** 0.5 > 0.1
    assert late.covariance[0, 0] ** 0.5 < 0.06
    assert not late.health


def test_a_start_that_nothing_ever_confirmed_is_given_up_within_a_minute() -> None:
    """Nearly always it was wrong: nobody had said that the robot begins elsewhere."""
    drive = Drive("camera")

    early, late = (drive.go(until_s, every_s=0.5, off=(3.0, 1.0, 0.0)) for until_s in (20.0, 60.0))

    assert early.covariance is not None
    assert late.covariance is not None
    assert early.covariance[0, 0] ** 0.5 > 0.6
    assert late.covariance[0, 0] ** 0.5 < 0.06
    assert not late.health


@pytest.mark.parametrize(("until_s", "later"), [(25.0, "laser"), (25.0, "beacons"), (15.0, "beacons")])
def test_a_second_move_begins_anew(monkeypatch: pytest.MonkeyPatch, until_s: float, later: str) -> None:
    monkeypatch.setattr(moved_belief, "LASTS_S", 2.0)  # in place of half a minute: after 10 s the first has won
    drive = Drive("camera")
    drive.go(10.0)
    drive.go(until_s, every_s=0.5, off=(0.3, 0.0, 0.0))
    drive.go(until_s + 9.0)

    belief = drive.go(until_s + 13.0, every_s=0.5, off=(0.3, 1.0, 0.0), laser=later)

    assert belief.covariance is not None
    assert abs(pose_of(belief).y - 1.0) < 0.1
    assert belief.covariance[1, 1] ** 0.5 > 0.25  # the first may be right, 1 m aside
    assert "covers both" in belief.health[later]


@pytest.mark.parametrize("to_s", [100.0, 9e4])
def test_a_clock_that_is_set_decides_for_no_move(to_s: float) -> None:
    drive = Drive("camera")
    drive.stamp_s = 1e4
    drive.go(1e4 + 10.0)
    drive.go(1e4 + 15.0, every_s=0.5, off=(0.3, 0.0, 0.0))
    drive.stamp_s = to_s

    belief = drive.go(to_s + 3.0, every_s=0.5, off=(0.3, 0.0, 0.0))

    moved = drive.estimator._timeline.state_at(math.inf).rejections.moved
    assert moved is not None
    assert moved.since_s == pytest.approx(to_s - 4.5, abs=1.0)
    assert belief.covariance is not None
    assert belief.covariance[0, 0] ** 0.5 > 0.1
    assert "covers both" in belief.health["laser"]


def test_a_belief_that_was_confirmed_stays_so_by_another_clock() -> None:
    drive = Drive("camera")
    drive.stamp_s = 1e4
    drive.go(1e4 + 5.0, every_s=0.5)
    drive.stamp_s = 100.0

    drive.go(110.0, every_s=0.5, off=(300.0, 100.0, 0.0))

    moved = drive.estimator._timeline.state_at(math.inf).rejections.moved
    assert moved is not None
    assert moved.lasts_s == 30.0


def test_errors_that_refused_poses_say_stay_plausible_however_often_they_say_so() -> None:
    once = LastingVariances(0.12**2, 0.05**2, 0.12**2, math.radians(1.2) ** 2)
    said = NO_ERRORS
    for _ in range(5):
        said = added_errors(said, once)

    np.testing.assert_allclose(np.sqrt(said[:4]), [0.15, 0.06, 0.15, math.radians(1.5)])


@pytest.mark.parametrize("every_s", [6.0, 9.0])
def test_poses_that_are_refused_again_and_again_say_that_motion_is_off(every_s: float) -> None:
    drive = Drive("camera", scale=1.05)

    belief = drive.go(5.0 * every_s, every_s=every_s)

    assert abs(pose_of(belief).x - drive.x_m) < 0.05
    assert max(drive.sigmas_off[round(every_s / DT_S) :]) < 5.0  # before the first nobody contradicts
    assert any("contradicts the belief" in one.get("laser", "") for one in drive.told)
    assert "of the way" in belief.health["camera"]
    assert "laser" not in drive.estimator.clock_offsets()  # nor is a scale told as a delay


def test_one_pose_that_is_far_off_moves_nothing() -> None:
    drive = Drive("camera")
    drive.go(9.0)
    drive.go(10.0, every_s=1.0, off=(0.5, 0.0, 0.0))

    drive.go(19.0)
    belief = drive.go(20.0, every_s=1.0)

    assert abs(pose_of(belief).x - drive.x_m) < 0.05
    assert not belief.health
    assert max(drive.sigmas_off) < 4.0
