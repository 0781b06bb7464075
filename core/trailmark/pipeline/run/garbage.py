"""Python's search for garbage while runs go on: seldom, and in real time only among what is new.

What a run lets go of is freed without it.
"""

from __future__ import annotations

import gc
import threading

__all__ = ["SELDOM", "SPARED"]

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


class _SparedHeap:
    """Lets Python search nothing that was there when the first run in real time began, until the last one ends.

    A search through all that a program holds (modules, kernels, a taught path) takes a fifth of a second, and no frame
    goes on meanwhile.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._n_runs, self._is_ours = 0, False

    def __enter__(self) -> None:
        with self._lock:
            if self._n_runs == 0 and gc.get_freeze_count() == 0:  # else whoever runs us has done so
                gc.collect()
                self._is_ours = True  # first: who is interrupted here leaves a heap that the next run lets go of
                gc.freeze()
            self._n_runs += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._n_runs -= 1
            if self._n_runs == 0 and self._is_ours:
                gc.unfreeze()
                self._is_ours = False


#: ``with SPARED:``, or entered into a stack; of several runs at a time, too.
SPARED = _SparedHeap()
