"""Vehicles against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.commands import Command, Steer4WS, Stop, Velocity
from trailmark.errors import ConfigError
from trailmark.geometry import Pose2, Twist2
from trailmark_sim.vehicles import (
    Ackermann,
    Differential,
    FourWheelSteering,
    Holonomic,
    SkidSteer,
    Vehicle,
    VehicleState,
    WheelErrors,
)

EXACT = WheelErrors(0.0, 0.0, 0.0, 0.0)
LIMIT = math.radians(18.3)


def drive(vehicle: Vehicle, command: Command, duration_s: float, state: VehicleState | None = None) -> VehicleState:
    state = state or VehicleState()
    for _ in range(round(duration_s / 0.004)):
        state = vehicle.step(state, command, 0.004)
    return state


def test_opposite_full_steering_turns_with_the_papers_radius() -> None:
    vehicle = FourWheelSteering(steer_lag_s=0.0, speed_lag_s=0.0)

    half = drive(vehicle, Steer4WS(LIMIT, -LIMIT, 0.25), math.pi * 0.75 / 0.25)

    assert vehicle.wheelbase_m == pytest.approx(0.496, abs=5e-4)
    assert half.pose_map_base.y == pytest.approx(2 * 0.75, abs=1e-3)  # half a circle: its diameter aside
    assert half.pose_map_base.x == pytest.approx(0.0, abs=2e-3)


def test_equal_steering_drives_sideways_without_turning() -> None:
    vehicle = FourWheelSteering(steer_lag_s=0.0, speed_lag_s=0.0)

    state = drive(vehicle, Steer4WS(0.2, 0.2, 0.3), 2.0)

    assert state.pose_map_base.theta == pytest.approx(0.0, abs=1e-12)
    assert math.atan2(state.pose_map_base.y, state.pose_map_base.x) == pytest.approx(0.2)
    assert state.pose_map_base.x == pytest.approx(0.6)  # the speed is the one along x


def test_steering_beyond_the_limit_is_the_limit() -> None:
    vehicle = FourWheelSteering()

    far, full = (drive(vehicle, Steer4WS(angle, -angle, 0.3), 1.0) for angle in (1.0, LIMIT))

    assert far == full


def test_servos_lag_as_an_exponential() -> None:
    vehicle = FourWheelSteering(steer_lag_s=0.1)

    state = drive(vehicle, Steer4WS(0.3, -0.1, 0.0), 0.1)

    assert state.front_rad == pytest.approx(0.3 * (1.0 - math.exp(-1.0)))
    assert state.rear_rad == pytest.approx(-0.1 * (1.0 - math.exp(-1.0)))


def test_speed_lags_and_the_way_is_its_integral() -> None:
    vehicle = FourWheelSteering(speed_lag_s=0.2, max_speed_mps=1.0)

    state = drive(vehicle, Steer4WS(0.0, 0.0, 0.5), 1.0)

    assert state.twist.forward_mps == pytest.approx(0.5 * (1.0 - math.exp(-5.0)))
    assert state.pose_map_base.x == pytest.approx(0.5 * (1.0 - 0.2 * (1.0 - math.exp(-5.0))))


def test_stop_rolls_on_by_speed_times_lag_and_keeps_the_wheels_turned() -> None:
    vehicle = FourWheelSteering(speed_lag_s=0.15)
    driving = drive(vehicle, Steer4WS(0.1, -0.1, 0.4), 3.0)

    stopped = drive(vehicle, Stop("here"), 3.0, driving)

    assert stopped.travelled_m - driving.travelled_m == pytest.approx(0.4 * 0.15, rel=1e-3)
    assert stopped.front_rad == pytest.approx(driving.front_rad)
    assert abs(stopped.twist.forward_mps) < 1e-6


def test_an_asymmetric_linkage_turns_tighter_to_the_left() -> None:
    vehicle = FourWheelSteering(asymmetry=0.1, steer_lag_s=0.0, speed_lag_s=0.0)

    left = drive(vehicle, Steer4WS(0.1, -0.1, 0.3), 2.0).pose_map_base.theta
    right = drive(vehicle, Steer4WS(-0.1, 0.1, 0.3), 2.0).pose_map_base.theta

    # one wheel pair of each turn is stronger by 10 %, the other weaker: the sum of tangents is what turns
    assert left == pytest.approx(-right)
    sideways = drive(vehicle, Steer4WS(0.1, -0.1, 0.3), 0.5).twist.left_mps
    assert sideways == pytest.approx(0.3 * (math.tan(0.11) - math.tan(0.09)) / 2.0)
    crab_left = drive(vehicle, Steer4WS(0.1, 0.1, 0.3), 1.0).pose_map_base.y
    crab_right = drive(vehicle, Steer4WS(-0.1, -0.1, 0.3), 1.0).pose_map_base.y
    assert crab_left / -crab_right == pytest.approx(math.tan(0.11) / math.tan(0.09))


def test_trims_turn_a_vehicle_that_is_told_to_go_straight_and_its_wheels_do_not_know() -> None:
    vehicle = FourWheelSteering(front_trim_rad=0.01, steer_lag_s=0.0, wheel_errors=EXACT)

    state = drive(vehicle, Steer4WS(0.0, 0.0, 0.3), 5.0)

    assert state.pose_map_base.theta > 0.02
    assert state.pose_start_wheels.theta == 0.0


def test_a_differential_drive_turns_with_the_radius_of_its_command() -> None:
    vehicle = Differential(speed_lag_s=0.0)

    state = drive(vehicle, Velocity(0.2, 0.0, 0.4), math.pi / 0.4)

    np.testing.assert_allclose(state.pose_map_base.array()[:2], [0.0, 2 * 0.5], atol=1e-3)


def test_a_differential_drive_too_fast_for_its_wheels_keeps_its_curvature() -> None:
    vehicle = Differential(speed_lag_s=0.0)

    state = vehicle.step(VehicleState(), Velocity(0.3, 0.5, 1.0), 0.004)

    twist = state.twist
    assert twist.left_mps == 0.0  # sideways it cannot go
    assert twist.forward_mps + twist.yaw_radps * vehicle.track_m / 2.0 == pytest.approx(0.3)
    assert twist.yaw_radps / twist.forward_mps == pytest.approx(1.0 / 0.3)


def test_a_skidding_vehicle_turns_less_than_its_wheels_say_and_slides() -> None:
    vehicle = SkidSteer(speed_lag_s=0.0, wheel_errors=EXACT, turn_share=0.6, icr_forward_m=0.05)

    state = drive(vehicle, Velocity(0.0, 0.0, 0.5), 1.0)

    assert state.pose_map_base.theta == pytest.approx(0.3)
    assert state.pose_start_wheels.theta == pytest.approx(0.5)
    assert state.twist.left_mps == pytest.approx(-0.05 * 0.3)


def test_a_holonomic_vehicle_is_limited_along_its_direction() -> None:
    vehicle = Holonomic(speed_lag_s=0.0)

    twist = vehicle.step(VehicleState(), Velocity(3.0, 4.0, 9.0), 0.004).twist

    assert twist == Twist2(pytest.approx(0.6), pytest.approx(0.8), 1.5)


def test_wheels_err_by_scale_and_slip() -> None:
    errors = WheelErrors(scale=0.01, turn_scale=0.02, slip_m=0.01, slip_rad=0.02)
    vehicle = Differential(speed_lag_s=0.0, max_speed_mps=1.0, wheel_errors=errors)
    rng = np.random.default_rng(7)

    ends = []
    for _ in range(200):
        state = VehicleState()
        for slip in rng.standard_normal((25, 2)):
            state = vehicle.step(state, Velocity(0.4), 0.1, (float(slip[0]), float(slip[1])))
        ends.append((state.wheels_m, state.pose_start_wheels.theta))

    distance, turn = np.array(ends).T
    assert distance.mean() == pytest.approx(1.01, abs=0.003)
    assert distance.std() == pytest.approx(0.01, rel=0.2)
    assert turn.std() == pytest.approx(0.02, rel=0.2)


def test_acceleration_includes_the_pull_of_a_turn() -> None:
    vehicle = Differential(speed_lag_s=0.0)
    steady = drive(vehicle, Velocity(0.2, 0.0, 0.5), 1.0)

    assert steady.left_mps2 == pytest.approx(0.2 * 0.5)
    assert steady.forward_mps2 == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("vehicle", "command"),
    [(FourWheelSteering(), Velocity(0.1)), (Differential(), Steer4WS(0, 0, 0.1)), (Holonomic(), Steer4WS(0, 0, 0.1))],
)
def test_a_command_that_is_not_understood_is_refused(vehicle: Vehicle, command: Command) -> None:
    assert type(command) not in vehicle.accepts
    with pytest.raises(ConfigError, match="cannot follow"):
        vehicle.step(VehicleState(), command, 0.004)


@given(
    front=st.floats(-0.3, 0.3), rear=st.floats(-0.3, 0.3), speed=st.floats(-0.4, 0.4), n=st.sampled_from([1, 2, 5, 10])
)
def test_longer_steps_lead_to_the_same_place(front: float, rear: float, speed: float, n: int) -> None:
    vehicle = replace(FourWheelSteering(), wheel_errors=EXACT)
    fine = coarse = VehicleState(Pose2(1.0, 2.0, 0.3))

    for _ in range(100):
        fine = vehicle.step(fine, Steer4WS(front, rear, speed), 0.004)
    for _ in range(100 // n):
        coarse = vehicle.step(coarse, Steer4WS(front, rear, speed), 0.004 * n)

    assert coarse.pose_map_base.distance_to(fine.pose_map_base) < 3e-4  # 0.3 mm after 0.4 s
    assert coarse.front_rad == pytest.approx(fine.front_rad)
    assert coarse.twist.forward_mps == pytest.approx(fine.twist.forward_mps, abs=1e-12)


@given(speed=st.floats(0.05, 0.3), yaw=st.floats(-0.6, 0.6))
def test_driving_back_the_same_way_returns(speed: float, yaw: float) -> None:
    vehicle = Differential(speed_lag_s=0.0)

    there = drive(vehicle, Velocity(speed, 0.0, yaw), 2.0)
    back = drive(vehicle, Velocity(-speed, 0.0, -yaw), 2.0, there)

    assert back.pose_map_base.distance_to(Pose2()) < 1e-9
    assert back.wheels_m == pytest.approx(0.0, abs=1e-9)
    assert back.travelled_m == pytest.approx(2 * there.travelled_m)


def test_an_ackermann_vehicle_turns_about_a_point_beside_its_rear_axle() -> None:
    car = Ackermann(steer_lag_s=0.0, speed_lag_s=0.0, wheel_errors=EXACT)

    half = drive(car, Velocity(0.5, 0.0, 0.5), math.pi / 0.5)  # a circle of 1 m

    assert half.pose_map_base.y == pytest.approx(2.0, abs=1e-2)
    assert half.front_rad == pytest.approx(math.atan(0.36))
    assert half.pose_start_wheels.distance_to(half.pose_map_base) < 1e-9


def test_an_ackermann_vehicle_turns_no_sharper_than_its_full_lock() -> None:
    car = Ackermann(steer_lag_s=0.0, speed_lag_s=0.0)

    turned = drive(car, Velocity(-0.3, 0.0, 9.0), 1.0)

    assert turned.twist.yaw_radps == pytest.approx(0.3 / car.min_turning_radius_m)
    assert car.min_turning_radius_m == pytest.approx(0.677, abs=1e-3)


def test_an_ackermann_vehicle_that_stands_keeps_its_steering_and_does_not_turn() -> None:
    state = VehicleState(front_rad=0.2)

    for command in (Velocity(0.0, 0.5, 1.0), Stop("")):
        stood = drive(Ackermann(), command, 0.5, state)
        assert stood.front_rad == pytest.approx(0.2)
        assert stood.pose_map_base == Pose2()
