"""Does the filter's covariance say the truth? Simulated drives with the noise that the estimates state."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

from trailmark.estimates import Fix, Motion, information_along, information_from_covariance, information_from_sigmas
from trailmark.estimation.kalman.estimator import Kalman
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.evaluation.consistency import chi2_quantile
from trailmark.geometry import Pose2, wrap_angle
from trailmark.interfaces import Session

Array = npt.NDArray[np.float64]

N_RUNS, N_STEPS = 120, 60
STEP_S = 0.1
STEP_SIGMAS = (0.01, 0.005, 0.01)
START_SIGMAS = (0.05, 0.05, math.radians(2.0))


def noisy(pose: Pose2, sigmas: tuple[float, float, float], rng: np.random.Generator) -> Pose2:
    return Pose2.from_array(pose.array() + rng.normal(0.0, sigmas))


def squared(error: Array, covariance: Array) -> float:
    error[2] = wrap_angle(float(error[2]))
    return float(error @ np.linalg.solve(covariance, error))


def summed(way: Pose2, spread: Array, step: Pose2) -> tuple[Pose2, Array]:
    """Return a way with one step more, and its covariance."""
    cos, sin = math.cos(way.theta), math.sin(way.theta)
    turned = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    longer = way @ step
    carried = np.array([[1.0, 0.0, way.y - longer.y], [0.0, 1.0, longer.x - way.x], [0.0, 0.0, 1.0]])
    return longer, carried @ spread @ carried.T + turned @ np.diag(np.square(STEP_SIGMAS)) @ turned.T


class Drive:
    """One simulated drive; `apply` is told everything in time, or in bursts."""

    def __init__(self, seed: int, **config: object) -> None:
        self.rng = np.random.default_rng(seed)
        start = KalmanConfig.model_validate(
            {"start_sigma_m": START_SIGMAS[0], "start_sigma_deg": 2.0, "gate": "off", **config}
        )
        self.estimator = Kalman(start)
        self.truth = Pose2(1.0, 2.0, 0.5)
        self.estimator.start(Session(start_pose=noisy(self.truth, START_SIGMAS, self.rng)))
        self.nis: list[float] = []
        self.dof = 0

    def run(self, fixes: str, is_late: bool = False) -> float:
        """Drive to the end and return the NEES of the last pose."""
        held: list[tuple[str, Fix]] = []
        way, spread, slow_s = Pose2(), np.zeros((3, 3)), 0.0  # a slow odometry that adds up its own steps
        for i in range(N_STEPS):
            step = Pose2(0.1, 0.0, 0.08 * math.sin(0.2 * i))
            self.truth = self.truth @ step
            stamp_s = (i + 1) * STEP_S
            way, spread = summed(way, spread, noisy(step, STEP_SIGMAS, self.rng))
            measured = noisy(step, STEP_SIGMAS, self.rng)
            self.estimator.apply("wheels", Motion(i * STEP_S, stamp_s, measured, information_from_sigmas(*STEP_SIGMAS)))
            if fixes == "motion" and i % 10 == 9:
                self.estimator.apply("slow", Motion(slow_s, stamp_s, way, information_from_covariance(spread)))
                way, spread, slow_s = Pose2(), np.zeros((3, 3)), stamp_s
            elif i % 5 == 4:
                held.append(self._fix(fixes, stamp_s))
            if not is_late or i % 20 == 19:
                self._tell(held)
        belief = self.estimator.belief()
        assert belief.pose_map_base is not None
        assert belief.covariance is not None
        return squared(belief.pose_map_base.array() - self.truth.array(), belief.covariance)

    def _fix(self, kind: str, stamp_s: float) -> tuple[str, Fix]:
        if kind == "line":  # one number: how far base lies along a direction that turns
            angle = 2.0 * stamp_s
            direction = np.array([math.cos(angle), math.sin(angle), 0.0])
            seen = self.truth.array() + direction * self.rng.normal(0.0, 0.05)
            return "line", Fix(stamp_s, Pose2.from_array(seen), information_along(direction, 0.05))
        sigmas = (0.05, 0.05, 0.03)
        return "camera", Fix(stamp_s, noisy(self.truth, sigmas, self.rng), information_from_sigmas(*sigmas))

    def _tell(self, held: list[tuple[str, Fix]]) -> None:
        for source, fix in held:
            applied = self.estimator.apply(source, fix)
            assert applied.nis is not None
            assert applied.dof is not None
            self.nis.append(applied.nis)
            self.dof += applied.dof
        held.clear()


def bounds(dof: int) -> tuple[float, float]:
    """Return the interval in which a sum of squares falls with 95 % probability."""
    low, high = chi2_quantile(0.025, [dof])[0], chi2_quantile(0.975, [dof])[0]
    return float(low), float(high)


@pytest.mark.parametrize(("fixes", "is_late"), [("pose", False), ("pose", True), ("line", False)])
def test_errors_are_as_large_as_the_covariance_says(fixes: str, is_late: bool) -> None:
    drives = [Drive(seed) for seed in range(N_RUNS)]

    nees = sum(drive.run(fixes, is_late) for drive in drives)

    low, high = bounds(3 * N_RUNS)
    assert low < nees < high
    if not is_late:  # of what comes late the innovations are not independent
        low, high = bounds(sum(drive.dof for drive in drives))
        assert low < sum(sum(drive.nis) for drive in drives) < high


def test_a_fast_and_a_slow_odometry_together_are_as_good_as_they_say() -> None:
    nees = sum(Drive(seed).run("motion") for seed in range(N_RUNS))

    low, high = bounds(3 * N_RUNS)
    assert low < nees < high


def with_common_errors(seed: int, kind: str) -> tuple[float, float]:
    """Drive with a biased gyro and wheels of a wrong size; return NEES of the pose, and of the two errors."""
    rng = np.random.default_rng(5000 + seed)
    sources = {"gyro": {"errors": "gyro_bias"}, "wheels": {"errors": "scale"}}
    sigmas = {"gyro_bias_sigma_deg_per_s": 0.5, "scale_sigma": 0.03, "wander_s": 1e9}
    start = {"start_sigma_m": START_SIGMAS[0], "start_sigma_deg": 2.0, "gate": "off", "filter": kind}
    estimator = Kalman(KalmanConfig.model_validate({**start, **sigmas, "sources": sources}))
    truth, bias, scale = Pose2(1.0, 2.0, 0.5), rng.normal(0.0, math.radians(0.5)), rng.normal(0.0, 0.03)
    estimator.start(Session(start_pose=noisy(truth, START_SIGMAS, rng)))
    for i in range(N_STEPS):
        forward_m, turn = 0.05, 0.05 * math.sin(0.2 * i)
        since_s, stamp_s = i * STEP_S, (i + 1) * STEP_S
        truth = truth @ Pose2(forward_m, 0.0, turn)
        wheels = Pose2(
            (1.0 + scale) * forward_m + rng.normal(0.0, 2e-3), rng.normal(0.0, 1e-3), turn + rng.normal(0.0, 0.02)
        )
        gyro = Pose2(0.0, 0.0, turn + bias * STEP_S + rng.normal(0.0, 1e-3))
        estimator.apply("wheels", Motion(since_s, stamp_s, wheels, information_from_sigmas(2e-3, 1e-3, 0.02)))
        estimator.apply("gyro", Motion(since_s, stamp_s, gyro, information_from_sigmas(math.inf, math.inf, 1e-3)))
        if i % 10 == 9:
            sigmas_m = (0.02, 0.02, 0.02)
            estimator.apply("camera", Fix(stamp_s, noisy(truth, sigmas_m, rng), information_from_sigmas(*sigmas_m)))
    belief = estimator.belief()
    assert belief.pose_map_base is not None
    assert belief.covariance is not None
    found = estimator.common_errors()
    errors = [(found["gyro"][0] - bias) / found["gyro"][1], (found["wheels"][0] - scale) / found["wheels"][1]]
    return squared(belief.pose_map_base.array() - truth.array(), belief.covariance), sum(e * e for e in errors)


@pytest.mark.parametrize("kind", ["ekf", "ukf"])
def test_common_errors_are_as_well_known_as_they_say(kind: str) -> None:
    n = N_RUNS // 2 if kind == "ekf" else N_RUNS // 8

    nees = np.array([with_common_errors(seed, kind) for seed in range(n)]).sum(axis=0)

    for value, dof in zip(nees, (3 * n, 2 * n)):
        low, high = bounds(dof)
        assert low < value < high


def test_the_unscented_filter_is_as_good_as_it_says() -> None:
    n = N_RUNS // 8

    nees = sum(Drive(seed, filter="ukf").run("line") for seed in range(n))

    low, high = bounds(3 * n)
    assert low < nees < high
