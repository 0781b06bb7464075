"""Reads and decodes the pictures of a recording before their turn, while the frames before them are worked on."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Generator, Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from trailmark.worker import Workers, n_cores

if TYPE_CHECKING:
    from trailmark.sources.recorded import Reading

__all__ = ["loaded_ahead"]

# Pictures that are decoded or in work before their turn, and readings that are looked through for them.
_MOST_PICTURES = 3
_MOST_READINGS = 100


def loaded_ahead(readings: Iterable[Reading], pictures: Collection[str]) -> Generator[Reading, None, None]:
    """Yield readings in their order; `load` of a picture then waits for what a thread has begun to load.

    What goes wrong shows where it would have shown: an error of `load` when the picture is loaded, one of `readings`
    behind the readings before it. On a single core nothing is begun before its turn.

    Parameters
    ----------
    readings : iterable of Reading
        In the order in which they are worked on.
    pictures : collection of str
        The sensors whose readings are loaded ahead; `load` of all others is called at its turn.
    """
    if n_cores() < 2:
        yield from readings
        return
    workers = Workers("pictures ahead", n_threads=2)
    try:
        yield from _begun_ahead(readings, pictures, workers)
    finally:
        workers.close()


def _begun_ahead(readings: Iterable[Reading], pictures: Collection[str], workers: Workers) -> Iterator[Reading]:
    waiting: deque[Reading] = deque()
    coming, n_pictures = iter(readings), 0
    problem: Exception | None = None
    while True:
        while problem is None and n_pictures < _MOST_PICTURES and len(waiting) < _MOST_READINGS:
            try:
                reading = next(coming)
            except Exception as error:  # its end (StopIteration), or a bad reading: those before it have their turn
                problem = error
                break
            if reading.sensor in pictures:
                reading = replace(reading, load=workers.submit(reading.load).result)
                n_pictures += 1
            waiting.append(reading)
        if not waiting:
            if problem is None or isinstance(problem, StopIteration):
                return
            raise problem
        reading = waiting.popleft()
        n_pictures -= reading.sensor in pictures
        yield reading
