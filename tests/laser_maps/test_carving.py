"""Grids from scans: where rays end is occupied, where they pass is free, and what walked through is neither."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.errors import ShapeError
from trailmark.geometry import Pose2
from trailmark_laser_maps.carving import PlacedScan, carve_grid, count_rays
from trailmark_laser_maps.grid import OCCUPIED, OccupancyGrid


def value_at(grid: OccupancyGrid, x: float, y: float) -> int:
    column, row = np.floor((grid.pose_map_grid.inverse() @ np.array([x, y])) / grid.resolution_m).astype(int)
    return int(grid.cells[row, column])


def test_a_ray_passes_all_cells_to_its_end() -> None:
    hits, passes = np.zeros((4, 6), np.int32), np.zeros((4, 6), np.int32)
    count_rays(np.array([0.5, 0.5]), np.array([[5.5, 0.5], [0.5, 3.5], [2.6, 2.5]]), hits, passes)
    assert passes[0].tolist() == [3, 2, 1, 1, 1, 0]  # the slanted one leaves to the right first
    assert passes[:, 0].tolist() == [3, 1, 1, 0]
    assert np.argwhere(hits).tolist() == [[0, 5], [2, 2], [3, 0]]


def test_rays_backwards_meet_the_same_cells() -> None:
    rng = np.random.default_rng(7)
    for _ in range(50):
        start, end = rng.uniform(0, 20, 2), rng.uniform(0, 20, 2)
        counts = []
        for a, b in ((start, end), (end, start)):
            hits, passes = np.zeros((20, 20), np.int32), np.zeros((20, 20), np.int32)
            count_rays(a, b[np.newaxis], hits, passes)
            counts.append(hits + passes)
        np.testing.assert_array_equal(*counts)


def test_a_room_is_drawn_where_it_is(walls: Floats, room_scans: list[PlacedScan]) -> None:
    grid = carve_grid(room_scans)
    occupied = grid.pose_map_grid @ grid.centres(grid.is_occupied)
    starts, ends = walls[:, :2], walls[:, 2:]
    along = ends - starts
    share = np.clip(((occupied[:, None] - starts) * along).sum(2) / (along**2).sum(1), 0, 1)
    to_wall = np.linalg.norm(occupied[:, None] - (starts + share[..., None] * along), axis=2).min(axis=1)
    assert to_wall.max() <= 0.05 * math.sqrt(0.5) + 1e-9  # half the diagonal of a cell
    assert value_at(grid, 2.0, 2.0) == 0
    assert value_at(grid, 6.5, 0.5) == 0
    assert value_at(grid, 4.75, 2.3) == -1  # inside the pillar
    assert grid.free_m2 == pytest.approx(36.0, rel=0.06)


def test_what_walked_through_is_free(look: Callable[..., Floats]) -> None:
    wall = np.array([(3.0, -1.0, 3.0, 1.0)])
    person = np.array([(2.0, -0.2, 2.0, 0.2)])
    seen = [look(np.concatenate([wall, person]), Pose2())] * 2 + [look(wall, Pose2())] * 20
    grid = carve_grid([PlacedScan(np.zeros(2), points) for points in seen])
    assert value_at(grid, 2.0001, 0.0) == 0
    assert value_at(grid, 3.0001, 0.0) == OCCUPIED


def test_scans_without_points_are_no_map() -> None:
    with pytest.raises(ShapeError, match="no points"):
        carve_grid([PlacedScan(np.zeros(2), np.empty((0, 2)))])
    with pytest.raises(ShapeError, match="too much"):
        carve_grid([PlacedScan(np.zeros(2), np.array([[1e5, 1e5]]))])
