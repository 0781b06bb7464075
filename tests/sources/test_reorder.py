"""Putting the readings of several sensors in order."""

from __future__ import annotations

from dataclasses import dataclass

from hypothesis import given
from hypothesis import strategies as st

from trailmark.sources.reorder import MAX_HELD, in_stamp_order


@dataclass(frozen=True)
class Item:
    sensor: str
    stamp_s: float


@given(
    st.lists(st.tuples(st.sampled_from("abc"), st.floats(0.0, 100.0), st.floats(0.0, 0.9)), max_size=40, unique=True)
)
def test_readings_that_lag_less_than_the_window_come_out_in_order(spec):
    arrived = sorted(spec, key=lambda item: item[1] + item[2])
    newest: dict[str, float] = {}
    items = []
    for sensor, stamp_s, _ in arrived:  # stamps of one sensor increase, as the source sees to
        if stamp_s > newest.get(sensor, -1.0):
            newest[sensor] = stamp_s
            items.append(Item(sensor, stamp_s))

    ordered = list(in_stamp_order(items, "abc", 1.0))

    assert [item.stamp_s for item in ordered] == sorted(item.stamp_s for item in items)


def test_a_reading_is_released_as_soon_as_all_sensors_have_one():
    taken = []

    def items():
        for item in (Item("a", 1.0), Item("b", 2.0), Item("a", 3.0)):
            taken.append(item)
            yield item

    first = next(in_stamp_order(items(), "ab", 100.0))

    assert first == Item("a", 1.0)
    assert len(taken) == 2


def test_a_silent_sensor_holds_the_others_back_no_longer_than_the_window():
    taken = []

    def items():
        for i in range(100):
            taken.append(i)
            yield Item("a", 0.1 * i)

    first = next(in_stamp_order(items(), "ab", 1.0))

    assert first.stamp_s == 0.0
    assert len(taken) < 15


def test_what_is_held_back_is_bounded_also_without_a_window():
    taken = []

    def items():
        for i in range(MAX_HELD * 2):
            taken.append(i)
            yield Item("a", float(i))

    next(in_stamp_order(items(), "ab", 1e9))

    assert len(taken) == MAX_HELD + 1


def test_what_comes_too_late_is_given_out_of_order_for_the_caller_to_see():
    items = [Item("a", float(i)) for i in range(10)] + [Item("b", 0.5)]

    ordered = list(in_stamp_order(items, "ab", 2.0))

    assert len(ordered) == 11
    assert [i.stamp_s for i in ordered] != sorted(i.stamp_s for i in ordered)
