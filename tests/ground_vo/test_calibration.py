"""Scale, heading and lever arm from the motions of a drive: known answers, their uncertainty, and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from trailmark.errors import DataError
from trailmark.geometry import Pose2
from trailmark_ground_vo.calibration import Assumed, Known, Steps, calibrate, moves_of

RATE_HZ, PIXEL_M = 70.0, 4.0e-4
ASSUMED = Assumed((PIXEL_M, PIXEL_M))


def rest(n=40):
    return [Pose2()] * n


def line(length_m, n=120, wobble_rad=0.0, angle_rad=0.0):
    """Base drives `length_m` in the direction `angle_rad` of its own axes; it may wobble on the way."""
    step = length_m / n
    turns = wobble_rad * np.cos(2 * np.pi * (np.arange(n) + 0.5) / 20)
    return [Pose2.exp(step * math.cos(angle_rad), step * math.sin(angle_rad), turn) for turn in turns]


def turn(angle_rad, n=200):
    return [Pose2(0.0, 0.0, angle_rad / n)] * n


def seen(moves, mounting, scale=(1.0, 1.0), noise_px=0.0, seed=0):
    """Steps of a camera at `mounting`, as a tracker sees them that believes pixels `scale` times as large."""
    rng = np.random.default_rng(seed)
    camera = [mounting.inverse() @ move @ mounting for move in moves]
    count = len(camera)
    stamps = np.arange(count + 1) / RATE_HZ
    x = np.array([step.x for step in camera]) * scale[0] + rng.normal(0, noise_px * PIXEL_M, count)
    y = np.array([step.y for step in camera]) * scale[1] + rng.normal(0, noise_px * PIXEL_M, count)
    theta = np.array([step.theta for step in camera]) + rng.normal(0, noise_px / 150, count)
    variance = np.full(count, (noise_px * PIXEL_M) ** 2)
    return Steps(stamps[:-1], stamps[1:], x, y, theta, variance)


def without_pictures(steps, first, n):
    """The same motions where `n` pictures from `first` on gave no step: the next step spans them."""
    kept = np.delete(np.arange(len(steps)), slice(first, first + n))
    sums = {name: getattr(steps, name).copy() for name in ("x", "y", "theta", "variance")}
    for values in sums.values():
        values[first + n] = values[first : first + n + 1].sum()
    since_s = steps.since_s.copy()
    since_s[first + n] = since_s[first]
    return Steps(since_s[kept], steps.stamp_s[kept], *(values[kept] for values in sums.values()))


def drive(distance_m=0.5, turned_rad=2 * math.pi):
    return [*rest(), *line(distance_m), *rest(), *turn(turned_rad), *rest()]


@pytest.mark.parametrize("yaw_deg", [180.0, 0.0, 37.0, -90.0])
@pytest.mark.parametrize("believed", [1.0, 1.07, 0.9])
def test_scale_heading_and_lever_are_found_exactly_without_noise(yaw_deg, believed):
    mounting = Pose2(0.11, -0.04, math.radians(yaw_deg))

    found = calibrate(seen(drive(), mounting, (believed, believed)), Known([0.5]), ASSUMED)

    assert found.metres_per_pixel == pytest.approx((PIXEL_M / believed, PIXEL_M / believed), rel=1e-9)
    assert math.remainder(found.yaw_rad - mounting.theta, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)
    assert found.lever_m == pytest.approx((0.11, -0.04), abs=1e-9)
    assert found.turned_rad == pytest.approx(2 * math.pi)
    assert not found.has_both_scales


def test_backwards_and_wobbling_make_no_difference():
    mounting = Pose2(0.11, -0.04, math.radians(170.0))
    moves = [*rest(), *line(-0.5, wobble_rad=0.002), *rest(), *turn(-3.0), *rest()]

    found = calibrate(seen(moves, mounting), Known([0.5], is_backward=True), ASSUMED)

    # the line is a little longer than the distance of its ends
    assert found.metres_per_pixel[0] == pytest.approx(PIXEL_M, rel=2e-5)
    assert math.remainder(found.yaw_rad - mounting.theta, 2 * math.pi) == pytest.approx(0.0, abs=1e-5)
    assert found.lever_m == pytest.approx((0.11, -0.04), abs=1e-5)


def test_a_move_to_the_side_tells_the_other_scale():
    mounting = Pose2(0.1, 0.0, math.radians(180.0))
    moves = [*rest(), *line(0.5), *rest(), *line(0.3, angle_rad=math.pi / 2), *rest(), *turn(2 * math.pi), *rest()]

    found = calibrate(seen(moves, mounting, (1.05, 0.98)), Known([0.5], [0.3]), ASSUMED)

    assert found.has_both_scales
    assert found.metres_per_pixel == pytest.approx((PIXEL_M / 1.05, PIXEL_M / 0.98), rel=1e-6)


AHEAD, ASIDE = line(0.6), line(0.3, angle_rad=math.pi / 2)


@pytest.mark.parametrize(
    ("moves", "known", "complaint"),
    [
        ([ASIDE, AHEAD], Known([0.6], [0.3]), "is 4.00 times what was assumed"),
        ([AHEAD, line(0.7), ASIDE], Known([0.6, 0.3], [0.7]), "moves 1 and 2|that of|times what was assumed"),
        ([AHEAD, line(0.3)], Known([0.3, 0.6]), "that of 0.3 m was"),
        ([AHEAD, line(0.7), ASIDE], Known([0.7, 0.6], [0.3]), "contradict each other: by all of them"),
        ([AHEAD, ASIDE], Known([0.6, 0.3]), "moves 1 and 2 are 90 deg apart"),
        ([AHEAD, line(-0.6)], Known([0.6, 0.6]), "moves 1 and 2 are 180 deg apart"),
    ],
)
def test_lengths_in_another_order_than_they_were_driven_are_refused(moves, known, complaint):
    course = [*rest(), *(step for move in moves for step in [*move, *rest()])]

    with pytest.raises(DataError, match=complaint) as refusal:
        calibrate(seen(course, Pose2(0.1, 0.0, math.radians(180.0)), noise_px=0.05), known, ASSUMED)
    assert "in the order of driving" in str(refusal.value)


@pytest.mark.parametrize("bend_rad", [0.12, -0.12])
def test_two_honest_moves_that_bend_are_no_two_directions(bend_rad):
    """Without a turn in place the lever arm is not known, and a bend looks like another direction."""
    moves = [
        *rest(),
        *(Pose2.exp(0.5 / 120, 0.0, bend_rad / 120) for _ in range(120)),
        *rest(),
        *(Pose2.exp(0.5 / 120, 0.0, -bend_rad / 120) for _ in range(120)),
        *rest(),
    ]

    found = calibrate(seen(moves, Pose2(0.3, 0.0, 0.0)), Known([0.5, 0.5]), ASSUMED)

    assert found.yaw_rad == pytest.approx(0.0, abs=math.radians(0.5))


def test_a_length_that_a_tape_gets_wrong_by_a_little_is_no_contradiction():
    moves = [*rest(), *line(0.500), *rest(), *line(0.510), *rest(), *line(0.30, angle_rad=math.pi / 2), *rest()]

    found = calibrate(seen(moves, Pose2(), noise_px=0.05), Known([0.5, 0.5], [0.3], sigma_m=1e-3), ASSUMED)

    assert found.has_both_scales
    assert found.metres_per_pixel == pytest.approx((PIXEL_M, PIXEL_M), rel=0.02)


def test_two_moves_along_one_axis_tell_one_scale_and_their_scatter():
    moves = [*rest(), *line(0.500), *rest(), *line(0.505), *rest()]

    found = calibrate(seen(moves, Pose2()), Known([0.5, 0.5], sigma_m=1e-4), ASSUMED)

    assert not found.has_both_scales
    assert found.lever_m is None
    assert found.metres_per_pixel[0] == pytest.approx(PIXEL_M * 0.5 / 0.5025, rel=1e-4)
    assert found.metres_per_pixel_sigma[0] > 0.002 * PIXEL_M


def test_the_uncertainty_covers_the_error():
    """Normalised errors of many noisy drives: their mean square is about one."""
    rng, mounting = np.random.default_rng(4), Pose2(0.12, 0.03, math.radians(176.0))
    errors = []
    for seed in range(40):
        length_m = 0.5 + rng.normal(0.0, 1e-3)  # the tape says 0.5
        found = calibrate(seen(drive(length_m), mounting, noise_px=0.1, seed=seed), Known([0.5]), ASSUMED)
        assert found.lever_m is not None
        assert found.lever_sigma_m is not None
        errors.append(
            [
                (found.metres_per_pixel[0] - PIXEL_M) / found.metres_per_pixel_sigma[0],
                math.remainder(found.yaw_rad - mounting.theta, 2 * math.pi) / found.yaw_sigma_rad,
                (found.lever_m[0] - mounting.x) / found.lever_sigma_m[0],
                (found.lever_m[1] - mounting.y) / found.lever_sigma_m[1],
            ]
        )

    squares = np.mean(np.square(errors), axis=0)
    assert np.all((squares > 0.2) & (squares < 3.0)), squares


def test_moves_are_cut_where_the_camera_stands_still():
    steps = seen(drive(), Pose2(0.1, 0.0, math.pi), noise_px=0.02)

    moves = moves_of(steps, PIXEL_M)

    edges = [edge for move in moves for edge in (move.first, move.last)]
    np.testing.assert_allclose(edges, [20, 180, 180, 420], atol=2)


def test_rest_is_as_long_where_its_first_pictures_were_taken_for_repeats():
    """After a sudden stop three pictures are no steps of their own: the one behind them counts from the last move."""
    moves = [*rest(26), *line(0.12, n=32), *rest(26), *turn(math.radians(70.0), n=56), *rest(26)]
    every = seen(moves, Pose2(0.08, 0.02, math.radians(176.0)), noise_px=0.005)
    steps = without_pictures(without_pictures(every, 140, 3), 58, 3)

    found = calibrate(steps, Known([0.12]), ASSUMED)

    edges = [edge for move in moves_of(steps, PIXEL_M) for edge in (move.first, move.last)]
    np.testing.assert_allclose(every.stamp_s[13], steps.stamp_s[edges[0]], atol=2 / RATE_HZ)
    np.testing.assert_allclose(every.stamp_s[58 + 13], steps.stamp_s[edges[1:3]], atol=2 / RATE_HZ)
    assert found.metres_per_pixel[0] == pytest.approx(PIXEL_M, rel=1e-3)
    assert found.turned_rad == pytest.approx(math.radians(70.0), abs=1e-3)


def test_a_gap_of_days_in_a_move_is_refused_like_a_short_one():
    steps = seen(drive(), Pose2())
    stamp_s = steps.stamp_s + np.where(np.arange(len(steps)) >= 100, 1e9, 0.0)

    with pytest.raises(DataError, match="lost track"):
        calibrate(replace(steps, stamp_s=stamp_s, since_s=np.append(0.0, stamp_s[:-1])), Known([0.5]), ASSUMED)


@pytest.mark.parametrize(
    ("moves", "known", "complaint"),
    [
        ([*rest(100)], Known([0.5]), "stood still all the time"),
        ([*rest(), *turn(6.0), *rest()], Known([0.5]), "1 straight move was announced"),
        (drive(), Known([0.5, 0.5]), "2 straight moves were announced"),
        ([*rest(), *line(0.5), *line(0.5), *turn(2.0), *rest()], Known([1.0]), "neither straight nor a turn in place"),
        ([*rest(), *line(0.5), *rest(), *turn(0.5), *rest()], Known([0.5]), "turned by 29 deg"),
        ([*rest(), *line(0.03), *rest()], Known([0.03]), "neither straight"),
    ],
)
def test_a_drive_that_does_not_suffice_is_refused(moves, known, complaint):
    with pytest.raises(DataError, match=complaint):
        calibrate(seen(moves, Pose2(0.1, 0.0, math.pi)), known, ASSUMED)


def test_a_lost_track_within_a_move_is_refused():
    steps = seen(drive(), Pose2(0.1, 0.0, math.pi))
    stamps = steps.stamp_s.copy()
    stamps[99] -= 0.5 / RATE_HZ
    broken = Steps(steps.since_s, stamps, steps.x, steps.y, steps.theta, steps.variance)

    with pytest.raises(DataError, match=r"lost track in the move from 0\.2"):
        calibrate(broken, Known([0.5]), ASSUMED)


def test_nothing_to_measure_on_is_refused():
    empty = np.empty(0)

    with pytest.raises(DataError, match="no motion"):
        calibrate(Steps(empty, empty, empty, empty, empty, empty), Known([0.5]), ASSUMED)
