"""The clock of a robot, told by stamps and arrivals."""

from __future__ import annotations

import math

import pytest

from trailmark.sources.clock_offset import ClockOffset


def clock_after(n: int, offset_s: float) -> ClockOffset:
    clock = ClockOffset()
    for k in range(n):
        clock.note_message(0.1 * k + offset_s, 0.1 * k)
    return clock


def test_the_offset_is_the_median_and_unknown_at_first() -> None:
    assert math.isnan(ClockOffset().median_s)
    assert not clock_after(4, -3.0).is_known
    assert clock_after(5, -3.0).median_s == pytest.approx(-3.0)


@pytest.mark.parametrize("offset_s", [0.0, -3600.0, 1e9])
def test_a_stamp_of_the_future_is_told_whatever_the_robots_clock_says(offset_s: float) -> None:
    clock = clock_after(20, offset_s)

    assert clock.note_message(2.0 + offset_s + 100.0, 2.0) == pytest.approx(100.0)
    assert clock.note_message(2.1 + offset_s, 2.1) == 0.0


def test_a_message_that_waited_is_nothing_to_refuse() -> None:
    clock = clock_after(20, 0.0)

    assert clock.note_message(2.0, 500.0) == 0.0


def test_a_clock_that_was_set_anew_is_believed_at_the_third_message() -> None:
    clock = clock_after(300, 0.0)

    told = [clock.note_message(30.0 + 0.1 * k + 3600.0, 30.0 + 0.1 * k) for k in range(4)]

    assert told == [pytest.approx(3600.0), pytest.approx(3600.0), 0.0, 0.0]


def test_stamps_that_are_wrong_in_different_ways_are_never_believed() -> None:
    clock = clock_after(20, 0.0)

    assert all(clock.note_message(1e6 * (10 - k), 2.0 + 0.1 * k) > 0.0 for k in range(10))
    assert all(clock.note_message(1e6 * (1 + k % 2), 3.0 + 0.1 * k) > 0.0 for k in range(10))


def test_a_stamp_that_does_not_move_is_never_believed() -> None:
    clock = clock_after(20, 0.0)

    assert all(clock.note_message(4e9, 2.0 + 0.1 * k) > 0.0 for k in range(10))


def test_a_clock_that_was_set_anew_is_believed_where_every_stamp_comes_twice() -> None:
    clock = clock_after(20, 0.0)

    told = [clock.note_message(5000.0 + k // 2, 2.0 + 0.5 * k) > 0.0 for k in range(8)]

    assert told == [True] * 4 + [False] * 4


@pytest.mark.parametrize("rate", [3.0, 4.0, 100.0])
def test_a_clock_that_runs_fast_is_believed_from_the_third_message_on(rate: float) -> None:
    """As that of a replay at that rate, of a topic of 1 Hz."""
    clock = ClockOffset(1.0)

    told = [clock.note_message(1000.0 + rate * k, float(k)) > 0.0 for k in range(60)]

    assert told == [False, True, True] + [False] * 57
    assert clock.note_message(1000.0 + rate * 61, 61.0) == 0.0  # though one is missing
    assert clock.note_message(4e9, 62.0) > 1e9  # that of the future is as wrong as ever
    assert clock.note_message(1000.0 + rate * 63, 63.0) == 0.0


def test_a_log_that_comes_as_fast_as_it_is_read_is_believed() -> None:
    clock = ClockOffset()

    assert all(clock.note_message(float(k), 1e-4 * k) == 0.0 for k in range(300))  # a second between two


class TestBeginning:
    """The first stamp has nothing before it to be compared with; those after it tell."""

    @pytest.mark.parametrize("offset_s", [0.0, -3600.0])
    def test_a_first_stamp_of_the_future_is_told_by_the_three_after_it(self, offset_s: float) -> None:
        clock = ClockOffset()
        told = []
        for k, stamp_s in enumerate([500.0, 0.1, 0.2, 0.3, 0.4]):
            clock.note_message(stamp_s + offset_s, 0.1 * k)
            told.append(clock.begun_ahead_s)

        assert told == [0.0, 0.0, 0.0, pytest.approx(500.0), pytest.approx(500.0)]

    def test_messages_that_waited_say_nothing_against_the_first(self) -> None:
        clock = ClockOffset()
        for stamp_s, came_s in [(0.0, 0.0), (0.1, 30.0), (0.2, 30.1), (30.2, 30.2), (0.3, 60.0), (0.4, 61.0)]:
            clock.note_message(stamp_s, came_s)

        assert clock.begun_ahead_s == 0.0

    @pytest.mark.parametrize("ahead_s", [3.4, 8.0])
    def test_a_first_stamp_that_is_seconds_ahead_is_told_by_a_limit_of_seconds(self, ahead_s: float) -> None:
        clock = ClockOffset(2.0)
        for k in range(4):
            clock.note_message(0.1 * k + ahead_s * (k == 0), 0.1 * k)

        assert clock.begun_ahead_s == pytest.approx(ahead_s)

    def test_messages_that_all_waited_for_a_busy_program_say_nothing_against_the_first(self) -> None:
        clock = ClockOffset(2.0)
        for k in range(32):
            clock.note_message(0.1 * k, 0.0 if k == 0 else 6.0)

        assert clock.begun_ahead_s == 0.0

    def test_a_clock_that_runs_slowly_from_the_first_on_is_no_wrong_beginning(self) -> None:
        clock = ClockOffset(2.0)
        for k in range(20):
            clock.note_message(0.1 * k, float(k))

        assert clock.begun_ahead_s == 0.0

    def test_a_clock_that_began_well_stays_so(self) -> None:
        clock = clock_after(3, 0.0)
        for k in range(10):
            clock.note_message(0.1 * k, 1000.0 + 0.1 * k)

        assert clock.begun_ahead_s == 0.0
