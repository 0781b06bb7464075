"""The supermarket that looks alike: what its rows count."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trailmark_papers.tasaki2010.ambiguous import _STORIES, POLISHED, WORLD, line_rows_of
from trailmark_papers.tasaki2010.place import TaughtPlace
from trailmark_papers.tasaki2010.variants import Answers

NAMES = tuple(_STORIES)
X_M = np.array([0.9, 1.1, 1.4, 2.0])


def answers_off_by(errors_m: list[float]) -> Answers:
    truth = np.stack([X_M, np.full(4, 2.0), np.zeros(4)], axis=1)
    said = truth + np.array([[0.0, error, 0.0] for error in errors_m])
    return Answers(truth, said, np.zeros(4), np.ones(4), np.ones(4))


@pytest.fixture
def place() -> TaughtPlace:
    return TaughtPlace(3, Path("nowhere"), {}, dict.fromkeys(NAMES, 7), "", WORLD)


def test_a_picture_without_an_answer_or_far_off_does_not_count_as_answered(place: TaughtPlace) -> None:
    found = dict.fromkeys(NAMES, answers_off_by([0.1, 0.2, 0.3, 0.4]))
    found["random"] = answers_off_by([0.1, 0.2, 0.9, float("nan")])

    rows = {row.item: row.ours for row in line_rows_of(found, place)}

    assert rows["selected by the shipped machine: pictures answered within 0.5 m"] == 100.0
    assert rows["as many at random: pictures answered within 0.5 m"] == 50.0
    assert rows["as many at random: error, mean"] == pytest.approx(0.4)


def test_the_part_before_the_white_wall_is_told_apart(place: TaughtPlace) -> None:
    found = dict.fromkeys(NAMES, answers_off_by([0.1, 0.5, 0.7, 0.3]))

    rows = {row.item: (row.ours, row.n) for row in line_rows_of(found, place)}

    assert rows["developed, before it: error, mean"] == (pytest.approx(0.6), 2)
    assert rows["developed, elsewhere: error, largest"] == (pytest.approx(0.3), 2)


def test_rows_of_the_polished_place_are_told_from_the_others(place: TaughtPlace) -> None:
    found = dict.fromkeys(NAMES, answers_off_by([0.1, 0.2, 0.3, 0.4]))

    plain, polished = line_rows_of(found, place), line_rows_of(found, place, "Polished")

    assert {row.experiment for row in polished}.isdisjoint(row.experiment for row in plain)
    assert [row.item for row in polished] == [row.item for row in plain]
    assert POLISHED == {**WORLD, "shiny": 1.0}


def test_the_place_hands_its_options_to_every_drive_and_a_drive_may_add_some(place: TaughtPlace) -> None:
    plain = TaughtPlace(3, Path("nowhere"), {}, {}, "")

    assert place.source(options={"people": 4})["options"] == {"alike": True, "laser_m": 4.0, "people": 4}
    assert place.source()["options"] == WORLD
    assert plain.source()["options"] == {}
