"""Lies that grow slowly beside the noise, and stamps that are late: they are named, or the belief covers them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.estimates import Fix, Motion, information_from_sigmas
from trailmark.estimation.kalman import belief_places
from trailmark.estimation.kalman.agreement import Tolerance
from trailmark.estimation.kalman.bank import log_likelihood_of_offset
from trailmark.estimation.kalman.diagnosis import DetectedFault, MotionSum
from trailmark.estimation.kalman.forgiveness import agree_again
from trailmark.estimation.kalman.innovation import Innovation
from trailmark.estimation.kalman.lasting_errors import UNAFFECTED
from trailmark.estimation.kalman.measurements import Measurement, fix_measurement
from trailmark.estimation.kalman.one_sided import covariance_of_one_sided_corrections, longest_one_sided_since
from trailmark.estimation.kalman.state import FilterState, Gaussian, OdometryState
from trailmark.estimation.kalman.trust import Trust
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.geometry import Pose2, Twist2

from .conftest import kalman, pose_of

DT_S, FIX_EVERY = 0.05, 5
SIGMAS = {"wheels": (2.5e-3, 1e-3, 3e-3), "camera": (1e-3, 8e-4, 8e-4), "laser": (0.03, 0.03, 0.015)}
NAMES = ("wheels", "camera", "laser")

Lie = Callable[[Pose2], Pose2]


@dataclass
class Told:
    """What became of a drive, from the beginning of the lie on."""

    sigmas: list[float] = field(default_factory=list)
    errors_m: list[float] = field(default_factory=list)
    health: list[set[str]] = field(default_factory=list)

    def named_s(self, source: str) -> float:
        """Return when a localizer was named first, after the beginning of the lie."""
        return DT_S * next((i for i, health in enumerate(self.health) if source in health), 10**6)


def drive(
    speed_mps: float,
    *,
    names: tuple[str, ...] = NAMES,
    lie: tuple[float, float] = (6.0, 14.0),
    until_s: float = 14.0,
    scale: float = 1.0,
    turn_radps: float = 0.0,
    laser_late: int = 0,
) -> Told:
    """Drive on a winding way; the camera's way is too long and turns too much, or the laser's stamps are late."""
    rng, estimator, told = np.random.default_rng(5), kalman(), Told()
    poses = [Pose2()]
    for i in range(1, round(until_s / DT_S) + 1):
        t = DT_S * i
        speed, lies = speed_mps * (1.0 + 0.4 * math.sin(1.2 * t)), lie[0] < t <= lie[1]
        step = Pose2.exp(speed * DT_S, 0.0, 0.5 * math.sin(0.7 * t) * DT_S)
        poses.append(poses[-1] @ step)
        for name in ("wheels", "camera"):
            dx, dy, turn = (rng.normal(size=3) * SIGMAS[name]).tolist()
            k, more = (scale, turn_radps * DT_S) if lies and name == "camera" else (1.0, 0.0)
            said = Pose2(k * step.x + dx, k * step.y + dy, step.theta + turn + more)
            if name in names:
                estimator.apply(name, Motion(t - DT_S, t, said, information_from_sigmas(*SIGMAS[name])))
        if "laser" in names and i % FIX_EVERY == 0:
            seen = poses[i - laser_late if lies else i]
            dx, dy, turn = (rng.normal(size=3) * SIGMAS["laser"]).tolist()
            fix = Fix(t, Pose2(seen.x + dx, seen.y + dy, seen.theta + turn), information_from_sigmas(*SIGMAS["laser"]))
            estimator.apply("laser", fix)
        if t > lie[0]:
            belief = estimator.belief(t)
            assert belief.covariance is not None
            told.errors_m.append(pose_of(belief).distance_to(poses[-1]))
            told.sigmas.append(told.errors_m[-1] / math.sqrt((belief.covariance[0, 0] + belief.covariance[1, 1]) / 2))
            told.health.append(set(belief.health))
    return told


@pytest.mark.parametrize(("scale", "turn_deg_per_s"), [(1.25, 0.0), (1.0, 4.0)])
def test_a_lie_that_grows_slowly_beside_another_motion_is_covered(scale: float, turn_deg_per_s: float) -> None:
    told = drive(0.15, names=("wheels", "camera"), scale=scale, turn_radps=math.radians(turn_deg_per_s))

    assert told.health[-1] == {"wheels", "camera"}
    assert np.quantile(told.sigmas, 0.95) < 4.0


def test_who_lies_slowly_is_not_believed_again_while_it_lies_but_after() -> None:
    told = drive(0.15, scale=1.25, lie=(6.0, 16.0), until_s=28.0)
    during, after = told.health[: round(10.0 / DT_S)], told.health[round(10.0 / DT_S) :]
    first = round(told.named_s("camera") / DT_S)

    assert first < round(5.0 / DT_S)
    assert all(health == {"camera"} for health in during[first:])
    assert not after[-1]


def test_a_lone_motion_whose_lie_began_before_the_last_seconds_is_named() -> None:
    told = drive(0.12, names=("camera", "laser"), scale=1.3)

    assert told.named_s("camera") < 6.0
    assert max(told.errors_m) < 0.2


def test_a_late_laser_is_named_and_no_motion_that_agrees_with_another() -> None:
    told = drive(1.5, laser_late=5)

    assert set().union(*told.health) == {"laser"}
    assert told.named_s("laser") <= 2.0
    assert np.quantile(told.sigmas, 0.95) < 4.0
    assert max(told.errors_m) < 0.1


def test_a_lone_motion_that_is_about_right_is_of_use_while_it_is_not_believed() -> None:
    told = drive(0.15, names=("camera", "laser"), turn_radps=math.radians(4.0))
    alone = drive(0.15, names=("laser",))

    assert told.named_s("camera") < told.named_s("laser")
    assert np.sqrt(np.mean(np.square(told.errors_m))) < np.sqrt(np.mean(np.square(alone.errors_m)))


def test_nobody_is_named_where_nobody_lies() -> None:
    told = drive(0.5, until_s=20.0)

    assert not set().union(*told.health)
    assert np.quantile(told.sigmas, 0.95) < 4.0


def _state_after(t: float, wheels_m: float, camera_m: float) -> FilterState:
    sums = {
        name: MotionSum(x, 0.0, 0.0, 1e-5 * t, 1e-5 * t, t) for name, x in (("wheels", wheels_m), ("camera", camera_m))
    }
    state = FilterState(t, None, OdometryState(has_moved=True))
    return state.with_diagnosis(state.diagnosis._replace(sums=sums))


@pytest.mark.parametrize(("camera_m", "agree"), [(4.0, False), (4.5, True)])
def test_ways_that_cross_do_not_acquit_a_motion_that_disagrees_now(camera_m: float, agree: bool) -> None:
    # Over 6 s both have gone 6 m; what the camera told too little of at first it tells too much of now.
    now, tolerance = _state_after(6.0, 6.0, 6.0), Tolerance.of(KalmanConfig())
    near, far = _state_after(4.5, 4.5, camera_m), _state_after(0.0, 0.0, 0.0)
    now = now.with_diagnosis(now.diagnosis._replace(anchors=(near,), far_anchors=(far,)))
    faults = {"camera": DetectedFault(0.0, "lies", shows_in_s=4.0)}

    assert agree_again(now, ("wheels", "camera"), tolerance, faults) == agree


def _filter_state(*, corrections: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> FilterState:
    """Return a state that one absolute estimate, 0.5 s ago, has corrected by a tenth of its innovation."""
    gaussian = Gaussian(np.zeros(3), 1e-4 * np.eye(3), UNAFFECTED)
    used = Innovation(10.0 * np.array(corrections) / 0.03, np.eye(3) / 0.03, gaussian.covariance)
    odometry = OdometryState(twist=Twist2(2.0, 0.0, 0.1), has_moved=True)
    state = FilterState(8.0, gaussian, odometry)
    anchored = state.diagnosis._replace(
        anchors=(replace(state, stamp_s=6.0),),
        innovations=((7.5, used),),
        measurements=((8.0, _laser(Pose2())),),
        corrections=np.array(corrections),
        correction_covariance=1e-5 * np.eye(3),
    )
    return state.with_diagnosis(anchored)


def _laser(pose: Pose2) -> Measurement:
    information = (1e4, 0.0, 0.0, 1e4, 0.0, 1e4)
    return fix_measurement("laser", Fix(8.0, pose, 1e4 * np.eye(3)), information, Trust.of(KalmanConfig(), "laser"))


def test_corrections_to_one_side_make_the_belief_as_wide_as_the_mean_innovation() -> None:
    widened = covariance_of_one_sided_corrections(_filter_state(corrections=(0.02, 0.0, 0.0)))

    np.testing.assert_allclose(widened, np.diag([0.2**2, 0.0, 0.0]), atol=1e-12)
    assert not covariance_of_one_sided_corrections(_filter_state(corrections=(0.005, 0.0, 0.0))).any()


def test_after_the_last_absolute_estimate_the_belief_is_widened_by_no_more_than_was_seen() -> None:
    state = _filter_state(corrections=(0.02, 0.0, 0.0))
    vague = replace(state, gaussian=Gaussian(np.zeros(3), 1e2 * np.eye(3), UNAFFECTED))
    later = replace(state, stamp_s=9.5)

    np.testing.assert_allclose(covariance_of_one_sided_corrections(vague), np.diag([0.2**2, 0.0, 0.0]), atol=1e-12)
    assert not covariance_of_one_sided_corrections(later).any()


def test_about_one_belief_in_a_hundred_of_honest_drives_is_widened(monkeypatch: pytest.MonkeyPatch) -> None:
    widened: list[bool] = []

    def record(state: FilterState, *_: object) -> Floats:
        widened.append(bool(covariance_of_one_sided_corrections(state).any()))
        return np.zeros((3, 3))

    monkeypatch.setattr(belief_places, "covariance_of_one_sided_corrections", record)
    for seed in range(16):
        drive_honestly(seed)

    assert 0.0 < np.mean(widened) < 0.02


def drive_honestly(seed: int) -> None:
    """Drive 12 s with wheels and absolute estimates that err as they say, and ask for each belief."""
    rng, estimator, pose = np.random.default_rng(seed), kalman(), Pose2()
    step, wheels, camera = Pose2.exp(0.05, 0.0, 0.02), (4e-3, 2e-3, 4e-3), (0.02, 0.02, 0.01)
    for i in range(1, 121):
        t, pose = 0.1 * i, pose @ step
        said = step @ Pose2.from_array(rng.normal(size=3) * wheels)
        estimator.apply("wheels", Motion(t - 0.1, t, said, information_from_sigmas(*wheels)))
        if i % 2 == 0:
            dx, dy, turn = (rng.normal(size=3) * camera).tolist()
            seen = Pose2(pose.x + dx, pose.y + dy, pose.theta + turn)
            estimator.apply("camera", Fix(t, seen, information_from_sigmas(*camera)))
        estimator.belief(t)


def test_who_corrects_to_one_side_is_asked_about_from_where_that_began() -> None:
    state = _filter_state(corrections=(0.02, 0.0, 0.0))
    older, newer = FilterState(2.0, None, OdometryState()), FilterState(4.0, None, OdometryState())
    before = FilterState(0.0, None, OdometryState(), diagnosis=state.diagnosis)  # since then they add up to nothing

    drifts = state.with_diagnosis(state.diagnosis._replace(far_anchors=(before, older, newer)))

    assert longest_one_sided_since(drifts) is older
    assert longest_one_sided_since(_filter_state()) is None


def test_of_absolute_estimates_that_are_late_the_delay_is_found() -> None:
    state, offset, logs = _filter_state(), None, []
    for k in range(6):  # it turns: in the map, what is late by a constant is off by no constant
        turned = FilterState(
            8.0 + k, Gaussian(np.array([0.0, 0.0, 0.5 * k]), 1e-4 * np.eye(3), UNAFFECTED), state.odometry
        )
        behind = Pose2(-0.5 * math.cos(0.5 * k), -0.5 * math.sin(0.5 * k), 0.5 * k - 0.025)
        log, offset = log_likelihood_of_offset(turned, _laser(behind), offset)
        logs.append(log)

    assert offset is not None
    assert offset.late_s == pytest.approx(0.25, abs=0.005)
    assert offset.log_late > offset.log_constant + 20.0
    assert sum(logs) == pytest.approx(offset.log_late)
