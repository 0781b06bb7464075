"""The laws of path tracking: what the paper proves, and small errors by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark_controllers.tracking_laws import BesidePath, approach_angle, slide, steer_both_axles, turn_per_way

L0 = 0.45


def run_frenet(l: float, theta: float, bend: float, steps: int = 6000, ds: float = 1e-3) -> np.ndarray:  # noqa: E741
    """Integrate offset and heading over the way driven, in the coordinates of Serret and Frenet."""
    rows = []
    for _ in range(steps):
        rows.append((l, theta))
        turn = turn_per_way(BesidePath(l, theta, -theta, bend), L0)
        along = math.cos(theta) / (1.0 - l * bend)
        l, theta = l + math.sin(theta) * ds, theta + (turn - bend * along) * ds  # noqa: E741
    return np.array(rows)


@pytest.mark.parametrize(
    ("offset_m", "heading_rad", "bend"), [(0.5, 0.3, 0.0), (-0.8, -1.2, 0.0), (0.3, 2.0, 0.5), (0.1, -3.0, -1.0)]
)
def test_the_papers_lyapunov_function_never_grows(offset_m: float, heading_rad: float, bend: float) -> None:
    l, theta = run_frenet(offset_m, heading_rad, bend).T  # noqa: E741
    gamma = 0.25 / L0**2
    value = l**2 / 2 + (theta - np.array([approach_angle(each, L0) for each in l])) ** 2 / (2 * gamma)

    assert np.all(np.diff(value) <= 1e-6)
    assert value[-1] < 1e-6


def test_small_offsets_vanish_critically_damped() -> None:
    l = run_frenet(1e-3, 0.0, 0.0)[:, 0]  # noqa: E741
    s = np.arange(len(l)) * 1e-3
    rate = 1.5 / L0

    np.testing.assert_allclose(l, 1e-3 * (1 + rate * s) * np.exp(-rate * s), atol=5e-6)  # 5 um


def test_on_the_path_the_taught_bend_is_driven() -> None:
    assert turn_per_way(BesidePath(0.0, 0.0, 0.0, 0.8), L0) == pytest.approx(0.8)


def test_a_sliding_robot_goes_back_to_the_path_and_turns_to_the_taught_heading() -> None:
    wanted = slide(BesidePath(0.01, 0.1, -0.1, 0.0), 0.5, L0)

    course_rad = math.atan2(wanted.left_mps, wanted.forward_mps) + 0.1  # seen from the path
    assert math.hypot(wanted.forward_mps, wanted.left_mps) == pytest.approx(0.5)
    assert course_rad == pytest.approx(-0.01 * 1.5 / L0, rel=0.01)
    assert wanted.yaw_radps == pytest.approx(-0.1 * 0.5 * 1.5 / L0)


@pytest.mark.parametrize("path_in_body_rad", [0.0, math.pi])
def test_both_axles_steer_the_same_way_against_an_offset(path_in_body_rad: float) -> None:
    steered = steer_both_axles(BesidePath(0.02, 0.0, path_in_body_rad, 0.0), 0.5, L0, wheelbase_m=0.5, limit_rad=0.3)

    assert steered.front_rad == pytest.approx(steered.rear_rad)
    assert steered.front_rad == pytest.approx(-0.02 * 1.5 / L0, rel=0.01)
    assert steered.speed_mps == (0.5 if path_in_body_rad == 0.0 else -0.5)


def test_both_axles_steer_against_each_other_in_a_bend() -> None:
    steered = steer_both_axles(BesidePath(0.0, 0.0, 0.0, 1.0), 0.5, L0, wheelbase_m=0.5, limit_rad=0.4)

    assert math.tan(steered.front_rad) == pytest.approx(0.25)  # bend * wheelbase / 2
    assert steered.rear_rad == pytest.approx(-steered.front_rad)


def test_full_lock_is_never_exceeded() -> None:
    steered = steer_both_axles(BesidePath(1.0, 1.0, -1.0, 2.0), 0.5, L0, wheelbase_m=0.5, limit_rad=0.3)

    assert max(abs(steered.front_rad), abs(steered.rear_rad)) <= 0.3
