from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimates import Belief, PathOffset
from trailmark.geometry import Twist2
from trailmark_divs.appearance import AppearanceFilter, ByAppearance, unrelated_score
from trailmark_divs.correspondence import ByDistance, ByIndex
from trailmark_divs.eye import DifferenceWindow
from trailmark_divs.landmarks import AtLandmarks, distinct_rows, sameness
from trailmark_divs.windows import Windows

N, D, W = 300, 50, 10
USABLE = np.ones(D, dtype=bool)


def make_windows(n=N, seed=7):
    """Change vectors that blend into each other along 0.02 m steps, each place unlike all others."""
    rng = np.random.default_rng(seed)
    scene = np.apply_along_axis(lambda column: np.convolve(column, np.hanning(30), "valid"), 0, rng.random((n + 29, D)))
    stations = 0.02 * np.arange(n)
    return Windows(scene * 100, stations, stations / 0.3, np.zeros(n), np.arange(n))


WINDOWS = make_windows()


def make_filter(windows=WINDOWS):
    return AppearanceFilter(windows, USABLE, W, 5, 10, 4, 6)


def seen(row, noise=3.0, seed=0):
    return WINDOWS.vectors[row] + np.random.default_rng((seed, row)).normal(0, noise, D)


def follow(places, rows, advance_m=None):
    for row in rows:
        match = places.update(seen(row), advance_m)
    return match


@pytest.mark.parametrize("start", [0, 110, 250])
@pytest.mark.parametrize("advance_m", [None, 0.02])
def test_the_place_is_found_from_anywhere_with_and_without_odometry(start, advance_m):
    match = follow(make_filter(), range(start, start + 30), advance_m)

    assert abs(match.row - (start + 29)) <= 1
    assert match.confidence > 0.95
    assert match.sigma_station_m < 0.1


def test_driving_backwards_is_followed():
    match = follow(make_filter(), range(200, 150, -1), -0.02)

    assert abs(match.row - 151) <= 1


@pytest.mark.parametrize("rows", [range(50, 200, 2), [120] * 60])
def test_without_odometry_another_speed_is_followed_half_a_window_behind(rows):
    match = follow(make_filter(), rows)

    assert abs(match.row - rows[-1]) <= W / 2
    assert match.confidence > 0.9


def test_a_robot_that_was_carried_elsewhere_is_found_again():
    places = make_filter()
    follow(places, range(20, 60))
    assert not places.is_searching

    match = follow(places, range(220, 260))

    assert abs(match.row - 259) <= 1
    assert match.confidence > 0.9


def test_blank_views_are_not_believed():
    places = make_filter()
    for _ in range(30):
        match = places.update(np.zeros(D), None)

    assert match.confidence < 0.5


def test_a_gap_in_what_was_taught_is_crossed_by_the_way_driven():
    kept = np.r_[0:100, 200:300]
    windows = Windows(
        WINDOWS.vectors[kept], WINDOWS.stations_m[kept], WINDOWS.elapsed_s[kept], np.zeros(200), WINDOWS.ordinals[kept]
    )
    places = make_filter(windows)
    follow(places, range(50, 100), 0.02)

    match = places.update(seen(205), 2.12)

    assert abs(match.row - 105) <= 1


def test_unrelated_places_score_less_than_the_same_one():
    score = unrelated_score(WINDOWS, USABLE, 5, 10, 30)

    assert 0.0 < score < 0.6
    assert unrelated_score(make_windows(20), USABLE, 5, 10, 30) == -1.0


def make_belief(station_m, motion_age_s=0.0):
    on_path = PathOffset(0.0, station_m, 0.0, 0.0, np.zeros((3, 3)))
    return Belief(0.0, twist=Twist2(0.3), on_path=on_path, motion_age_s=motion_age_s, travelled_m=station_m)


def test_an_unclear_place_is_no_match():
    by_appearance = ByAppearance(make_filter(), 0.9)

    answers = [
        by_appearance.match(DifferenceWindow(k, seen(100 + k), 0.1 * k, 0.02 * k, 0.0), make_belief(0.0))
        for k in range(30)
    ]

    assert answers[0] is None
    assert abs(answers[-1].row - 129) <= 1


def test_without_motion_the_way_is_not_trusted():
    by_appearance = ByAppearance(make_filter(), 0.9)

    for k in range(30):
        window = DifferenceWindow(k, seen(100 + k), 0.1 * k, 0.0, 0.0)
        match = by_appearance.match(window, make_belief(0.0, motion_age_s=math.inf))

    assert abs(match.row - 129) <= 1


def test_landmarks_are_distinct_places_that_keep_their_distance():
    same = np.ones(100)
    same[[20, 22, 60, 90]] = [0.1, 0.2, 0.3, 0.05]

    assert distinct_rows(same, 0.1 * np.arange(100), 1.0) == [90, 20, 60]


def test_sameness_is_high_where_the_view_hardly_changes():
    vectors = np.array(WINDOWS.vectors)
    vectors[100:200] = vectors[150] + np.random.default_rng(3).normal(0, 2, (100, D))
    windows = Windows(vectors, WINDOWS.stations_m, WINDOWS.elapsed_s, np.zeros(N), WINDOWS.ordinals)

    same = sameness(windows, USABLE, 5, 20, 10)

    assert same[125:175].min() > same[40:80].max()
    assert same[0] == same[-1] == 1.0


def pass_landmark(inner, offset_rows):
    corrected = AtLandmarks(inner, WINDOWS, [150], USABLE, W, 5, 10, 0.9)
    matches = []
    for k in range(130, 170):
        window = DifferenceWindow(k - offset_rows, seen(k), 0.1 * k, 0.0, 0.0)
        belief = make_belief(0.02 * (k - offset_rows))
        matches.append((k, corrected.match(window, Belief(0.0, on_path=belief.on_path, twist=belief.twist))))
    return matches


def test_passing_a_landmark_resets_the_origin_of_a_count():
    matches = pass_landmark(ByIndex(WINDOWS, W), 6)

    before, after = [k - match.row for k, match in matches[:15]], [k - match.row for k, match in matches[-5:]]
    assert before == [6] * 15
    assert max(map(abs, after)) <= 1
    assert sum(match.sigma_station_m is not None for _, match in matches) == 1


def test_passing_a_landmark_by_distance_tells_the_station_once():
    matches = pass_landmark(ByDistance(WINDOWS, W), 6)

    measured = [(k, match) for k, match in matches if match.sigma_station_m is not None]
    assert len(measured) == 1
    assert abs(measured[0][0] - measured[0][1].row) <= 1


def test_a_landmark_that_is_not_recognised_is_passed_by():
    corrected = AtLandmarks(ByIndex(WINDOWS, W), WINDOWS, [150], USABLE, W, 5, 10, 0.9)

    matches = [corrected.match(DifferenceWindow(k, np.zeros(D), 0.0, 0.0, 0.0), Belief(0.0)) for k in range(130, 170)]

    assert [match.row for match in matches] == list(range(130, 170))
