"""Calls that go on in threads of their own while their caller does something else, and are waited for in its order."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any, Generic, TypeVar

from trailmark.interruption import join

__all__ = ["PendingCall", "Workers", "n_cores"]

_T = TypeVar("_T")

# Who waits looks up so often: a lock cannot be interrupted outside of the main thread [s].
_LOOK_UP_S = 0.5
# What is in work at the end is waited for so long [s].
_PATIENCE_S = 2.0


class PendingCall(Generic[_T]):
    """A call that is waiting for a worker, in work, or done.

    Parameters
    ----------
    call : callable
        Called without arguments, once.
    """

    def __init__(self, call: Callable[[], _T]) -> None:
        self._call = call
        self._is_over = threading.Event()
        self._answer: list[_T] = []
        self._error: BaseException | None = None

    def run(self) -> None:
        """Call it, and keep what it returns or raises."""
        try:
            self._answer.append(self._call())
        except BaseException as error:  # raised again where the answer is asked for
            self._error = error
        self._is_over.set()

    def wait(self, limit_s: float) -> bool:
        """Wait for the call to end; False: it has not within that time [s]."""
        return self._is_over.wait(limit_s)

    def result(self) -> _T:
        """Wait for the call, and return what it has returned or raise what it has raised."""
        while not self.wait(_LOOK_UP_S):
            pass
        if self._error is not None:
            raise self._error
        return self._answer.pop()


class Workers:
    """Threads that take calls in the order in which they are submitted. A process ends without waiting for them.

    Parameters
    ----------
    name : str
        Of the threads.
    n_threads : int
        How many calls may be in work at once.
    """

    def __init__(self, name: str, n_threads: int = 1) -> None:
        self._calls: SimpleQueue[PendingCall[Any] | None] = SimpleQueue()
        self._threads = [threading.Thread(target=self._work, name=name, daemon=True) for _ in range(n_threads)]
        for thread in self._threads:
            thread.start()

    def submit(self, call: Callable[[], _T]) -> PendingCall[_T]:
        """Let a worker call it; `PendingCall.result` waits for its answer."""
        pending = PendingCall(call)
        self._calls.put(pending)
        return pending

    def close(self) -> None:
        """End the threads, after what was submitted; what does not come back is left behind."""
        for _ in self._threads:
            self._calls.put(None)
        for thread in self._threads:
            if thread is not threading.current_thread():
                join(thread, _PATIENCE_S)

    def _work(self) -> None:
        while (pending := self._calls.get()) is not None:
            pending.run()


def n_cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
