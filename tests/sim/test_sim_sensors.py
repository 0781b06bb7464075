"""Wheel odometry, inertial unit, ambient light."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.geometry import Pose2, Pose3, Twist2
from trailmark_sim.sensors.imu import ImuSensor
from trailmark_sim.sensors.light import LightSensor
from trailmark_sim.sensors.odometry import WheelOdometry
from trailmark_sim.vehicles import VehicleState

QUIET = {"gyro_noise": 0.0, "gyro_bias": 0.0, "accel_noise": 0.0, "accel_bias": 0.0}


def test_wheels_say_what_the_vehicle_integrated() -> None:
    state = VehicleState(pose_start_wheels=Pose2(1.0, 0.2, 0.1), wheels_m=-0.4, twist=Twist2(0.3))

    reading = WheelOdometry().render(0, 0.0, state)

    assert (reading.pose_start_base, reading.distance_m, reading.twist) == (Pose2(1.0, 0.2, 0.1), -0.4, Twist2(0.3))


def test_an_imu_feels_gravity_and_the_pull_of_a_turn() -> None:
    state = VehicleState(twist=Twist2(0.5, 0.0, 0.4), forward_mps2=0.1, left_mps2=0.2)

    reading = ImuSensor(**QUIET).render(0, 0.0, state)

    np.testing.assert_allclose(reading.angular_velocity_radps, [0.0, 0.0, 0.4])
    np.testing.assert_allclose(reading.linear_acceleration_mps2, [0.1, 0.2, 9.80665])


def test_an_imu_away_from_the_middle_feels_the_turning() -> None:
    state = VehicleState(twist=Twist2(0.0, 0.0, 2.0), yaw_radps2=3.0)

    reading = ImuSensor(mounting=Pose3(x=0.1, y=0.2), **QUIET).render(0, 0.0, state)

    # -omega^2 r and alpha x r
    np.testing.assert_allclose(reading.linear_acceleration_mps2, [-0.4 - 0.6, -0.8 + 0.3, 9.80665])


def test_an_imu_mounted_on_its_side_turns_about_another_axis() -> None:
    state = VehicleState(twist=Twist2(0.0, 0.0, 0.4))

    reading = ImuSensor(mounting=Pose3(roll=math.pi / 2), **QUIET).render(0, 0.0, state)

    np.testing.assert_allclose(reading.angular_velocity_radps, [0.0, 0.4, 0.0], atol=1e-12)
    np.testing.assert_allclose(reading.linear_acceleration_mps2, [0.0, 9.80665, 0.0], atol=1e-12)


def test_an_imu_has_a_bias_that_stays_and_noise_that_does_not() -> None:
    sensor = ImuSensor(seed=5)

    rates = np.array([sensor.render(k, 0.0, VehicleState()).angular_velocity_radps for k in range(500)])

    np.testing.assert_allclose(rates.std(axis=0), sensor.gyro_noise, rtol=0.12)
    assert np.abs(rates.mean(axis=0)).max() > sensor.gyro_noise / 5
    np.testing.assert_array_equal(sensor.render(3, 0.0, VehicleState()).angular_velocity_radps, rates[3])


def test_a_light_sensor_reads_the_light_of_the_place() -> None:
    sensor = LightSensor(lambda pose, stamp_s: 100.0 + pose.x, noise=0.02)

    levels = [sensor.render(k, 0.0, VehicleState(Pose2(900.0))).value for k in range(400)]

    assert np.mean(levels) == pytest.approx(1000.0, abs=4.0)
    assert np.std(levels) == pytest.approx(20.0, rel=0.15)
    assert all(level == round(level) for level in levels)
