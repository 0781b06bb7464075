"""All numbers at once: known answers, what a drive cannot tell, outliers, swapped wheels."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from tests.calibration.conftest import BELIEVED, RIGHT, errors_of, numbers, pairs_from

from trailmark.errors import DataError
from trailmark.estimates import Fix, Lost, Motion, information_from_sigmas
from trailmark.geometry import Pose2
from trailmark_calibration.checking import calibrate
from trailmark_calibration.fitting import LIMITS, fit
from trailmark_calibration.model import BIAS, DELAY, NAMES, TURN, TURN_PER_M, WAY, YAW, X, Y, pairs_of
from trailmark_calibration.simulating import DriveNoise, draw_truth, simulate
from trailmark_calibration.solver import GaussNewton
from trailmark_calibration.starting import correlated_delay
from trailmark_calibration.tracks import track_of

NOISELESS = DriveNoise(way=1e-6, turn=1e-6, sensor_m=1e-6, sensor_rad=1e-6, outliers=0.0)
OURS = [WAY, TURN, TURN_PER_M, X, Y, YAW, DELAY]


def test_an_ordinary_drive_tells_all_numbers_within_their_uncertainty(mixed):
    found = fit(*pairs_from(mixed))

    assert found.is_told[OURS].all()
    assert (np.abs(errors_of(found, RIGHT)) < 3.5 * found.sigmas)[OURS].all()
    assert found.sigmas[X] < 0.004
    assert found.sigmas[YAW] < math.radians(0.2)
    assert found.sigmas[DELAY] < 0.003


def test_without_noise_the_numbers_are_exact():
    drive = simulate(np.random.default_rng(3), RIGHT, BELIEVED, duration_s=60.0, noise=NOISELESS)

    errors = errors_of(fit(*pairs_from(drive)), RIGHT)

    # What is left is of reading 20 Hz between its stamps.
    assert np.abs(errors[[WAY, TURN, TURN_PER_M]]).max() < 5e-4
    assert np.abs(errors[[X, Y, YAW, DELAY]]).max() < 5e-4


@pytest.mark.parametrize("seed", range(2))
def test_stated_uncertainty_is_that_of_drawn_drives(seed):
    rng = np.random.default_rng(100 + seed)
    truth, believed = draw_truth(rng)
    found = fit(*pairs_from(simulate(rng, truth, believed, duration_s=90.0)))

    assert (np.abs(errors_of(found, truth)) < 4.0 * found.sigmas)[OURS].all()


def test_a_straight_drive_tells_yaw_and_way_and_no_place(straight):
    found = fit(*pairs_from(straight))

    assert found.is_told[[WAY, YAW]].all()
    assert not found.is_told[[TURN, X, Y]].any()
    assert (np.abs(errors_of(found, RIGHT)) < 4.0 * found.sigmas)[[WAY, YAW]].all()


def test_a_circle_tells_neither_scales_nor_place():
    drive = simulate(np.random.default_rng(4), RIGHT, BELIEVED, duration_s=60.0, course="circle")

    found = fit(*pairs_from(drive))

    assert not found.is_told[[WAY, TURN, TURN_PER_M, X, Y, DELAY]].any()


def test_outliers_are_left_out_and_counted():
    clean = simulate(np.random.default_rng(5), RIGHT, BELIEVED, duration_s=120.0, noise=DriveNoise(outliers=0.0))
    wild = simulate(np.random.default_rng(5), RIGHT, BELIEVED, duration_s=120.0, noise=DriveNoise(outliers=0.02))

    few, many = fit(*pairs_from(clean)), fit(*pairs_from(wild))

    assert few.n_outliers <= 3
    assert 10 <= many.n_outliers <= 40  # each of about 23 wrong motions spoils one interval
    assert (np.abs(errors_of(many, RIGHT)) < 4.0 * many.sigmas)[OURS].all()
    assert (many.sigmas < 2.0 * few.sigmas)[OURS].all()


def test_localizers_that_have_nothing_in_common_are_refused(mixed):
    other = simulate(np.random.default_rng(99), RIGHT, BELIEVED, duration_s=120.0)
    pairs, known = pairs_from(replace(mixed, sensor=other.sensor))

    with pytest.raises(DataError, match="do not move as one body"):
        fit(pairs, known)


def test_swapped_wheels_are_a_negative_scale_of_turns():
    right = numbers(way=1.0, turn=-1.0, x=0.2)
    found = fit(*pairs_from(simulate(np.random.default_rng(6), right, np.array([0.2, 0.0, 0.0]), duration_s=120.0)))

    assert found.is_told[TURN]
    assert abs(found.values[TURN] + 1.0) < 3.5 * found.sigmas[TURN]


def test_a_sensor_the_other_way_round_is_found_half_a_turn_off():
    right = numbers(yaw=math.pi - 0.02)
    found = fit(*pairs_from(simulate(np.random.default_rng(9), right, np.zeros(3), duration_s=120.0)))

    assert found.is_told[YAW]
    assert abs(math.remainder(found.values[YAW] - right[YAW], 2 * math.pi)) < 3.5 * found.sigmas[YAW]
    assert found.values[WAY] > 0.9


def test_a_short_drive_is_refused():
    drive = simulate(np.random.default_rng(1), RIGHT, BELIEVED, duration_s=10.0)

    with pytest.raises(DataError, match="too short"):
        pairs_from(drive)


def test_a_robot_that_stands_still_is_refused():
    still = [Motion(0.1 * k, 0.1 * k + 0.1, Pose2(), information_from_sigmas(0.01, 0.01, 0.01)) for k in range(600)]

    with pytest.raises(DataError, match="the robot moves in 0"):
        pairs_of(track_of("a", still), track_of("b", still), 0.5)


def test_the_delay_is_found_between_two_samples(mixed):
    a, b = track_of("wheels", mixed.wheels), track_of("sensor", mixed.sensor)

    assert correlated_delay(a, b, 1.0) == pytest.approx(0.08, abs=0.01)
    assert correlated_delay(b, a, 1.0) == pytest.approx(-0.08, abs=0.01)


def test_a_straight_drive_has_no_peak(straight):
    a, b = track_of("wheels", straight.wheels), track_of("sensor", straight.sensor)

    assert correlated_delay(a, b, 1.0) is None


def test_a_gyro_tells_turns_and_delay_and_nothing_of_the_way(mixed):
    gyro = [
        Motion(m.since_s, m.stamp_s, Pose2(0.0, 0.0, m.pose_since_now.theta), np.diag([0.0, 0.0, 1e6]))
        for m in mixed.sensor
    ]
    biased = [
        replace(m, pose_since_now=Pose2(0.0, 0.0, m.pose_since_now.theta + 0.01 * (m.stamp_s - m.since_s)))
        for m in gyro
    ]

    found = fit(*pairs_from(replace(mixed, sensor=biased)))

    assert found.is_told[[TURN, DELAY]].all()
    assert not found.is_told[[WAY, X, Y, YAW]].any()
    assert abs(found.values[TURN] - RIGHT[TURN]) < 4.0 * found.sigmas[TURN]
    assert abs(found.values[BIAS] - 0.01) < 4.0 * found.sigmas[BIAS]


def test_fixes_tell_motion_too(mixed):
    pose, fixes = Pose2(3.0, 1.0, 0.7), []
    for motion in mixed.sensor[::1]:
        pose = pose @ motion.pose_since_now
        fixes.append(Fix(motion.stamp_s, pose, information_from_sigmas(0.003, 0.003, 0.002)))

    found = fit(*pairs_from(replace(mixed, sensor=fixes[::3])))

    assert found.is_told[[WAY, TURN, YAW]].all()
    assert (np.abs(errors_of(found, RIGHT)) < 4.0 * found.sigmas)[OURS].all()


def test_who_is_always_lost_tells_no_motion():
    with pytest.raises(DataError, match=r"'laser' tells no motion on this drive: .* but Lost"):
        track_of("laser", [Lost(1.0, "dark")])


def test_known_wheels_tell_both_radii_and_the_track():
    rng, track_m = np.random.default_rng(12), 0.5
    drive = simulate(rng, RIGHT, BELIEVED, duration_s=60.0, noise=NOISELESS)
    pairs, _ = pairs_from(drive, track_m=track_m)
    left, right, wider = 0.98, 1.01, 1.05  # factors of both radii and of the track

    numbers_of = numbers(
        way=(left + right) / 2,
        turn=(left + right) / 2 / wider,
        turn_per_m=(right - left) / (track_m * wider),
    )
    by_wheels = np.array([0.3, 0.4])  # what the wheels roll by nominal radii
    forward, turn = by_wheels.mean(), (by_wheels[1] - by_wheels[0]) / track_m
    truly = by_wheels * (left, right)
    expected = [truly.mean(), 0.0, (truly[1] - truly[0]) / (track_m * wider)]

    np.testing.assert_allclose(pairs.matrix(numbers_of) @ [forward, 0.0, turn], expected, atol=1e-12)


def test_the_halves_are_tried_on_each_other(mixed):
    pairs, known = pairs_from(mixed)

    found = calibrate(pairs, known, (WAY, TURN, TURN_PER_M))

    assert found.check is not None
    assert found.check.after[0] < 0.5 * found.check.before[0]
    assert found.check.after[1] < 0.5 * found.check.before[1]
    assert not found.contradictions


def test_wheels_that_change_in_the_middle_are_seen_and_make_the_numbers_wider(mixed):
    grown = RIGHT.copy()
    grown[WAY] *= 1.03
    other = simulate(np.random.default_rng(7), grown, BELIEVED, duration_s=120.0)
    half = len(mixed.wheels) // 2
    pairs, known = pairs_from(replace(mixed, wheels=[*mixed.wheels[:half], *other.wheels[half:]]))

    found = calibrate(pairs, known, (WAY,))

    assert WAY in found.contradictions
    assert 2.0 * found.fit.sigmas[WAY] > 0.01


def test_without_intervals_no_direction_is_told_and_nothing_is_divided_by_none(mixed):
    pairs, _ = pairs_from(mixed)
    solver = GaussNewton(pairs, numbers(), np.ones(len(NAMES)))

    found = solver.solve(numbers(), np.zeros(len(pairs.residuals(numbers())), dtype=bool))

    assert found == pytest.approx(numbers())


def test_limits_are_in_the_order_of_the_names():
    assert len(LIMITS) == len(NAMES)
