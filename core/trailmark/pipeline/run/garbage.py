"""Python's search for garbage while runs go on: seldom, for what a run lets go of is freed without it."""

from __future__ import annotations

import gc
import threading

__all__ = ["SELDOM"]

# Objects that are made and not let go of before young ones are searched; Python's own is 700. The states of a filter's
# last seconds are more than that: they were searched twice a second of the run, a tenth of all of its time.
_YOUNG = 10_000


class _SeldomSearch:
    """Lets Python search seldom from the start of the first run that goes on to the end of the last."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._n_runs, self._before = 0, gc.get_threshold()

    def __enter__(self) -> None:
        with self._lock:
            if self._n_runs == 0:
                self._before = young, *older = gc.get_threshold()
                if young:  # 0: whoever runs us wants no search at all
                    gc.set_threshold(max(young, _YOUNG), *older)
            self._n_runs += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._n_runs -= 1
            if self._n_runs == 0:
                gc.set_threshold(*self._before)


#: ``with SELDOM:``, or entered into a stack; of several runs at a time, too.
SELDOM = _SeldomSearch()
