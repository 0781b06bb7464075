"""Drives whose answer is known: wrong wheels, and a sensor that is mounted and stamped otherwise than believed.

No pictures or scans: the motions themselves, with noise. For tests, benchmarks, and to see what a course can tell.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Motion, information_from_sigmas
from trailmark.geometry import Pose2
from trailmark_calibration.model import DELAY, NEUTRAL, TURN, TURN_PER_M, WAY, YAW, X, Y
from trailmark_calibration.rigid import between, compose, exp_of, invert, log_of

__all__ = ["Course", "DriveNoise", "SimulatedDrive", "draw_truth", "simulate"]

Course = Literal["mixed", "straight", "circle"]

_DT_S = 0.005


@dataclass(frozen=True, slots=True)
class DriveNoise:
    """Random walks of wheels and sensor, and wrong motions of the sensor.

    Attributes
    ----------
    way, turn : float
        Of the wheels after 1 m and after 1 rad, as a share [m per root m, rad per root rad].
    sensor_m, sensor_rad : float
        Of each motion of the sensor [m, rad].
    outliers : float
        Share of its motions that are wrong by 10 cm and 10 degrees.
    """

    way: float = 0.005
    turn: float = 0.01
    sensor_m: float = 0.002
    sensor_rad: float = 0.001
    outliers: float = 0.005


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedDrive:
    """What was driven, and what two localizers say of it.

    Attributes
    ----------
    truth : (8,) float64
        The right numbers, in the order of `model.NAMES`.
    believed : (3,) float64
        The place of the sensor that its localizer takes [m, m, rad].
    wheels, sensor : sequence of Motion
        Motions of base, as both believe.
    stamps_s, poses : (N,), (N, 3) float64
        What was driven, by the clock of the sensor.
    """

    truth: Floats
    believed: Floats
    wheels: Sequence[Motion]
    sensor: Sequence[Motion]
    stamps_s: Floats
    poses: Floats


def draw_truth(rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Return right numbers, (8,), and the place of the sensor that is believed, (3,)."""
    truth = NEUTRAL.copy()
    truth[WAY], truth[TURN] = rng.uniform(0.93, 1.07), rng.uniform(0.9, 1.1)
    truth[TURN_PER_M] = rng.uniform(-0.02, 0.02)
    truth[[X, Y]], truth[YAW] = rng.uniform(-0.3, 0.3, 2), rng.uniform(-math.pi, math.pi)
    truth[DELAY] = rng.uniform(-0.15, 0.15)
    return truth, truth[[X, Y, YAW]] + rng.uniform(-1.0, 1.0, 3) * (0.08, 0.08, 0.15)


def simulate(
    rng: np.random.Generator,
    truth: Floats,
    believed: Floats,
    *,
    course: Course = "mixed",
    duration_s: float = 240.0,
    noise: DriveNoise = DriveNoise(),
) -> SimulatedDrive:
    """Return a drive of a robot with differential wheels at 20 Hz and a sensor at 10 Hz.

    ``mixed`` are straight ways, curves and turns in place, as they come; ``circle`` is one circle all the time.

    Parameters
    ----------
    rng : Generator
        Of the course and of the noise.
    truth, believed : (8,) float64
        The numbers that are right, and those that the config has.
    course : Course
        Kind of drive.
    duration_s : float
        Of the drive [s].
    noise : DriveNoise
        Of wheels and sensor.

    Returns
    -------
    SimulatedDrive
        Both tracks, as the localizers would give them.
    """
    grid_s, poses = _drive_course(rng, course, duration_s)
    wheels_s = np.arange(2.0, duration_s - 2.0, 0.05) + rng.uniform(0.0, 0.05)
    steps = log_of(between(*_ends(_at(wheels_s, grid_s, poses))))
    matrix = np.array(
        [[truth[WAY], 0.0, 0.0], [0.0, truth[WAY], 0.0], [truth[TURN_PER_M], 0.0, truth[TURN]]],
    )
    told = steps @ np.linalg.inv(matrix).T
    way = np.sqrt((noise.way**2) * np.abs(told[:, 0]) + 1e-9)
    sigmas = np.stack([way, 0.3 * way, np.sqrt((noise.turn**2) * np.abs(told[:, 2]) + 1e-9)], axis=1)
    told = told + sigmas * rng.standard_normal(told.shape)
    wheels = _motions(wheels_s + truth[DELAY], exp_of(told), sigmas)

    sensor_s = np.arange(2.0, duration_s - 2.0, 0.1) + rng.uniform(0.0, 0.1)
    mounting = truth[[X, Y, YAW]]
    seen = compose(compose(invert(mounting), between(*_ends(_at(sensor_s, grid_s, poses)))), mounting)
    spread = np.array([noise.sensor_m, noise.sensor_m, noise.sensor_rad])
    is_wrong = rng.uniform(size=len(seen)) < noise.outliers
    errors = spread * rng.standard_normal(seen.shape)
    errors[is_wrong] += np.array([0.1, 0.1, 0.17]) * rng.standard_normal((int(is_wrong.sum()), 3))
    seen = compose(seen, exp_of(errors))
    of_base = compose(compose(believed, seen), invert(believed))
    return SimulatedDrive(truth, believed, wheels, _motions(sensor_s, of_base, spread), grid_s, poses)


def _drive_course(rng: np.random.Generator, course: Course, duration_s: float) -> tuple[Floats, Floats]:
    """Return stamps and poses of base: pieces of constant speed and yaw rate, smoothed as by a drive."""
    n = round(duration_s / _DT_S)
    speeds: Floats = np.full(n, 0.4)
    rates: Floats = np.full(n, 0.4 if course == "circle" else 0.0)
    begin = 0
    while begin < n and course != "circle":
        end = begin + round(rng.uniform(1.0, 5.0) / _DT_S)
        kind = 0 if course == "straight" else int(rng.integers(3))
        speeds[begin:end] = (rng.uniform(0.3, 0.7), rng.uniform(0.2, 0.6), 0.0)[kind]
        rates[begin:end] = (0.0, rng.uniform(-0.8, 0.8), rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 1.0))[kind]
        begin = end
    lag = np.exp(-np.arange(0.0, 1.5, _DT_S) / 0.2)
    speeds, rates = (np.convolve(values, lag / lag.sum())[:n] for values in (speeds, rates))
    headings = np.concatenate([[0.0], np.cumsum(rates * _DT_S)])
    middle = (headings[1:] + headings[:-1]) / 2.0
    x = np.concatenate([[0.0], np.cumsum(speeds * np.cos(middle) * _DT_S)])
    y = np.concatenate([[0.0], np.cumsum(speeds * np.sin(middle) * _DT_S)])
    return np.asarray(np.arange(n + 1) * _DT_S, dtype=np.float64), np.stack([x, y, headings], axis=1)


def _at(stamps_s: Floats, grid_s: Floats, poses: Floats) -> Floats:
    return np.stack([np.interp(stamps_s, grid_s, column) for column in poses.T], axis=1)


def _ends(poses: Floats) -> tuple[Floats, Floats]:
    return poses[:-1], poses[1:]


def _motions(stamps_s: Floats, steps: Floats, sigmas: Floats) -> list[Motion]:
    sigmas = np.broadcast_to(sigmas, steps.shape)
    return [
        Motion(since_s, stamp_s, Pose2.from_array(step), information_from_sigmas(*sigma.tolist()))
        for since_s, stamp_s, step, sigma in zip(stamps_s.tolist(), stamps_s[1:].tolist(), steps, sigmas)
    ]
