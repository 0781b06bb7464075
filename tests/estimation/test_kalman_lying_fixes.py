"""Absolute estimates that lie beside motions, and what one motion alone can decide."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from trailmark.estimates import Belief, Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman.certainty import CertaintyRecord
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman.health import SourceMonitor
from trailmark.estimation.kalman.trust import Trust
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.symmetric import Sym3, diagonal
from trailmark.geometry import Pose2

from .conftest import kalman, pose_of

DT_S, SPEED_MPS = 0.05, 0.5
SIGMAS = {"wheels": (2e-3, 1e-3, 4e-3), "camera": (6e-4, 6e-4, 6e-4)}
LASER_SIGMAS = (0.02, 0.02, 0.01)

FixLie = Callable[[float, Pose2], Fix]


class Drive:
    """A straight way at 0.5 m/s: motions and a laser tell it, one of which may lie from 5 s on."""

    def __init__(self, *motions: str, seed: int = 3, lasers: Sequence[str] = ("laser",)) -> None:
        self._lasers = lasers
        self.estimator: Kalman = kalman()
        self.named: dict[str, float] = {}
        self.sigmas_off: list[float] = []
        self._motions = motions
        self._rng = np.random.default_rng(seed)
        self._i = 0
        self._x_m = 0.0

    def go(
        self, until_s: float, *, fix: FixLie | None = None, frozen: Sequence[str] = (), speed_mps: float = SPEED_MPS
    ) -> Belief:
        """Drive on with these lies; return the belief at the end."""
        while self._i < round(until_s / DT_S):
            self._i += 1
            stamp_s = DT_S * self._i
            self._x_m += speed_mps * DT_S
            for name in self._motions:
                noise = (self._rng.normal(size=3) * SIGMAS[name]).tolist()
                way_m = 0.0 if name in frozen else speed_mps * DT_S
                step = Pose2(way_m + noise[0], noise[1], noise[2])
                self.estimator.apply(
                    name, Motion(stamp_s - DT_S, stamp_s, step, information_from_sigmas(*SIGMAS[name]))
                )
            for name in self._lasers if self._i % 5 == 0 else ():
                dx, dy, turn = (self._rng.normal(size=3) * LASER_SIGMAS).tolist()
                pose = Pose2(self._x_m + dx, dy, turn)
                honest = Fix(stamp_s, pose, information_from_sigmas(*LASER_SIGMAS))
                self.estimator.apply(name, fix(stamp_s, pose) if fix else honest)
            self._look(stamp_s)
        return self.estimator.belief(DT_S * self._i)

    def _look(self, stamp_s: float) -> None:
        belief = self.estimator.belief(stamp_s)
        assert belief.covariance is not None
        sigma_m = math.sqrt((belief.covariance[0, 0] + belief.covariance[1, 1]) / 2.0)
        pose = pose_of(belief)
        self.sigmas_off.append(math.hypot(pose.x - self._x_m, pose.y) / sigma_m)
        for source in belief.health:
            self.named.setdefault(source, stamp_s)


def error_m(belief: Belief) -> float:
    pose = pose_of(belief)
    return math.hypot(pose.x - SPEED_MPS * belief.stamp_s, pose.y)


def aside(stamp_s: float, pose: Pose2) -> Fix:
    return Fix(stamp_s, Pose2(pose.x, pose.y + 1.0, pose.theta), information_from_sigmas(*LASER_SIGMAS))


def too_sure(stamp_s: float, pose: Pose2) -> Fix:
    return Fix(stamp_s, pose, information_from_sigmas(*(1e-4 * sigma for sigma in LASER_SIGMAS)))


def test_fixes_that_jump_lose_against_two_motions_that_agree() -> None:
    drive = Drive("wheels", "camera")
    drive.go(5.0)

    belief = drive.go(10.0, fix=aside)

    assert set(drive.named) == {"laser"}
    assert drive.named["laser"] <= 7.0
    assert "against the motion of camera and wheels" in belief.health["laser"]
    assert error_m(belief) < 0.05


def test_fixes_that_agree_again_are_believed_again() -> None:
    drive = Drive("wheels", "camera")
    drive.go(5.0)
    drive.go(10.0, fix=aside)

    belief = drive.go(12.0)

    assert not belief.health
    assert drive.estimator.apply("laser", Fix(12.0, Pose2(6.0), information_from_sigmas(0.1, 0.1, 0.1))).status == (
        "accepted"
    )


def test_fixes_that_contradict_for_long_win_in_the_end() -> None:
    drive = Drive("wheels", "camera")
    drive.go(5.0)

    belief = drive.go(40.0, fix=aside)

    assert abs(pose_of(belief).y - 1.0) < 0.1
    assert drive.estimator.counters()["recoveries"] == 1


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_between_two_motions_and_two_lasers_that_jump_together_the_belief_covers_both(seed: int) -> None:
    drive = Drive("wheels", "camera", seed=seed, lasers=("laser", "beacons"))
    drive.go(5.0)

    during = drive.go(15.0, fix=aside)
    after = drive.go(18.0)

    assert set(during.health) == {"laser", "beacons"}
    assert all("nothing decides" in reason for reason in during.health.values())
    assert during.covariance is not None
    assert during.covariance[1, 1] ** 0.5 > 0.25
    assert max(drive.sigmas_off) < 4.0
    assert not after.health
    assert error_m(after) < 0.05


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_between_one_motion_and_fixes_that_jump_the_belief_covers_both(seed: int) -> None:
    drive = Drive("camera", seed=seed)
    drive.go(5.0)

    belief = drive.go(15.0, fix=aside)

    assert "nothing decides" in belief.health["laser"]
    assert belief.covariance is not None
    assert belief.covariance[1, 1] ** 0.5 > 0.25  # the laser's place, 1 m to the side, is within 4 sigma
    assert max(drive.sigmas_off[100:]) < 4.0


def test_one_motion_that_freezes_loses_against_fixes_that_go_on() -> None:
    drive = Drive("camera")
    drive.go(5.0)

    belief = drive.go(13.0, frozen=("camera",))

    assert set(belief.health) == {"camera"}
    assert drive.named["camera"] <= 7.0
    assert error_m(belief) < 0.2
    assert np.quantile(drive.sigmas_off[100:], 0.95) < 4.0


@pytest.mark.parametrize("motions", [("camera",), ("wheels", "camera")])
def test_motion_that_no_other_can_vouch_for_is_believed_again_by_what_fixes_say(motions: tuple[str, ...]) -> None:
    drive = Drive(*motions)
    drive.go(5.0)
    accused = drive.go(11.0, frozen=motions)

    belief = drive.go(16.0)

    assert set(accused.health) == set(motions)
    assert not belief.health
    assert error_m(belief) < 0.05
    assert np.quantile(drive.sigmas_off[-20:], 0.95) < 4.0


def test_motion_that_goes_on_lying_is_not_believed_again() -> None:
    drive = Drive("camera")
    drive.go(5.0)

    accused = [set(drive.go(8.0 + 0.5 * k, frozen=("camera",)).health) for k in range(40)]

    assert accused == [{"camera"}] * 40


def test_a_robot_at_rest_acquits_nobody() -> None:
    drive = Drive("camera")
    drive.go(5.0)
    drive.go(10.0, frozen=("camera",))

    belief = drive.go(20.0, speed_mps=0.0)

    assert set(belief.health) == {"camera"}


def test_a_certainty_without_precedent_is_not_believed_and_said() -> None:
    drive = Drive("wheels", "camera")
    drive.go(5.0)

    belief = drive.go(9.0, fix=too_sure)

    assert "more certain than it ever was" in belief.health["laser"]
    assert np.quantile(drive.sigmas_off[100:], 0.95) < 4.0
    assert error_m(belief) < 0.05


def test_certainty_may_grow_by_and_by() -> None:
    record = CertaintyRecord()
    stated = [(0.1 * i, 100.0 * math.exp(0.01 * i)) for i in range(500)]

    for stamp_s, information in stated:
        everything = diagonal(information, information, information)
        assert record.believed(everything, stamp_s) == everything


def test_certainty_without_precedent_is_believed_as_that_before() -> None:
    record = CertaintyRecord()
    for i in range(20):
        record.believed(diagonal(100.0, 100.0, 100.0), 0.1 * i)

    believed = record.believed(diagonal(1e10, 1e10, 1e10), 2.0)

    np.testing.assert_allclose(believed, diagonal(100.0, 100.0, 100.0))


def test_a_clock_that_is_set_back_makes_nothing_precedented() -> None:
    record = CertaintyRecord()
    for i in range(20):
        record.believed(diagonal(100.0, 100.0, 100.0), 1000.0 + 0.1 * i)

    record.restart_clock(5.0)

    np.testing.assert_allclose(record.believed(diagonal(1e10, 1e10, 1e10), 5.0), diagonal(100.0, 100.0, 100.0))


def test_certainty_without_precedent_is_no_precedent_soon() -> None:
    record = CertaintyRecord()
    for i in range(20):
        record.believed(diagonal(100.0, 100.0, 100.0), 0.1 * i)
    for i in range(120):
        believed = record.believed(diagonal(1e10, 1e10, 1e10), 2.0 + 0.1 * i)

    assert math.sqrt(believed[0] / 100.0) < 1.3  # as standard deviations, after 12 s


def test_a_part_of_an_estimate_is_no_precedent() -> None:
    record = CertaintyRecord()
    part, everything = diagonal(1e4, 1e4, 0.0), diagonal(1e4, 1e4, 1e4)

    for i in range(20):
        assert record.believed(part, 0.1 * i) == part
    for i in range(20, 40):
        assert record.believed(everything, 0.1 * i) == everything
    assert record.n_in_a_row == 0


@pytest.mark.parametrize("rest_s", [(0.0, 1.5), (3.0, 3.1)])
def test_a_motion_that_is_certain_at_rest_is_no_precedent(rest_s: tuple[float, float]) -> None:
    monitor = SourceMonitor(Trust.of(KalmanConfig(), "camera"))

    def believed(i: int, way_m: float, sure: float) -> Sym3:
        motion = Motion(0.05 * i, 0.05 * i + 0.05, Pose2(way_m, 0.0), np.eye(3))
        return monitor.believed_of_motion(motion, diagonal(sure, sure, sure))

    for i in range(100):
        is_at_rest = rest_s[0] <= 0.05 * i < rest_s[1]
        way_m, sure = (1e-5, 1e10) if is_at_rest else (0.025, 1e4)
        assert believed(i, way_m, sure) == diagonal(sure, sure, sure)

    assert believed(100, 0.025, 1e9)[0] < 2e4


def test_a_jump_of_the_only_motion_is_left_out_and_said() -> None:
    drive = Drive("camera")
    drive.go(5.0)

    jump = Motion(5.0, 5.05, Pose2(0.025, 1.0), information_from_sigmas(6e-4, 6e-4, 6e-4))
    applied = drive.estimator.apply("camera", jump)

    belief = drive.estimator.belief(5.05)
    assert applied.status == "gated"
    assert "no robot" in applied.reason
    assert abs(pose_of(belief).y) < 0.05
    assert belief.covariance is not None
    assert belief.covariance[1, 1] ** 0.5 == pytest.approx(1.0, abs=0.05)  # it covers the jump, too


def test_a_part_of_a_pose_does_not_accuse_the_only_motion() -> None:
    drive = Drive("camera")
    drive.go(5.0)

    line = np.diag([0.0, 2500.0, 1e4])
    for k in range(1, 9):
        drive.estimator.apply("laser", Fix(5.0 + 0.01 * k, Pose2(0.0, 1.0), line))

    assert "camera" not in drive.estimator.belief(5.1).health
