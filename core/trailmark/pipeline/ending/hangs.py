"""A part that does not come back: the run's thread is interrupted, so that the call fails like any other."""

from __future__ import annotations

import ctypes
import logging
import math
import signal
import threading
from time import monotonic
from types import FrameType

__all__ = ["HangError", "HangWatch"]

logger = logging.getLogger(__name__)

_ENDS_WITHIN_S = 1.0

# The strike at which one that was not heeded is told.
_HOPELESS = 2

# Ignored unless handled, and hardly ever used: it interrupts what waits for the system, too.
_SIGNAL: signal.Signals | None = getattr(signal, "SIGURG", None)


class HangError(BaseException):
    """A part has not come back; no `Exception`, because parts catch those."""

    def __str__(self) -> str:
        return "it has not come back for too long (patience_s)"


class HangWatch:
    """Interrupts the thread that takes a frame through the parts, if that lasts too long.

    Python code, and what waits (for a lock, a device, the time), is interrupted. Compiled code that never returns
    cannot be: that is logged, and the process has to be ended from outside.

    In the main thread the interruption is a signal, whose handler is set only where nobody has one, and set back only
    if it is still ours: a handler of the program itself is left alone, also one that it sets meanwhile.

    Parameters
    ----------
    patience_s : float
        How long a frame may take [s].
    """

    def __init__(self, patience_s: float) -> None:
        self._patience_s = patience_s
        self._since_s: float | None = None
        self._thread_id = 0
        self._over = threading.Event()
        self._thread: threading.Thread | None = None
        self._lock = threading.Lock()

    def __enter__(self) -> None:
        """Begin to watch a block."""
        if self._thread is None:
            self._begin()
        self._thread_id, self._since_s = threading.get_ident(), monotonic()

    def restart(self) -> None:
        """Begin anew inside of the block: what comes next has all the time again."""
        self._since_s = monotonic()

    def pause(self) -> None:
        """Do not watch inside of the block, until `restart`."""
        self._since_s = None

    def __exit__(self, *_: object) -> None:
        with self._lock:  # what interrupts does so before this, or not at all
            self._since_s = None

    def close(self) -> None:
        """Watch no more."""
        self._since_s = None
        self._over.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(_ENDS_WITHIN_S)
        if _is_main_thread() and self._has_handler():
            assert _SIGNAL is not None
            signal.signal(_SIGNAL, signal.SIG_DFL)

    def _begin(self) -> None:
        if _is_main_thread() and _SIGNAL is not None and signal.getsignal(_SIGNAL) == signal.SIG_DFL:
            signal.signal(_SIGNAL, self._raise)
        thread = threading.Thread(target=self._watch, name="watch for parts that hang", daemon=True)
        thread.start()
        self._thread = thread  # one that has started: Ctrl-C between the two lines leaves none that `close` waits for

    def _watch(self) -> None:
        struck_s, n_strikes = math.nan, 0
        while not self._over.wait(min(1.0, self._patience_s / 4)):
            since_s = self._since_s
            if since_s is None:
                continue
            n_strikes = n_strikes if since_s == struck_s else 0
            if monotonic() - since_s < (n_strikes + 1) * self._patience_s:
                continue
            struck_s, n_strikes = since_s, n_strikes + 1
            if n_strikes == _HOPELESS:
                logger.error("a part hangs in compiled code, which cannot be interrupted: end this process")
            with self._lock:  # again and again: Python drops what is raised in a finalizer or the callback of a weakref
                if self._since_s == since_s:
                    self._interrupt()

    def _interrupt(self) -> None:
        # Python runs handlers in the main thread, whichever thread gets the signal.
        if self._thread_id == threading.main_thread().ident and self._has_handler():
            assert _SIGNAL is not None
            signal.pthread_kill(self._thread_id, _SIGNAL)
        else:
            ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(self._thread_id), ctypes.py_object(HangError))

    def _has_handler(self) -> bool:
        return _SIGNAL is not None and signal.getsignal(_SIGNAL) == self._raise

    def _raise(self, number: int, frame: FrameType | None) -> None:
        since_s = self._since_s
        if since_s is not None and monotonic() - since_s >= self._patience_s:  # others may send the signal, too
            raise HangError


def _is_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
