"""A localizer that repeats one pose to the last bit, with fresh stamps, while base moves or rests."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

from trailmark.estimates import Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman.repeated_fixes import FROZEN, MOVES_ALONE
from trailmark.geometry import Pose2

from .conftest import kalman, pose_of

DT_S, FIX_EVERY = 0.05, 4  # fixes at 5 Hz
MOTION_SIGMAS = (2e-3, 2e-3, 2e-3)


class Drive:
    """A straight way of motions and a localizer that tells whole poses.

    Attributes
    ----------
    sigmas_off : list of float
        How far the position is off, in standard deviations, at each instant.
    told : list of mapping of str to str
        The health at each.
    """

    def __init__(self, *motions: str, fix_sigmas: tuple[float, float, float] = (0.01, 0.01, 0.01)) -> None:
        self.estimator: Kalman = kalman()
        self.sigmas_off: list[float] = []
        self.told: list[Mapping[str, str]] = []
        self.statuses: list[str] = []
        self.x_m = 0.0
        self._n = 0
        self._motions, self._fix_sigmas = motions, fix_sigmas
        self._rng = np.random.default_rng(4)
        self._frozen: Pose2 | None = None

    def go(
        self,
        lasts_s: float,
        *,
        mps: float = 0.5,
        told_mps: float | None = None,
        mode: str = "noisy",
        step_m: float = 0.1,
    ) -> None:
        """Drive on; fixes are `noisy`, `exact`, `rounded` to steps, or `frozen` at the first."""
        self._frozen = None
        for _ in range(round(lasts_s / DT_S)):
            since_s, stamp_s = self._n * DT_S, (self._n + 1) * DT_S
            self._n += 1
            self.x_m += mps * DT_S
            for name in self._motions:
                x, y, turn = (self._rng.normal(size=3) * MOTION_SIGMAS).tolist()
                way_m = (mps if told_mps is None else told_mps) * DT_S
                step = Pose2(way_m + x, y, turn)
                self.estimator.apply(name, Motion(since_s, stamp_s, step, information_from_sigmas(*MOTION_SIGMAS)))
            if self._n % FIX_EVERY == 0:
                fix = Fix(stamp_s, self._pose(mode, step_m), information_from_sigmas(*self._fix_sigmas))
                self.statuses.append(self.estimator.apply("laser", fix).status)
            belief = self.estimator.belief(stamp_s)
            assert belief.covariance is not None
            away = np.array([pose_of(belief).x - self.x_m, pose_of(belief).y])
            self.sigmas_off.append(math.sqrt(float(away @ np.linalg.solve(belief.covariance[:2, :2], away))))
            self.told.append(belief.health)

    def _pose(self, mode: str, step_m: float) -> Pose2:
        if mode == "exact":
            return Pose2(self.x_m, 0.0, 0.0)
        if mode == "rounded":
            return Pose2(round(self.x_m / step_m) * step_m, 0.0, 0.0)
        sigmas = [
            one if math.isfinite(one) else 0.1 for one in self._fix_sigmas
        ]  # what is not measured may be anything
        dx, dy, turn = (self._rng.normal(size=3) * sigmas).tolist()
        if mode == "noisy":
            return Pose2(self.x_m + dx, dy, turn)
        self._frozen = self._frozen or Pose2(self.x_m + dx, dy, turn)
        if math.isinf(self._fix_sigmas[1]):
            return Pose2(self._frozen.x, dy, turn)
        return self._frozen

    def heard(self) -> set[str]:
        """Return all that the health has said."""
        return {reason for told in self.told for reason in told.values()}


@pytest.mark.parametrize("motions", [("wheels", "camera"), ("wheels", "camera", "laser_odometry")])
def test_a_frozen_pose_is_kept_out_and_motions_that_agree_lead_on(motions: tuple[str, ...]) -> None:
    drive = Drive(*motions)
    drive.go(5.0)
    drive.go(5.0, mode="frozen")
    assert drive.told[-1] == {"laser": FROZEN}
    assert max(drive.sigmas_off[20:]) < 4.0
    assert not any(name in told for told in drive.told for name in motions)


def test_beside_one_motion_the_belief_covers_the_frozen_pose_and_tells_of_both() -> None:
    drive = Drive("wheels")
    drive.go(5.0)
    drive.go(5.0, mode="frozen")
    assert drive.told[-1] == {"laser": FROZEN, "wheels": MOVES_ALONE}
    assert max(drive.sigmas_off[20:]) < 4.0
    covariance = drive.estimator.belief().covariance
    assert covariance is not None
    assert math.sqrt(covariance[0, 0]) > 2.5 / 2.5  # 2.5 m are the way since


def test_wheels_that_slip_where_a_simulator_tells_exact_poses_are_a_question() -> None:
    drive = Drive("wheels")
    drive.go(5.0, mode="exact")
    drive.go(6.0, mps=0.0, told_mps=0.5, mode="exact")
    assert max(drive.sigmas_off[105:]) < 5.0
    assert drive.told[-1] == {"laser": FROZEN, "wheels": MOVES_ALONE}
    drive.go(3.0, mode="exact")
    assert drive.told[-1] == {}
    assert abs(pose_of(drive.estimator.belief()).x - drive.x_m) < 0.01


@pytest.mark.parametrize("motions", [("wheels",), ("wheels", "camera")])
def test_a_pose_that_thaws_is_believed_at_once(motions: tuple[str, ...]) -> None:
    drive = Drive(*motions)
    drive.go(5.0)
    drive.go(3.0, mode="frozen")
    drive.statuses.clear()
    drive.go(3.0)
    assert set(drive.statuses) == {"accepted"}
    assert drive.told[-1] == {}
    assert max(drive.sigmas_off[20:]) < 4.0


@pytest.mark.parametrize("way", ["rests", "is rounded", "creeps"])
def test_nobody_is_accused_who_rests_or_moves_less_than_a_pose_resolves(way: str) -> None:
    drive = Drive("wheels", "camera", fix_sigmas=(0.03, 0.03, 0.03))
    drive.go(4.0, mode="exact")
    if way == "rests":
        drive.go(8.0, mps=0.0, mode="exact")
    else:  # a rounding error of 29 mm as its standard deviation
        drive.go(8.0, mps=0.02 if way == "creeps" else 0.2, mode="rounded")
    assert FROZEN not in drive.heard()


def test_a_part_of_a_pose_that_the_way_does_not_change_may_repeat() -> None:
    drive = Drive("wheels", "camera", fix_sigmas=(math.inf, 0.01, 0.01))
    drive.go(8.0, mode="exact")
    assert FROZEN not in drive.heard()
    assert set(drive.statuses) == {"accepted"}


def test_a_part_of_a_pose_that_the_way_changes_may_not() -> None:
    drive = Drive("wheels", "camera", fix_sigmas=(0.01, math.inf, math.inf))
    drive.go(3.0)
    drive.go(4.0, mode="frozen")
    assert drive.told[-1] == {"laser": FROZEN}
    assert max(drive.sigmas_off[20:]) < 4.0
