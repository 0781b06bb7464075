"""Threads that share work."""

from __future__ import annotations

import multiprocessing
import threading
from functools import partial

import pytest

from trailmark_sim.workers import in_bands, run_all


@pytest.mark.parametrize("threads", [1, 2, 3, 8])
def test_every_row_is_worked_on_once(threads: int) -> None:
    rows = [0] * 101

    def work(first: int, last: int) -> None:
        for row in range(first, last):
            rows[row] += 1

    in_bands(work, 101, threads)

    assert rows == [1] * 101


def test_work_is_done_at_the_same_time() -> None:
    meeting = threading.Barrier(2, timeout=30.0)

    run_all([meeting.wait, meeting.wait], threads=2)  # type: ignore[list-item]  # would hang, one after the other

    assert not meeting.broken


@pytest.mark.parametrize("failing", [0, 1, 4])
def test_an_error_in_any_thread_is_raised_when_all_have_ended(failing: int) -> None:
    done: list[int] = []

    def work(n: int) -> None:
        if n == failing:
            raise ValueError(f"piece {n}")
        done.append(n)

    with pytest.raises(ValueError, match=f"piece {failing}"):
        run_all([partial(work, n) for n in range(5)], threads=2)

    other_share = [n for n in range(5) if n % 2 != failing % 2]
    assert set(other_share) <= set(done)


def _bands_in_a_child() -> None:
    in_bands(lambda first, last: None, 10, 2)


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="this system cannot fork")
def test_a_forked_process_has_threads_of_its_own() -> None:
    in_bands(lambda first, last: None, 10, 2)  # the pool of this process exists now

    child = multiprocessing.get_context("fork").Process(target=_bands_in_a_child)
    child.start()
    child.join(60)

    assert child.exitcode == 0
