"""Threads that all sensors share. What they compute never depends on how many there are."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait

__all__ = ["in_bands", "run_all"]

_MOST_THREADS = 8
_pools: dict[int, ThreadPoolExecutor] = {}


def run_all(work: Sequence[Callable[[], None]], threads: int) -> None:
    """Do pieces of work that do not depend on each other, at most `threads` at a time, and wait for them.

    They should spend their time in kernels that release the interpreter.
    """
    if threads <= 1 or len(work) <= 1:
        for piece in work:
            piece()
        return
    shares = [work[n::threads] for n in range(1, min(threads, len(work)))]
    others = [_pool().submit(_do, share) for share in shares]
    try:
        _do(work[0::threads])
    finally:
        wait(others)  # nobody works on a picture that was given up
    for other in others:
        other.result()


def in_bands(work: Callable[[int, int], None], n_rows: int, threads: int) -> None:
    """Call ``work(first, last)`` for bands of rows, one a thread."""
    edges = [n_rows * n // threads for n in range(threads + 1)]
    run_all([lambda n=n: work(edges[n], edges[n + 1]) for n in range(threads)], threads)  # type: ignore[misc]


def _do(share: Sequence[Callable[[], None]]) -> None:
    for piece in share:
        piece()


def _pool() -> ThreadPoolExecutor:
    """Return the pool of this process: threads do not survive a fork."""
    pid = os.getpid()
    if pid not in _pools:
        _pools.clear()
        _pools[pid] = ThreadPoolExecutor(_MOST_THREADS, "trailmark-sim")
    return _pools[pid]
