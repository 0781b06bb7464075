"""Points on walls, and what matching to them tells."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.arrays import Floats
from trailmark.geometry.walls import (
    limited_information,
    line_equations,
    main_axes,
    measured_information,
    measured_step,
    move_to_lines,
)

ANGLES = np.linspace(0.0, 2.0 * math.pi, 40, endpoint=False)


def equations(arms: Floats, offsets: Floats, normals: Floats, corner: float = 1.0) -> tuple[Floats, Floats, float, int]:
    hessian, gradient = np.full((3, 3), np.nan), np.full(3, np.nan)
    squared, n_lines = line_equations(arms, offsets, normals, corner, hessian, gradient)
    return hessian, gradient, squared, n_lines


def test_the_kernel_equals_its_plain_twin() -> None:
    rng = np.random.default_rng(2)
    arms, offsets = rng.normal(0.0, 3.0, (30, 2)), rng.normal(0.0, 0.1, (30, 2))
    turns = rng.uniform(-3.0, 3.0, 30)
    normals = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    normals[::7] = 0.0
    hessian, gradient, squared, n_lines = equations(arms, offsets, normals, 0.08)

    used = np.abs(normals).sum(axis=1) > 0
    rows = np.column_stack([normals, normals[:, 1] * arms[:, 0] - normals[:, 0] * arms[:, 1]])[used]
    residuals = (offsets * normals).sum(axis=1)[used]
    weights = np.minimum(1.0, 0.08 / np.maximum(np.abs(residuals), 1e-300))
    np.testing.assert_allclose(hessian, (rows * weights[:, None]).T @ rows, atol=1e-12)
    np.testing.assert_allclose(gradient, (rows * weights[:, None]).T @ residuals, atol=1e-12)
    assert squared == pytest.approx(float(residuals @ residuals))
    assert n_lines == used.sum() == 25


def test_a_step_leads_back_to_a_round_wall() -> None:
    points = np.stack([3.0 * np.cos(ANGLES), 2.0 * np.sin(ANGLES)], axis=1)
    normals = np.stack([np.cos(ANGLES) / 3.0, np.sin(ANGLES) / 2.0], axis=1)
    normals /= np.hypot(*normals.T)[:, None]
    moved = np.array([0.01, -0.02, 0.003])
    offsets = np.stack([moved[0] - moved[2] * points[:, 1], moved[1] + moved[2] * points[:, 0]], axis=1)
    hessian, gradient, _, n_lines = equations(points, offsets, normals)

    np.testing.assert_allclose(measured_step(hessian, gradient, n_lines), moved, atol=1e-12)


@pytest.mark.parametrize("turn", [0.0, 0.3, 1.2])
def test_a_slanting_corridor_holds_the_step_along_it_and_tells_exactly_nothing_of_it(turn: float) -> None:
    along, across = np.array([math.cos(turn), math.sin(turn)]), np.array([-math.sin(turn), math.cos(turn)])
    stations = np.linspace(-5.0, 5.0, 40)
    arms = np.concatenate([stations[:, None] * along + across, stations[:, None] * along - across])
    tilt = np.random.default_rng(4).normal(0.0, 0.08, 80)  # normals are never exact
    normals = np.cos(tilt)[:, None] * across + np.sin(tilt)[:, None] * along
    hessian, gradient, _, n_lines = equations(arms, np.tile(0.05 * across + 0.4 * along, (80, 1)), normals)

    assert along @ measured_step(hessian, gradient, n_lines)[:2] == pytest.approx(0.0, abs=5e-3)
    information = measured_information(hessian, n_lines)
    assert np.linalg.eigvalsh(information)[0] == pytest.approx(0.0, abs=1e-9)
    assert across @ information[:2, :2] @ across > 70.0


def test_main_axes_are_those_of_the_scatter() -> None:
    points = np.stack([np.linspace(-1, 1, 21), 0.5 * np.linspace(-1, 1, 21)], axis=1)
    xx, yy = points.var(axis=0)
    normals, thin, long = main_axes(*(np.array([value]) for value in (xx, yy, (points[:, 0] * points[:, 1]).mean())))
    assert abs(normals[0] @ [2.0, 1.0]) < 1e-12
    assert thin[0] == pytest.approx(0.0, abs=1e-12)
    assert long[0] == pytest.approx(xx + yy)


def test_information_is_limited_and_its_free_direction_stays_free() -> None:
    limited = limited_information(np.diag([1e9, 0.0, 1e9]), (0.01, 0.002))
    np.testing.assert_allclose(np.sqrt(1.0 / np.diag(limited)[[0, 2]]), [0.01, 0.002], rtol=1e-2)
    assert limited[1, 1] == 0.0


def test_points_of_a_smeared_wall_are_moved_onto_its_middle() -> None:
    along_m = np.linspace(0.0, 1.0, 60)
    smear_m = np.where(np.arange(60) % 2 == 0, 0.01, -0.01)
    points = np.concatenate([np.stack([along_m, smear_m], axis=1), [[5.0, 5.0]]])

    moved, normals = move_to_lines(points, np.ones(61), radius_m=0.2, n_neighbours=24, thin_ratio=0.15)

    np.testing.assert_allclose(moved[12:48, 1], 0.0, atol=2e-3)  # from 10 mm
    np.testing.assert_allclose(np.abs(normals[12:48, 1]), 1.0, atol=1e-2)
    np.testing.assert_array_equal(moved[60], points[60])  # alone, it lies on no line
    np.testing.assert_array_equal(normals[60], 0.0)
