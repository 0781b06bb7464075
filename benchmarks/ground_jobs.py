"""Drives that are measured one after the other, or by several processes at once."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import Any

import cv2

__all__ = ["in_turn"]

Rows = Iterator[dict[str, Any]]


def in_turn(measure: Callable[..., Rows], jobs: Sequence[tuple[Any, ...]], n_processes: int) -> Rows:
    """Yield the rows of ``measure(*job)`` for all jobs; with several processes a job's rows come when it is done.

    Parameters
    ----------
    measure : callable
        Yields rows; a function of a module, so that another process finds it.
    jobs : sequence of tuple
        Arguments of `measure`.
    n_processes : int
        At once; 1 measures here.
    """
    if n_processes == 1:
        for job in jobs:
            yield from measure(*job)
        return
    context = multiprocessing.get_context("spawn")  # threads of cv2 and numba do not survive a fork
    pool = ProcessPoolExecutor(n_processes, context, initializer=cv2.setNumThreads, initargs=(1,))
    try:
        for done in as_completed([pool.submit(_all_rows, measure, job) for job in jobs]):
            yield from done.result()
    finally:
        pool.shutdown(cancel_futures=True)  # whoever has enough rows does not wait for the others


def _all_rows(measure: Callable[..., Rows], job: tuple[Any, ...]) -> list[dict[str, Any]]:
    return list(measure(*job))
