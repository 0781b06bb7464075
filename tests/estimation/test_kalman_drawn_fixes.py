"""Absolute estimates that stand still, creep, or go along at a wrong speed while motions that agree say otherwise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Belief, Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman.state import FilterState
from trailmark.geometry import Pose2

from .conftest import kalman, pose_of

DT_S, SPEED_MPS, DRAWN_S = 0.05, 0.5, 5.0
MOTIONS = {"wheels": (2e-3, 1e-3, 4e-3), "camera": (6e-4, 6e-4, 6e-4)}
FIX = (0.01, 0.01, 0.01)


class DrawnDrive:
    """Straight on, or winding; from 5 s to an end the velocity of a laser's poses is another than that of base.

    Attributes
    ----------
    every : int
        A pose of the laser comes with every so many steps of motion.
    sigmas : tuple of float
        Of its poses; ``inf`` for what they do not tell.
    later_s : float
        By how much the clock is late [s].
    open_at_s : float
        The step of the motions that ends then tells no way [s].
    """

    def __init__(
        self,
        *motions: str,
        velocity: tuple[float, float],
        end_s: float = math.inf,
        comes_back: bool = True,
        yaw_radps: float = 0.0,
    ) -> None:
        self.estimator: Kalman = kalman()
        self.sigmas_off, self.named = 0.0, dict[str, float]()
        self.every, self.sigmas = 5, FIX
        self.later_s, self.open_at_s = 0.0, math.inf
        self._motions, self._velocity, self._end_s, self._comes_back = motions, velocity, end_s, comes_back
        self._yaw_radps, self._base = yaw_radps, Pose2()
        self._rng = np.random.default_rng(11)
        self._i = 0

    def go(self, until_s: float) -> Belief:
        """Drive on; return the belief at the end."""
        while self._i < round(until_s / DT_S):
            self._i += 1
            stamp_s = DT_S * self._i
            turn_rad = DT_S * self._yaw_radps * math.cos(stamp_s)
            self._base = self._base @ Pose2(SPEED_MPS * DT_S, 0.0, turn_rad)
            for name in self._motions:
                dx, dy, turn = (self._rng.normal(size=3) * MOTIONS[name]).tolist()
                motion = Pose2(SPEED_MPS * DT_S + dx, dy, turn_rad + turn)
                sigmas = MOTIONS[name]
                if abs(stamp_s - self.open_at_s) < 0.5 * DT_S:
                    sigmas = (math.inf, math.inf, sigmas[2])
                said_s = stamp_s + self.later_s
                self.estimator.apply(name, Motion(said_s - DT_S, said_s, motion, information_from_sigmas(*sigmas)))
            if self._i % self.every == 0:
                x, y = self._laser_at(stamp_s)
                dx, dy, turn = (
                    self._rng.normal(size=3) * np.where(np.isfinite(self.sigmas), self.sigmas, 1.0)
                ).tolist()
                pose = Pose2(x + dx, y + dy, self._base.theta + turn)
                self.estimator.apply("laser", Fix(stamp_s + self.later_s, pose, information_from_sigmas(*self.sigmas)))
            self._look(stamp_s)
        return self.estimator.belief(DT_S * self._i + self.later_s)

    def _laser_at(self, stamp_s: float) -> tuple[float, float]:
        drawn_s = max(0.0, min(stamp_s, self._end_s) - DRAWN_S)
        if stamp_s > self._end_s and self._comes_back:
            drawn_s = 0.0
        x_mps, y_mps = self._velocity
        return self._base.x + (x_mps - SPEED_MPS) * drawn_s, self._base.y + y_mps * drawn_s

    def _look(self, stamp_s: float) -> None:
        belief = self.estimator.belief(stamp_s + self.later_s)
        assert belief.covariance is not None
        away = pose_of(belief).array()[:2] - (self._base.x, self._base.y)
        sigmas = math.sqrt(float(away @ np.linalg.solve(belief.covariance[:2, :2], away)))
        if math.hypot(*away) > 0.02:
            self.sigmas_off = max(self.sigmas_off, sigmas)
        for source in belief.health:
            self.named.setdefault(source, stamp_s)


VELOCITIES = {"stand": (0.0, 0.0), "creep aside": (0.5, 0.2), "are too slow": (0.3, 0.0), "turn back": (-0.5, 0.0)}


@pytest.mark.parametrize("what", VELOCITIES)
def test_poses_that_are_drawn_away_lose_against_two_motions_that_agree(what: str) -> None:
    drive = DrawnDrive("wheels", "camera", velocity=VELOCITIES[what])

    belief = drive.go(15.0)

    assert set(drive.named) == {"laser"}
    assert drive.named["laser"] < DRAWN_S + 3.0
    assert "against the motion of camera and wheels" in belief.health["laser"]
    assert abs(pose_of(belief).x - SPEED_MPS * 15.0) < 0.05
    assert drive.sigmas_off < 4.0


@pytest.mark.parametrize("what", VELOCITIES)
@pytest.mark.parametrize(("motion", "yaw_radps"), [("wheels", 0.0), ("camera", 0.0), ("wheels", 1.0)])
def test_beside_one_motion_that_poses_overrule_the_belief_covers_where_it_leads(
    motion: str, yaw_radps: float, what: str
) -> None:
    drive = DrawnDrive(motion, velocity=VELOCITIES[what], yaw_radps=yaw_radps)

    belief = drive.go(20.0)

    assert motion in belief.health
    assert drive.sigmas_off < 5.0


def test_where_an_overruled_motion_has_led_is_covered_after_it_agrees_again_until_another_laser_decides() -> None:
    drive = DrawnDrive("wheels", velocity=(0.3, 0.0), end_s=10.0, comes_back=False)

    belief = drive.go(25.0)
    assert belief.covariance is not None
    x_m = pose_of(belief).x
    for k in range(3):
        drive.estimator.apply("other", Fix(25.0 + 0.05 * k, Pose2(x_m + 0.025 * k), information_from_sigmas(*FIX)))
    decided = drive.estimator.belief()

    assert math.sqrt(belief.covariance[0, 0]) > 0.1
    assert decided.covariance is not None
    assert math.sqrt(decided.covariance[0, 0]) < 0.1


def test_poses_that_stand_are_not_believed_again_until_the_ways_between_them_are_those_of_motion() -> None:
    drive = DrawnDrive("wheels", "camera", velocity=(0.0, 0.0), end_s=45.0)

    belief = drive.go(45.0)
    again = drive.go(48.0)

    assert abs(pose_of(belief).x - SPEED_MPS * 45.0) < 0.5
    assert "laser" in belief.health
    assert "laser" not in again.health
    assert abs(pose_of(again).x - SPEED_MPS * 48.0) < 0.05
    assert set(drive.named) == {"laser"}


def _go_until_named(drive: DrawnDrive) -> None:
    drive.go(12.0)
    fault = _last(drive).diagnosis.absolute_faults["laser"]
    assert fault.is_drawn


def _last(drive: DrawnDrive) -> FilterState:
    return drive.estimator._timeline.state_at(math.inf)


def test_positions_that_were_drawn_away_are_heard_again() -> None:
    drive = DrawnDrive("wheels", "camera", velocity=(0.0, 0.0), end_s=14.0)
    drive.sigmas = (0.01, 0.01, math.inf)
    _go_until_named(drive)

    belief = drive.go(20.0)

    assert "laser" not in belief.health
    assert drive.sigmas_off < 4.0


def test_poses_that_were_drawn_away_and_then_come_every_9_s_are_heard_again() -> None:
    drive = DrawnDrive("wheels", "camera", velocity=(0.0, 0.0), end_s=14.0)
    _go_until_named(drive)

    drive.every = round(9.0 / DT_S)
    belief = drive.go(54.0)

    assert "laser" not in belief.health
    assert drive.sigmas_off < 4.0


def test_noisy_poses_that_were_drawn_away_and_come_fast_are_heard_again() -> None:
    """The last thirty of them cover a way of 0.75 m only: less than 5 of their sigmas."""
    drive = DrawnDrive("wheels", "camera", velocity=(-0.5, 0.0), end_s=14.0)
    drive.every, drive.sigmas = 1, (0.2, 0.2, 0.05)
    _go_until_named(drive)

    belief = drive.go(30.0)

    assert "laser" not in belief.health
    assert drive.sigmas_off < 4.0


def test_an_overruled_motion_stays_so_by_another_clock() -> None:
    drive = DrawnDrive("wheels", velocity=(0.0, 0.0))
    drive.go(12.0)
    before = _last(drive).diagnosis.overruled

    drive.later_s = -1e4
    drive.go(13.0)

    after = _last(drive).diagnosis.overruled
    assert before is not None
    assert after is not None
    assert after.since_s == pytest.approx(before.since_s - 1e4, abs=0.5)


@pytest.mark.parametrize("open_at_s", [2.0, 10.0])
def test_one_step_that_tells_no_way_uncovers_no_place(open_at_s: float) -> None:
    """Long before the question it has no part in it; after it the place where motion had led until then is covered."""
    drive = DrawnDrive("wheels", velocity=(0.3, 0.0), end_s=12.0)
    drive.open_at_s = open_at_s

    belief = drive.go(11.0)

    state = _last(drive)
    assert belief.covariance is not None
    assert math.sqrt(belief.covariance[0, 0]) > 0.3
    assert (state.diagnosis.overruled is None, state.rejections.moved is None) == (open_at_s > 5.0, open_at_s < 5.0)
    assert drive.sigmas_off < 5.0


def test_where_an_overruled_motion_has_led_counts_less_from_when_it_agrees_again() -> None:
    drive = DrawnDrive("wheels", velocity=(0.3, 0.0), end_s=80.0, comes_back=False)
    drive.go(80.0)

    belief = drive.go(84.0)

    moved = _last(drive).rejections.moved
    assert moved is not None
    assert belief.covariance is not None
    apart_m = math.hypot(moved.shift.x, moved.shift.y)
    assert math.sqrt(0.2 * 30.0 / 34.0) * apart_m <= math.sqrt(belief.covariance[0, 0]) < math.sqrt(0.21) * apart_m
