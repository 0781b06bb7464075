"""The rules read as they are meant, and always conclude something."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark_kinect_landmarks.fuzzy import RULES, Fuzzy, Membership, SearchPlan, infer

FINDERS = ("blobs", "rectangles", "edges", "lines")
at_least_zero = st.floats(0.0, 1e6)


def test_a_trapezium_rises_stays_and_falls() -> None:
    term = Membership(0.0, 1.0, 2.0, 4.0)

    assert [term.of(value) for value in (-1.0, 0.0, 0.5, 1.0, 2.0, 3.0, 4.0)] == [0.0, 0.0, 0.5, 1.0, 1.0, 0.5, 0.0]


def test_a_rule_reads_as_a_sentence() -> None:
    assert str(RULES[3]) == "if landmarks is enough and time is long then effort is 0.4"


@given(at_least_zero, at_least_zero, at_least_zero)
def test_there_is_a_conclusion_for_every_input(light: float, landmarks: float, time: float) -> None:
    outputs = infer(RULES, {"light": light, "landmarks": landmarks, "time": time})

    assert outputs.keys() == {"effort", "resolution", "colour"}
    assert all(0.0 <= value <= 1.0 for value in outputs.values())


def test_with_time_to_spare_everything_runs_on_the_whole_picture() -> None:
    assert Fuzzy(FINDERS).plan(light=1.0, landmarks=0.8, time=0.3) == SearchPlan(FINDERS, 1.0, True)


def test_few_landmarks_call_all_finders_even_when_it_takes_long() -> None:
    assert Fuzzy(FINDERS).plan(light=1.0, landmarks=0.1, time=2.0).finders == FINDERS


def test_too_slow_with_many_landmarks_means_one_finder_on_a_smaller_picture() -> None:
    assert Fuzzy(FINDERS).plan(light=1.0, landmarks=2.0, time=2.0) == SearchPlan(("blobs",), 0.5, True)


def test_in_the_dark_colour_is_asked_last_and_tells_nothing() -> None:
    plan = Fuzzy(FINDERS).plan(light=0.05, landmarks=2.0, time=2.0)

    assert plan.finders == ("rectangles",)
    assert not plan.by_colour


def test_the_resolution_does_not_flutter() -> None:
    fuzzy = Fuzzy(FINDERS)
    fuzzy.plan(1.0, 1.0, 2.0)

    assert fuzzy.plan(1.0, 1.0, 1.08).scale == 0.5  # between the two thresholds it stays
    assert fuzzy.plan(1.0, 1.0, 0.5).scale == 1.0


@pytest.mark.parametrize("time", [0.0, 1.0, 5.0])
def test_the_plan_keeps_the_order_of_the_finders(time: float) -> None:
    finders = Fuzzy(FINDERS).plan(1.0, 1.2, time).finders

    assert finders == tuple(name for name in FINDERS if name in finders)
