"""Python's search for garbage is seldom while a run goes on, spares what was there, and is as it was after the last."""

from __future__ import annotations

import gc
import weakref
from collections.abc import Iterator
from typing import Any

import pytest

from trailmark.estimates import Belief
from trailmark.frames import Frame
from trailmark.pipeline import Pipeline
from trailmark.pipeline.run.garbage import SELDOM, SPARED


@pytest.fixture(autouse=True)
def _kept_threshold() -> Iterator[None]:
    before = gc.get_threshold()
    yield
    gc.set_threshold(*before)


@pytest.fixture
def nothing_spared() -> Iterator[None]:
    """What the whole session spares is searched meanwhile."""
    gc.unfreeze()
    yield
    gc.freeze()


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


@pytest.mark.usefixtures("nothing_spared")
def test_what_was_there_is_spared_until_the_last_of_two_runs_has_ended() -> None:
    with SPARED:
        SPARED.__enter__()
        assert gc.get_freeze_count() > 10_000
    assert gc.get_freeze_count() > 10_000  # the other goes on

    SPARED.__exit__()

    assert gc.get_freeze_count() == 0


@pytest.mark.usefixtures("nothing_spared")
def test_what_somebody_else_spares_stays_spared() -> None:
    gc.freeze()
    with SPARED:
        pass
    assert gc.get_freeze_count() > 0


@pytest.mark.usefixtures("nothing_spared")
def test_garbage_of_before_is_not_kept_while_a_run_goes_on() -> None:
    class Cycle:
        itself: object

    one = Cycle()
    one.itself = one
    gone = weakref.ref(one)
    del one
    with SPARED:
        assert gone() is None


@pytest.mark.usefixtures("nothing_spared")
@pytest.mark.parametrize(("pace", "is_spared"), [("step", False), ("realtime", True)])
def test_a_run_in_real_time_spares_what_was_there_until_it_ends(fakes: Any, pace: str, is_spared: bool) -> None:
    n_spared = []

    def count(frame: Frame, belief: Belief) -> tuple[()]:
        n_spared.append(gc.get_freeze_count())
        return ()

    source = fakes.Recording(fakes.image_frames("cam", [0.0, 0.01]))
    for _ in Pipeline(fakes.parts({"cam": source}, {"counts": fakes.Scripted(count)}, pace=pace)):
        pass

    assert [n > 0 for n in n_spared] == [is_spared] * 2
    assert gc.get_freeze_count() == 0


@pytest.mark.usefixtures("nothing_spared")
def test_parts_are_closed_where_sparing_is_interrupted(fakes: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    source = fakes.Recording(fakes.image_frames("cam", [0.0]))
    monkeypatch.setattr(gc, "collect", interrupt)

    with pytest.raises(KeyboardInterrupt):
        list(Pipeline(fakes.parts({"cam": source}, pace="realtime")))

    assert source.log == ["start", "close"]
    assert gc.get_freeze_count() == 0
