from __future__ import annotations

import numpy as np
import pytest

from trailmark.estimates import Belief, PathOffset
from trailmark.geometry import Twist2
from trailmark_divs.correspondence import ByDistance, ByIndex, ByTime, make_correspondence, nearest
from trailmark_divs.eye import DifferenceWindow
from trailmark_divs.windows import Windows

# Ten windows 0.1 m apart at 0.5 m/s, a turn, and five more.
STATIONS = np.concatenate([np.arange(10) * 0.1, 3.0 + np.arange(5) * 0.1])
WINDOWS = Windows(
    np.zeros((15, 8)), STATIONS, STATIONS / 0.5, np.zeros(15), np.concatenate([np.arange(10), 30 + np.arange(5)])
)


def window(ordinal=0, stamp_s=0.0, travelled_m=0.0):
    return DifferenceWindow(ordinal, np.zeros(8), stamp_s, travelled_m, 0.0)


def belief(station_m, travelled_m=0.0, forward_mps=0.3):
    on_path = PathOffset(0.0, station_m, 0.0, 0.0, np.zeros((3, 3)))
    return Belief(0.0, travelled_m=travelled_m, twist=Twist2(forward_mps), on_path=on_path)


def test_distance_is_the_believed_station_of_the_windows_middle():
    by_distance = ByDistance(WINDOWS, 4)

    assert by_distance.match(window(travelled_m=4.8), belief(0.7, travelled_m=5.0)).row == 5
    assert by_distance.match(window(travelled_m=4.8), belief(0.3, travelled_m=5.0, forward_mps=-0.3)).row == 5


def test_distance_without_a_place_on_the_path_matches_nothing():
    assert ByDistance(WINDOWS, 4).match(window(), Belief(0.0)) is None


def test_time_counts_from_the_start_of_both_steps():
    assert ByTime(WINDOWS, 4, start_s=100.0).match(window(stamp_s=101.0), belief(9.9)).row == 5


def test_index_counts_pictures():
    by_index = ByIndex(WINDOWS, 4)

    assert by_index.match(window(ordinal=7), belief(9.9)).row == 7
    assert by_index.match(window(ordinal=31), belief(9.9)).row == 11


@pytest.mark.parametrize("station_m", [-1.0, 2.0, 9.0])
def test_nothing_is_matched_before_behind_and_in_gaps_of_what_was_taught(station_m):
    assert ByDistance(WINDOWS, 4).match(window(), belief(station_m)) is None


def test_half_a_window_beyond_an_end_still_matches_the_end():
    assert ByDistance(WINDOWS, 4).match(window(), belief(3.55)).row == 14
    assert ByDistance(WINDOWS, 4).match(window(), belief(-0.15)).row == 0


@pytest.mark.parametrize("by", ["time", "index"])
def test_a_reset_moves_the_origin(by):
    correspondence = make_correspondence(by, WINDOWS, 4, 0.0)
    here = window(ordinal=3, stamp_s=0.6)

    correspondence.reset(here, 8)

    assert correspondence.match(here, belief(0.0)).row == 8


def test_the_station_was_assumed_not_measured():
    assert ByDistance(WINDOWS, 4).match(window(), belief(0.5)).sigma_station_m is None


@pytest.mark.parametrize(("value", "expected"), [(-0.4, 0), (0.4, 0), (0.6, 1), (2.2, 2), (2.6, None), (-0.6, None)])
def test_nearest_of_labels(value, expected):
    assert nearest(np.array([0.0, 1.0, 2.0]), value, 0.5) == expected


def test_nothing_is_nearest_of_nothing():
    assert nearest(np.empty(0), 1.0, 5.0) is None
