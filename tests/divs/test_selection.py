from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark_divs.selection import FrameSelector


def selected(selector, values, start_s=1.7e9):
    return [k for k, value in enumerate(values) if selector.is_due(start_s + value, value)]


@pytest.mark.parametrize("by", ["distance", "time"])
def test_pictures_are_taken_on_a_grid_that_a_late_one_does_not_shift(by):
    passed = [0.0, 0.4, 0.9, 1.3, 1.9, 2.0, 3.1, 3.9, 4.0]

    assert selected(FrameSelector(by, 1.0), passed) == [0, 3, 5, 6, 8]


def test_every_picture_is_taken_when_asked_for():
    assert selected(FrameSelector("every", 0.015), [0.0, 0.0, 0.0]) == [0, 1, 2]


def test_a_standing_robot_takes_one_picture():
    assert selected(FrameSelector("distance", 0.015), [0.2] * 9) == [0]


def test_steps_longer_than_the_grid_take_every_picture():
    assert selected(FrameSelector("distance", 0.015), np.arange(9) * 0.8) == list(range(9))


@given(st.floats(0.001, 0.4), st.lists(st.floats(0, 0.3), min_size=1, max_size=60))
def test_the_kth_picture_is_never_taken_before_its_grid_line(step, moves):
    way = np.cumsum(moves)
    taken = selected(FrameSelector("distance", step), way)

    assert taken[0] == 0
    assert all((way[idx] - way[0]) / step >= k - 1e-6 for k, idx in enumerate(taken))


def test_steps_of_whole_grid_lines_are_not_lost_to_rounding():
    way = np.cumsum([0.015] * 2000)

    assert len(selected(FrameSelector("distance", 0.015), way)) == 2000
