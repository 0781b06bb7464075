"""Absolute estimates that stand still, creep, or go along at a wrong speed while motions that agree say otherwise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Belief, Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.geometry import Pose2

from .conftest import kalman, pose_of

DT_S, SPEED_MPS, DRAWN_S = 0.05, 0.5, 5.0
MOTIONS = {"wheels": (2e-3, 1e-3, 4e-3), "camera": (6e-4, 6e-4, 6e-4)}
FIX = (0.01, 0.01, 0.01)


class DrawnDrive:
    """Straight on; from 5 s to an end the velocity of a laser's poses is another than that of base."""

    def __init__(
        self, *motions: str, velocity: tuple[float, float], end_s: float = math.inf, comes_back: bool = True
    ) -> None:
        self.estimator: Kalman = kalman()
        self.sigmas_off, self.named = 0.0, dict[str, float]()
        self._motions, self._velocity, self._end_s, self._comes_back = motions, velocity, end_s, comes_back
        self._rng = np.random.default_rng(11)
        self._i = 0

    def go(self, until_s: float) -> Belief:
        """Drive on; return the belief at the end."""
        while self._i < round(until_s / DT_S):
            self._i += 1
            stamp_s = DT_S * self._i
            for name in self._motions:
                dx, dy, turn = (self._rng.normal(size=3) * MOTIONS[name]).tolist()
                motion = Pose2(SPEED_MPS * DT_S + dx, dy, turn)
                self.estimator.apply(
                    name, Motion(stamp_s - DT_S, stamp_s, motion, information_from_sigmas(*MOTIONS[name]))
                )
            if self._i % 5 == 0:
                x, y = self._laser_at(stamp_s)
                dx, dy, turn = (self._rng.normal(size=3) * FIX).tolist()
                self.estimator.apply("laser", Fix(stamp_s, Pose2(x + dx, y + dy, turn), information_from_sigmas(*FIX)))
            self._look(stamp_s)
        return self.estimator.belief(DT_S * self._i)

    def _laser_at(self, stamp_s: float) -> tuple[float, float]:
        drawn_s = max(0.0, min(stamp_s, self._end_s) - DRAWN_S)
        if stamp_s > self._end_s and self._comes_back:
            drawn_s = 0.0
        x_mps, y_mps = self._velocity
        return SPEED_MPS * stamp_s + (x_mps - SPEED_MPS) * drawn_s, y_mps * drawn_s

    def _look(self, stamp_s: float) -> None:
        belief = self.estimator.belief(stamp_s)
        assert belief.covariance is not None
        away = pose_of(belief).array()[:2] - (SPEED_MPS * stamp_s, 0.0)
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
@pytest.mark.parametrize("motion", ["wheels", "camera"])
def test_beside_one_motion_that_poses_overrule_the_belief_covers_where_it_leads(motion: str, what: str) -> None:
    drive = DrawnDrive(motion, velocity=VELOCITIES[what])

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
