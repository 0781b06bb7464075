"""Drives whose answer is known, looked at as the commands do."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark_calibration.fitting import Fit, KnownPlacement
from trailmark_calibration.model import NEUTRAL, YAW, MotionPairs, X, Y, pairs_of
from trailmark_calibration.simulating import SimulatedDrive, simulate
from trailmark_calibration.tracks import track_of


def numbers(**named: float) -> Floats:
    """Return right numbers that differ from the neutral ones in some."""
    from trailmark_calibration.model import NAMES

    values = NEUTRAL.copy()
    for name, value in named.items():
        values[NAMES.index(name)] = value
    return values


def pairs_from(drive: SimulatedDrive, **options: float) -> tuple[MotionPairs, KnownPlacement]:
    """Return what is compared of a drive."""
    sensor = track_of("sensor", drive.sensor).seen_from(drive.believed)
    return pairs_of(track_of("wheels", drive.wheels), sensor, 0.5, **options), KnownPlacement(drive.believed)


def errors_of(found: Fit, truth: Floats) -> Floats:
    """Return found minus right, (8,)."""
    errors = found.values - truth
    errors[YAW] = math.remainder(errors[YAW], 2.0 * math.pi)
    return errors


#: A robot with wheels 3 % too small and 6 % too far apart, and a laser that is not where it is believed.
RIGHT = numbers(way=1.03, turn=0.94, turn_per_m=0.01, x=0.2, y=-0.1, yaw=0.5, delay=0.08)
BELIEVED = np.array([0.15, -0.05, 0.4])


@pytest.fixture(scope="session")
def mixed() -> SimulatedDrive:
    """An ordinary drive of two minutes."""
    return simulate(np.random.default_rng(7), RIGHT, BELIEVED, duration_s=120.0)


@pytest.fixture(scope="session")
def straight() -> SimulatedDrive:
    """A drive that never turns."""
    return simulate(np.random.default_rng(8), RIGHT, BELIEVED, duration_s=120.0, course="straight")


__all__ = ["BELIEVED", "RIGHT", "X", "Y", "errors_of", "numbers", "pairs_from"]
