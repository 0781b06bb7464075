"""Live frames in the order of their stamps."""

from __future__ import annotations

import math
from collections import Counter
from statistics import median

import numpy as np
import pytest

from trailmark.frames import Frame, Scalar
from trailmark.pipeline.sources.ordering import StampOrder, _LastNumbers


def frame(sensor: str, stamp_s: float) -> Frame:
    return Frame(sensor, stamp_s, Scalar(0.0))


def played(delays_s: dict[str, float], rates_hz: dict[str, float], window_s: float = 0.3, until_s: float = 5.0):
    """Play periodic sensors with constant delays; return (given out at, frame) and what was counted."""
    counted: Counter[str] = Counter()
    order = StampOrder(dict.fromkeys(rates_hz, window_s), lambda sensor, what: counted.update([f"{sensor}.{what}"]))
    arrivals = [
        (k / rate + delays_s[sensor], frame(sensor, k / rate))
        for sensor, rate in rates_hz.items()
        for k in range(int(until_s * rate))
    ]
    given: list[tuple[float, Frame]] = []
    now_s = 0.0
    for came_s, one in sorted(arrivals, key=lambda arrival: arrival[0]):
        while (due_s := order.due_s(now_s)) <= came_s:
            now_s = max(now_s, due_s)
            given.append((now_s, order.take(now_s)))
        now_s = came_s
        order.put(one, now_s)
    while (left := order.take(math.inf)) is not None:
        given.append((now_s, left))
    return given, counted


def test_usual_intervals_and_longest_delays_are_those_of_the_last_numbers() -> None:
    rng, numbers, kept = np.random.default_rng(7), _LastNumbers(), []

    for number in rng.choice(20, 200) / 7.0:  # with repeats
        numbers.add(float(number))
        kept = [*kept, float(number)][-50:]

        assert (numbers.median, numbers.largest) == (median(kept), max(kept))


def test_a_camera_that_is_behind_comes_in_its_place() -> None:
    given, counted = played({"wheels": 0.001, "camera": 0.15}, {"wheels": 50.0, "camera": 30.0})

    stamps = [one.stamp_s for _, one in given]
    assert stamps == sorted(stamps)
    assert counted == {"camera.late": 5}  # those of the first 0.15 s: nobody knew yet that it would be behind
    assert sum(one.sensor == "camera" for _, one in given) == 145


def test_others_wait_as_long_as_the_camera_is_late_and_no_longer() -> None:
    given, _ = played({"wheels": 0.001, "camera": 0.15}, {"wheels": 50.0, "camera": 30.0})

    ages_s = [now_s - one.stamp_s for now_s, one in given if one.sensor == "wheels" and one.stamp_s > 1.0]
    assert 0.10 < max(ages_s) <= 0.153


def test_sensors_that_are_not_late_cost_nothing() -> None:
    given, counted = played(
        {"wheels": 0.001, "camera": 0.001, "laser": 0.001}, {"wheels": 50, "camera": 30, "laser": 10}
    )

    ages_s = [now_s - one.stamp_s for now_s, one in given if one.stamp_s > 1.0]
    assert max(ages_s) <= 0.0045  # its delay, the margin, and nothing else
    assert not counted


def test_the_window_bounds_the_wait() -> None:
    given, counted = played({"wheels": 0.001, "camera": 0.5}, {"wheels": 50.0, "camera": 30.0}, window_s=0.1)

    ages_s = [now_s - one.stamp_s for now_s, one in given if one.sensor == "wheels" and 1.0 < one.stamp_s < 4.0]
    assert max(ages_s) <= 0.102
    assert counted["camera.late"] > 100


def test_a_sensor_that_falls_silent_is_not_waited_for() -> None:
    order = StampOrder({"wheels": 0.3, "camera": 0.3}, lambda sensor, what: None)
    for k in range(30):
        order.put(frame("camera", k / 30.0), k / 30.0 + 0.2)
    while order.take(math.inf) is not None:
        pass

    order.put(frame("wheels", 3.0), 3.001)

    assert order.due_s(3.001) == 3.001


def test_without_windows_frames_are_taken_as_they_come() -> None:
    counted: Counter[str] = Counter()
    order = StampOrder({"a": 0.0, "b": 0.0}, lambda sensor, what: counted.update([what]))
    order.put(frame("a", 2.0), 2.0)
    assert order.take(2.0).stamp_s == 2.0

    order.put(frame("b", 1.0), 2.1)

    assert order.take(2.1).stamp_s == 1.0
    assert not counted


@pytest.mark.parametrize("n", [150, 250])
def test_readings_that_add_up_are_kept_through_a_pause(n: int) -> None:
    counted: Counter[str] = Counter()
    order = StampOrder({"imu": 0.3}, lambda sensor, what: counted.update([what]))

    for k in range(n):
        order.put(frame("imu", k / 100.0), k / 100.0)

    assert counted["dropped"] == max(0, n - 200)
