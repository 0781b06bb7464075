"""The history of a filter: late measurements, replay, a bounded window."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trailmark.estimation import History


@dataclass(frozen=True)
class Filtered:
    """A scalar Kalman filter's state, as an estimator would keep it."""

    stamp_s: float = 0.0
    mean: float = 0.0
    variance: float = 1.0
    nis: float = 0.0


def kalman_step(state: Filtered, stamp_s: float, measured: float) -> Filtered:
    predicted = state.variance + 0.1 * abs(stamp_s - state.stamp_s)
    innovation, innovation_variance = measured - state.mean, predicted + 0.5
    gain = predicted / innovation_variance
    return Filtered(
        stamp_s, state.mean + gain * innovation, (1 - gain) * predicted, innovation**2 / innovation_variance
    )


def trace_step(state: str, stamp_s: float, measured: str) -> str:
    return state + measured


def test_a_late_measurement_stands_where_it_belongs() -> None:
    history = History(10.0, trace_step, "")
    for stamp_s, letter in ((1.0, "a"), (2.0, "b"), (4.0, "d")):
        history.insert(stamp_s, letter)

    assert history.insert(3.0, "c") == "abc"
    assert history.state_at(4.0) == "abcd"
    assert history.state_at(2.5) == "ab"
    assert history.state_at(0.5) == ""


def test_measurements_of_one_stamp_stand_in_order_of_arrival() -> None:
    history = History(10.0, trace_step, "")

    history.insert(1.0, "a")
    history.insert(1.0, "b")

    assert history.state_at(1.0) == "ab"


def test_what_is_older_than_the_window_is_too_late() -> None:
    history = History(1.0, trace_step, "")
    history.insert(1.0, "a")
    history.insert(3.0, "b")

    assert history.insert(1.9, "x") is None
    assert history.state_at(3.0) == "ab"
    assert history.insert(2.0, "y") == "ay"  # the edge of the window still counts


def test_the_window_forgets_measurements_but_not_what_they_did() -> None:
    history = History(1.0, trace_step, "")
    for second in range(100):
        history.insert(float(second), "a")

    assert len(history) == 2
    assert history.state_at(99.0) == "a" * 100
    assert history.horizon_s == 98.0


def test_time_that_passes_without_a_measurement_moves_the_window() -> None:
    history = History(1.0, trace_step, "")
    history.insert(1.0, "a")
    history.advance(5.0)

    assert len(history) == 0
    assert history.newest_s == 5.0
    assert history.last_stamp_s == -math.inf
    assert history.state_at(5.0) == "a"
    assert history.insert(3.9, "b") is None


def test_replay_does_again_what_came_later() -> None:
    factor = [1.0]
    history = History(10.0, lambda state, stamp_s, measured: state + factor[0] * measured, 0.0)
    for stamp_s in (1.0, 2.0, 3.0):
        history.insert(stamp_s, 1.0)
    factor[0] = 10.0

    history.replay(1.0)

    assert history.state_at(1.0) == 1.0
    assert history.state_at(3.0) == 21.0


def test_what_comes_late_together_is_replayed_once() -> None:
    n_steps = [0]

    def count_step(state: str, stamp_s: float, measured: str) -> str:
        n_steps[0] += 1
        return state + measured

    history = History(10.0, count_step, "")
    for second in range(9):
        history.insert(float(second), "a")
    n_before = n_steps[0]

    for letter in "xyz":
        history.insert(0.5, letter)

    assert history.state_at(8.0) == "axyzaaaaaaaa"
    assert n_steps[0] - n_before == 3 + 8


def test_the_window_forgets_what_was_not_replayed_yet() -> None:
    history = History(10.0, trace_step, "")
    for second in range(9):
        history.insert(float(second), "a")
    history.insert(0.5, "x")

    history.advance(13.0)

    assert len(history) == 6
    assert history.state_at(2.9) == "axaa"
    assert history.state_at(8.0) == "axaaaaaaaa"


@settings(max_examples=50, deadline=None)
@given(st.permutations(range(12)))
def test_a_filter_does_not_notice_the_order_of_arrival(order: list[int]) -> None:
    in_order: History[float, Filtered] = History(100.0, kalman_step, Filtered())
    shuffled: History[float, Filtered] = History(100.0, kalman_step, Filtered())
    for i in range(12):
        in_order.insert(0.1 * i, math.sin(i))
    for i in order:
        shuffled.insert(0.1 * i, math.sin(i))

    assert shuffled.state_at(2.0) == in_order.state_at(2.0)


def test_the_state_carries_what_came_of_a_measurement() -> None:
    history: History[float, Filtered] = History(10.0, kalman_step, Filtered())
    history.insert(1.0, 0.1)
    history.insert(2.0, 0.1)

    state = history.insert(1.5, 5.0)

    assert state is not None
    assert state.stamp_s == 1.5
    assert state.nis == pytest.approx(kalman_step(kalman_step(Filtered(), 1.0, 0.1), 1.5, 5.0).nis)
