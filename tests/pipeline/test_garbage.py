"""Python's search for garbage is seldom while a run goes on, and as it was after the last one."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest

from trailmark.pipeline.run.garbage import SELDOM


@pytest.fixture(autouse=True)
def _kept_threshold() -> Iterator[None]:
    before = gc.get_threshold()
    yield
    gc.set_threshold(*before)


def test_search_is_seldom_until_the_last_of_two_runs_has_ended() -> None:
    gc.set_threshold(700, 10, 10)
    with SELDOM:
        SELDOM.__enter__()
        assert gc.get_threshold()[0] > 700
    assert gc.get_threshold()[0] > 700  # the other goes on

    SELDOM.__exit__()

    assert gc.get_threshold() == (700, 10, 10)


@pytest.mark.parametrize("young", [0, 1_000_000])
def test_who_wants_less_search_keeps_it(young: int) -> None:
    gc.set_threshold(young, 10, 10)
    with SELDOM:
        assert gc.get_threshold() == (young, 10, 10)
    assert gc.get_threshold() == (young, 10, 10)


@pytest.mark.parametrize("meanwhile", [(0, 10, 10), (50_000, 20, 20)])
def test_what_is_set_while_a_run_goes_on_stays(meanwhile: tuple[int, int, int]) -> None:
    gc.set_threshold(700, 10, 10)
    with SELDOM:
        gc.set_threshold(*meanwhile)
    assert gc.get_threshold() == meanwhile
