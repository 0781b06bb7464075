"""Layers of a floor as functions of the place."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

from trailmark_sim.ground.canvas import Canvas, grid
from trailmark_sim.ground.layers import GrainLayer, add_clouds, add_grains
from trailmark_sim.hashing import hash2, mix_bits, normal_of, unit_of

SEED = np.uint64(11)


def painted(x_m: float, y_m: float, n: int = 64) -> npt.NDArray[np.float32]:
    canvas = Canvas(*grid(x_m, y_m, 2.5e-4, n), 5, 100.0)
    canvas.planks(0.05, 0.02, 4.0).bend((0.02, 0.01), 0.002).clouds((0.01, 0.001), 5.0)
    canvas.grains(0.003, 6.0, gap=-9.0, shade=3.0, share=0.7).dust(8.0)
    return canvas.specks(0.004, 0.5, -30.0, spread=5.0).joints(0.001, -20.0).grey


def test_a_place_looks_the_same_whatever_canvas_it_lies_on() -> None:
    texel = 2.5e-4

    whole = painted(-3.0, 2.0)
    part = painted(-3.0 + 16 * texel, 2.0 + 8 * texel, n=32)

    np.testing.assert_allclose(part, whole[8:40, 16:48], atol=2e-3)  # the places differ by rounding


def test_clouds_are_interpolated_between_normal_numbers_on_a_lattice() -> None:
    cell = 0.01
    x, y = np.array([[-0.013]]), np.array([[0.027]])
    out = np.zeros((1, 1), dtype=np.float32)

    add_clouds(out, x, y, cell, cell, 3.0, SEED)

    i, j, u, v = -2, 2, 0.7, 0.7
    corners = [[normal_of(hash2(i + di, j + dj, SEED)) for di in (0, 1)] for dj in (0, 1)]
    s, t = (w * w * (3 - 2 * w) for w in (u, v))
    expected = np.array([1 - t, t]) @ np.array(corners) @ np.array([1 - s, s])
    assert out[0, 0] == pytest.approx(3.0 * expected, rel=1e-5)


def test_a_grain_is_the_cell_of_the_nearest_point() -> None:
    cell = 0.01
    x, y = grid(0.2, -0.3, 0.0007, 24)
    out = np.zeros(x.shape, dtype=np.float32)

    add_grains(out, x, y, GrainLayer(cell, 5.0, gap_width=1e-6), SEED)

    for row, col in ((0, 0), (5, 17), (23, 2), (11, 11)):
        assert out[row, col] == pytest.approx(nearest_tone(x[row, col] / cell, y[row, col] / cell), abs=1e-4)


def nearest_tone(u: float, v: float) -> float:
    points = []
    for i in range(math.floor(u) - 2, math.floor(u) + 3):
        for j in range(math.floor(v) - 2, math.floor(v) + 3):
            h = np.uint64(hash2(i, j, SEED))
            px = i + 0.5 + (unit_of(h) - 0.5) * 0.9
            h = np.uint64(mix_bits(h))
            py = j + 0.5 + (unit_of(h) - 0.5) * 0.9
            points.append((math.hypot(u - px, v - py), 5.0 * normal_of(np.uint64(mix_bits(h)))))
    return min(points)[1]


def test_specks_cover_the_share_they_are_told() -> None:
    canvas = Canvas(*grid(0.0, 0.0, 2.5e-4, 800), 3, 0.0)

    canvas.specks(0.01, 0.3, 50.0, radius=0.5)

    # a disc of radius r covers pi r^2 of its cell; r is uniform between 0.125 and 0.5, so r^2 is 0.109 on average
    assert (canvas.grey > 0).mean() == pytest.approx(0.3 * math.pi * 0.109, rel=0.12)


def test_planks_are_as_long_and_wide_as_they_are_told() -> None:
    canvas = Canvas(*grid(0.0, 0.0, 1e-3, 600), 3, 0.0)

    tones = canvas.planks(0.2, 0.1, 10.0, shift=0.5).grey

    np.testing.assert_array_equal(tones[:99, :199], tones[0, 0])
    assert tones[0, 250] != tones[0, 0]
    assert tones[150, 0] == tones[150, 95]  # shifted by half a plank
    assert tones[150, 0] != tones[150, 150]


def test_joints_need_planks() -> None:
    with pytest.raises(ValueError, match="call planks first"):
        Canvas(*grid(0.0, 0.0, 1e-3, 8), 3, 0.0).joints(0.001, -10.0)


def test_a_turned_grid_turns_the_floor() -> None:
    x, y = grid(1.0, 2.0, 0.1, 4, math.pi / 2)

    # the floor's x axis points along the map's y axis
    np.testing.assert_allclose([x[0, 0], y[0, 0]], [2.0, -1.0], atol=1e-12)
    np.testing.assert_allclose([x[3, 0], y[3, 0]], [2.3, -1.0], atol=1e-12)
