"""A map that is crooked is known as such by the scans that do not lie on it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark_laser_maps.mcl.map_error import MapError

CELL_M, WALL_M = 0.05, 3.0
RAYS = WALL_M * np.stack([np.cos(np.arange(120) / 20.0), np.sin(np.arange(120) / 20.0)], axis=1)


def ends_off(error_m: float, seed: int) -> Floats:
    """Distances of ends from walls that are off by so much, each wall as a whole, and from cells, (120,) [m]."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(0.0, 0.015, 120) + rng.uniform(-CELL_M / 2.0, CELL_M / 2.0, 120)
    return np.abs(noise + error_m * rng.choice([-1.0, 1.0], 12).repeat(10))


def seen(*errors_m: float, n_each: int = 60) -> MapError:
    map_error = MapError(CELL_M)
    for error_m in errors_m:
        for seed in range(n_each):
            map_error.add(ends_off(error_m, seed), RAYS)
    return map_error


def test_a_straight_map_adds_next_to_nothing() -> None:
    assert seen(0.0).sigmas()[0] < 0.005


@pytest.mark.parametrize("error_m", [0.03, 0.06])
def test_a_crooked_map_adds_what_its_walls_are_off(error_m: float) -> None:
    x_m, y_m, heading_rad = seen(error_m).sigmas()
    assert x_m == y_m == pytest.approx(error_m, rel=0.1)
    assert heading_rad == pytest.approx(x_m / WALL_M)


def test_a_good_part_of_a_crooked_map_does_not_make_it_straight() -> None:
    assert seen(0.05, 0.0).sigmas() == pytest.approx(seen(0.05).sigmas(), rel=0.02)


def test_people_who_walk_by_do_not_make_a_map_crooked() -> None:
    map_error = MapError(CELL_M)
    for seed in range(200):
        map_error.add(ends_off(0.1 if seed % 3 == 0 else 0.0, seed), RAYS)
    assert map_error.sigmas()[0] < 0.01


def test_ends_near_no_wall_say_nothing_of_it() -> None:
    map_error = MapError(CELL_M)
    assert map_error.sigmas() == (0.0, 0.0, 0.0)
    map_error.add(np.full(120, math.nan), RAYS)
    assert map_error.sigmas() == (0.0, 0.0, 0.0)
