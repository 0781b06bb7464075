"""The noise that is left: factors of what was stated, and directions that nobody measured."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.calibration.conftest import BELIEVED, RIGHT, numbers, pairs_from

from trailmark.arrays import Floats
from trailmark.errors import DataError
from trailmark.geometry import Pose2
from trailmark_calibration import simulating
from trailmark_calibration.checking import calibrate
from trailmark_calibration.fitting import PRIOR, fit
from trailmark_calibration.model import LEAST_SCALE, TURN, WAY, YAW, X
from trailmark_calibration.simulating import SimulatedDrive, draw_truth, simulate
from trailmark_calibration.solver import GaussNewton, scale_covariances


def test_a_corridor_that_slants_to_the_robot_stays_where_it_is() -> None:
    """Factors that differ by axis would turn it, and deny what was never measured."""
    along = np.array([math.cos(0.6), math.sin(0.6), 0.0])
    across = np.array([-math.sin(0.6), math.cos(0.6), 0.0])
    corridor = 100.0**2 * np.outer(along, along) + 0.01**2 * np.outer(across, across) + np.diag([0.0, 0.0, 0.01**2])

    scaled = scale_covariances(corridor[np.newaxis], np.array([0.9, 0.2, 0.02]))[0]

    assert along @ np.linalg.inv(scaled) @ along < 1.0 / 50.0**2
    assert 0.002 < math.sqrt(across @ scaled @ across) < 0.01
    assert scaled[2, 2] == pytest.approx(0.0002**2)


def test_what_was_measured_is_scaled_by_axis() -> None:
    stated = np.array([[[4e-4, 1e-4, 0.0], [1e-4, 4e-4, 0.0], [0.0, 0.0, 1e-4]]])

    scaled = scale_covariances(stated, np.array([1.0, 2.0, 3.0]))[0]

    assert scaled == pytest.approx(np.array([[4e-4, 2e-4, 0.0], [2e-4, 16e-4, 0.0], [0.0, 0.0, 9e-4]]))


def stop_and_go(rng: np.random.Generator, course: str, duration_s: float) -> tuple[Floats, Floats]:
    """Return stamps and poses of a robot that goes straight on and stops, as it comes."""
    n, begin = round(duration_s / 0.005), 0
    speeds = np.zeros(n)
    while begin < n:
        end = begin + round(rng.uniform(1.0, 5.0) / 0.005)
        is_rest = int(rng.integers(2))
        speed_mps, *_ = rng.uniform(0.3, 0.7), rng.uniform(size=2), rng.choice(2), rng.uniform()  # as `simulate` draws
        speeds[begin:end] = 0.0 if is_rest else speed_mps
        begin = end
    lag = np.exp(-np.arange(0.0, 1.5, 0.005) / 0.2)
    way = np.concatenate([[0.0], np.cumsum(np.convolve(speeds, lag / lag.sum())[:n] * 0.005)])
    return np.arange(n + 1) * 0.005, np.stack([way, 0.0 * way, 0.0 * way], axis=1)


def test_a_straight_drive_with_stops_tells_no_scale_of_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Noise draws the scale of turns downwards here, from 1 by steps of a quarter: to 0, where nothing is left of a."""
    monkeypatch.setattr(simulating, "_drive_course", stop_and_go)
    rng = np.random.default_rng(305)
    truth, believed = draw_truth(rng)

    found = calibrate(*pairs_from(simulate(rng, truth, believed, duration_s=80.0)), (WAY, TURN)).fit

    assert not found.is_told[[TURN, X]].any()
    assert found.is_told[[WAY, YAW]].all()
    assert abs(found.values[WAY] - truth[WAY]) < 3.5 * found.sigmas[WAY]


@pytest.mark.parametrize("start", [1.0, -1.0, 0.02])
def test_a_scale_keeps_its_sign_however_far_it_is_drawn(mixed: SimulatedDrive, start: float) -> None:
    """The motions of the one have nothing to do with those of the other, turned the wrong way round."""
    pairs, _ = pairs_from(mixed)
    begin = numbers(turn=-start, yaw=0.5, x=0.2, y=-0.1, delay=0.08)

    found = GaussNewton(pairs, begin, PRIOR).solve(begin, None)

    assert math.copysign(1.0, found[TURN]) == math.copysign(1.0, -start)
    assert abs(found[TURN]) >= LEAST_SCALE


@pytest.mark.parametrize("still", ["wheels", "sensor"])
def test_one_that_says_that_nothing_moves_is_refused(still: str) -> None:
    drive = simulate(np.random.default_rng(1), RIGHT, BELIEVED, duration_s=60.0)
    at_rest = [replace(motion, pose_since_now=Pose2()) for motion in getattr(drive, still)]

    with pytest.raises(DataError, match="100 % of the motion contradict each other"):
        fit(*pairs_from(replace(drive, **{still: at_rest})))
