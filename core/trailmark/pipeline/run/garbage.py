"""Python's search for garbage while runs go on: seldom, for what a run lets go of is freed without it."""

from __future__ import annotations

import gc
import threading

__all__ = ["SELDOM"]

# Objects that are made and not let go of before young ones are searched; Python's own is 700. What names itself in a
# plugin waits so long with all that it holds: more would be a little less time and many pictures.
_YOUNG = 2_000


class _SeldomSearch:
    """Lets Python search seldom from the start of the first run that goes on to the end of the last."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._n_runs, self._before = 0, gc.get_threshold()
        self._seldom = self._before

    def __enter__(self) -> None:
        with self._lock:
            if self._n_runs == 0:
                self._before = young, *older = gc.get_threshold()
                if young:  # 0: whoever runs us wants no search at all
                    gc.set_threshold(max(young, _YOUNG), *older)
                self._seldom = gc.get_threshold()
            self._n_runs += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._n_runs -= 1
            if self._n_runs == 0 and gc.get_threshold() == self._seldom:  # what was set meanwhile stays
                gc.set_threshold(*self._before)


#: ``with SELDOM:``, or entered into a stack; of several runs at a time, too.
SELDOM = _SeldomSearch()
