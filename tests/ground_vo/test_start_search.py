"""Which of several places that look alike is believed."""

from __future__ import annotations

import math

import pytest

from trailmark.geometry import Pose2
from trailmark_ground_vo.start_search import Guess, GuessVerdict, StartSearch


def search_with(*poses: Pose2, **keys) -> StartSearch:
    search = StartSearch(**({"n_places": 10, "margin": 0.7, "patience": 2} | keys))
    list(search.next_places(10))
    for pose in poses:
        search.add(pose, Pose2(), 0.0)
    return search


def verdicts(search: StartSearch, *misfits: float, n_seen: int = 2, n_found: int = 2) -> list[GuessVerdict]:
    return [GuessVerdict(guess, n_seen, n_found, misfit) for guess, misfit in zip(search.guesses, misfits, strict=True)]


def test_places_are_tried_in_batches_until_all_were() -> None:
    search = StartSearch(5, 0.7, 2)

    assert [list(search.next_places(2)) for _ in range(3)] == [[0, 1], [2, 3], [4]]
    assert search.is_through


def test_one_place_alone_is_believed() -> None:
    search = search_with(Pose2(1.0, 0.0, 0.0))

    assert search.judge(verdicts(search, 0.2), 0.0) is search.guesses[0]


def test_two_places_that_fit_alike_are_not_believed() -> None:
    search = search_with(Pose2(1.0, 0.0, 0.0), Pose2(2.0, 0.0, 0.0))

    assert search.judge(verdicts(search, 0.02, 0.025), 0.0) is None
    assert len(search.guesses) == 2


def test_the_better_of_two_is_believed_when_it_stands_out() -> None:
    search = search_with(Pose2(1.0, 0.0, 0.0), Pose2(2.0, 0.0, 0.0))

    assert search.judge(verdicts(search, 0.35, 0.02), 0.0) is search.guesses[1]


@pytest.mark.parametrize(("n_seen", "n_found"), [(2, 1), (3, 2), (1, 1), (0, 0)])
def test_a_place_of_which_something_is_missing_is_not_believed(n_seen: int, n_found: int) -> None:
    search = search_with(Pose2(1.0, 0.0, 0.0), n_needed=2)

    assert search.judge(verdicts(search, 0.02, n_seen=n_seen, n_found=n_found), 0.0) is None


def test_a_rival_out_of_sight_still_counts() -> None:
    search = search_with(Pose2(1.0, 0.0, 0.0), Pose2(2.0, 0.0, 0.0))
    first, second = search.guesses
    search.judge([GuessVerdict(first, 2, 2, 0.02), GuessVerdict(second, 2, 2, 0.02)], 0.0)

    assert search.judge([GuessVerdict(first, 2, 2, 0.02), GuessVerdict(second, 0, 0, 1.0)], 0.1) is None


def test_driving_on_tells_two_copies_apart() -> None:
    search = search_with(Pose2(1.0, 0.0, 0.0), Pose2(2.0, 0.0, 0.0))
    first, second = search.guesses
    search.judge([GuessVerdict(first, 2, 2, 0.02), GuessVerdict(second, 2, 2, 0.02)], 0.0)

    assert search.judge([GuessVerdict(first, 2, 2, 0.02), GuessVerdict(second, 2, 0, 1.0)], 0.1) is first
    search.judge([GuessVerdict(first, 2, 2, 0.02), GuessVerdict(second, 2, 0, 1.0)], 0.1)
    assert search.guesses == [first]


def test_with_a_way_to_confirm_a_place_is_believed_only_after_it() -> None:
    search = search_with(Pose2(1.0, 0.0, 0.0), confirm_m=0.3)

    assert search.judge(verdicts(search, 0.02), 0.29) is None
    assert search.judge(verdicts(search, 0.02), 0.31) is not None


def test_without_a_guess_all_places_are_tried_anew() -> None:
    search = search_with(Pose2(1.0, 0.0, 0.0))
    for _ in range(2):
        assert search.judge(verdicts(search, 1.0, n_found=0), 0.0) is None

    assert search.guesses == []
    assert not search.is_through


def test_two_patches_of_one_place_are_one_guess_also_while_driving() -> None:
    search = search_with(Pose2(1.0, 0.0, math.pi / 2))
    search.add(Pose2(1.0, 0.11, math.pi / 2), Pose2(0.1, 0.0, 0.0), 0.1)  # 0.1 m on along the robot's x axis
    search.add(Pose2(1.0, 0.5, math.pi / 2), Pose2(0.1, 0.0, 0.0), 0.1)

    assert len(search.guesses) == 2
    assert isinstance(search.guesses[0], Guess)
