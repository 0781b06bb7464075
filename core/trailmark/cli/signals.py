"""The signals that end a command: the robot is stopped, the run ends in order, and after two seconds we have left.

Ctrl-Z, which suspends a command, stops the robot before.

No other place of Trailmark touches the handlers of these signals; `trailmark.cli.main` is the one that calls it.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, TypeVar

from trailmark import interruption
from trailmark.interruption import Interrupted, Lifeline

__all__ = ["HeardSignals", "call_until_signal"]

_T = TypeVar("_T")

# Windows has SIGINT, SIGTERM and SIGBREAK; nobody has tried it there.
_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGUSR1", "SIGUSR2", "SIGXCPU", "SIGBREAK")

# The process is gone two seconds after the signal; so much of it is for leaving [s].
_DEADLINE_S = 1.4
# `timeout`, and a shell that loses its terminal, send the same signal twice at once: that is one wish [s].
_SAME_WISH_S = 0.2
# For writing what is known when the run itself does not come to it [s].
_LAST_WORDS_S = 0.4
_MARK_S = 0.2

_NUDGE_S = 0.05

_HAS_TIMERS = hasattr(signal, "setitimer")  # not on Windows

_listening: list[HeardSignals] = []


def call_until_signal(call: Callable[[], _T], *, is_whole_program: bool) -> _T | int:
    """Return what a call returns, or 128 and the number of the signal that ended it.

    The handlers are as before afterwards. A signal that is ignored, as a hang-up under ``nohup``, stays so. In another
    thread than the main one, where handlers cannot be set, nothing is changed.

    Parameters
    ----------
    call : callable
        Is ended by `Interrupted`.
    is_whole_program : bool
        Whether the process ends with it; otherwise nobody leaves the process any more afterwards.
    """
    if threading.current_thread() is not threading.main_thread():
        return call()
    heard, answer = HeardSignals(is_whole_program), None
    try:  # `Interrupted` may be raised between any two lines here, but once only: it is not repeated for a while
        try:
            heard.listen()
            answer = call()
        finally:
            heard.stop_listening()
    except Interrupted:
        heard.stop_listening()
    return answer if heard.exit_code is None else heard.exit_code  # type: ignore[return-value]


class HeardSignals:
    """Receives the signals that end a program.

    The handlers raise `Interrupted` in the main thread when the run allows it; a thread does the rest.

    The thread learns of a signal even while the main thread is in native code: the system writes the signal's
    number into a pipe (`signal.set_wakeup_fd`).

    Parameters
    ----------
    is_whole_program : bool
        Whether the process may end by itself; False in a notebook or another program.
    """

    def __init__(self, is_whole_program: bool) -> None:
        self._is_whole_program = is_whole_program
        self._numbers = frozenset[int]()
        self._before: dict[int, Any] = {}
        self._wakeup_before = self._reader = self._writer = -1
        self._first: Interrupted | None = None
        self._is_done = False
        self._terminal: Any = None
        self._unraisable_before: Callable[[Any], Any] = sys.unraisablehook
        self._leaving = threading.Lock()

    @property
    def exit_code(self) -> int | None:
        """128 and the number of the first signal; None: there was none."""
        by = interruption.ending_signal() or self._first
        return None if by is None else 128 + by.number

    def listen(self) -> None:
        """Set the handlers of the signals that are neither ignored nor handled elsewhere."""
        with _held_back():  # a signal that comes meanwhile is heard when all handlers are set
            interruption.forget()
            self._set_handlers()
        threading.Thread(target=self._listen, name="signals", daemon=True).start()

    def _set_handlers(self) -> None:
        if hasattr(signal, "SIGTSTP") and signal.getsignal(signal.SIGTSTP) == signal.SIG_DFL:
            self._before[signal.SIGTSTP] = signal.signal(signal.SIGTSTP, _ignore)  # the thread sees to it
        known = [getattr(signal, name) for name in _NAMES if hasattr(signal, name)]
        self._numbers = frozenset(int(n) for n in known if signal.getsignal(n) not in (signal.SIG_IGN, None))
        self._terminal = _terminal_settings()
        self._reader, self._writer = os.pipe()
        os.set_blocking(self._writer, False)
        self._wakeup_before = signal.set_wakeup_fd(self._writer, warn_on_full_buffer=False)
        self._unraisable_before, sys.unraisablehook = sys.unraisablehook, self._hear_what_was_dropped
        _listening.append(self)
        for number in self._numbers:
            self._before[number] = signal.signal(number, self._handle)

    def stop_listening(self) -> None:
        """Set the handlers to what they were.

        When the program is to end and does with what went on here, a second signal, and what keeps it from ending, are
        still seen to.
        """
        with _held_back():
            if self in _listening and not self._is_done:
                self._is_done = True
                self._stop_listening()

    def _stop_listening(self) -> None:
        is_to_end = self.exit_code is not None
        if (by := interruption.ending_signal()) is not None:
            _each(_write, interruption.reason_of(by))  # of a run that was cut off between its beginning and its end
        self._stop_nudging()
        if is_to_end and self._is_whole_program:
            for number in self._numbers:
                signal.signal(number, _ignore)
            with suppress(OSError, ValueError):  # nobody reads it any more
                sys.stdout.flush()
            return
        self._first = interruption.ending_signal()
        interruption.forget()
        self.let_go()
        os.close(self._writer)  # ends the thread
        self._writer = -1

    def let_go(self) -> None:
        """Set the handlers to what they were, and nothing else."""
        _listening.remove(self)
        sys.unraisablehook = self._unraisable_before
        signal.set_wakeup_fd(self._wakeup_before)
        for number, handler in self._before.items():
            is_traceback = self._is_whole_program and handler is signal.default_int_handler  # for us there is none
            signal.signal(number, signal.SIG_DFL if is_traceback else handler)

    def _stop_nudging(self) -> None:
        """Stop the timer before its handler is set to the one that ends the process."""
        if _HAS_TIMERS and signal.SIGALRM in self._before:
            signal.setitimer(signal.ITIMER_REAL, 0.0)

    # --- in the main thread ----------------------------------------------------------------------------------------

    def _handle(self, number: int, frame: FrameType | None) -> None:
        by = interruption.ask_to_end(number)
        if _HAS_TIMERS and signal.SIGALRM not in self._before:
            self._before[signal.SIGALRM] = signal.signal(signal.SIGALRM, self._nudge)
            signal.setitimer(signal.ITIMER_REAL, _NUDGE_S, _NUDGE_S)
        if interruption.is_due():
            raise by

    def _nudge(self, number: int, frame: FrameType | None) -> None:
        by = interruption.ending_signal()
        if by is not None and interruption.is_due():
            raise by

    def _hear_what_was_dropped(self, unraisable: Any) -> None:
        """Raise `Interrupted` again, and say nothing, where a destructor or a callback of a weak reference ate it."""
        if isinstance(unraisable.exc_value, Interrupted):
            interruption.raise_soon()
        else:
            self._unraisable_before(unraisable)

    # --- in the thread ---------------------------------------------------------------------------------------------

    def _listen(self) -> None:
        """Wait for the first signal, and then the second."""
        first = self._next_signal()
        if first is None:
            return
        heard_s = time.monotonic()
        reason = interruption.reason_of(first)
        threading.Thread(target=_each, args=(_stop, reason), name="stop", daemon=True).start()
        threading.Thread(target=self._leave_when_late, args=(reason,), name="deadline", daemon=True).start()
        while self._next_signal() is not None:
            if time.monotonic() - heard_s > _SAME_WISH_S:
                self._leave(reason, "left at the second signal", _mark, _MARK_S)

    def _next_signal(self) -> Interrupted | None:
        """Wait for a signal that ends the program, and suspend it at others; None: handlers are no longer set."""
        while True:
            heard = os.read(self._reader, 1)
            if not heard:
                os.close(self._reader)
                return None
            if heard[0] in self._numbers:
                return interruption.ask_to_end(heard[0])
            if heard[0] == getattr(signal, "SIGTSTP", None):
                _suspend(heard[0])

    def _leave_when_late(self, reason: str) -> None:
        time.sleep(_DEADLINE_S)
        while interruption.is_kept() and interruption.asked_since_s() < interruption.KEEP_S:
            time.sleep(_NUDGE_S)
        if self._writer >= 0:
            self._leave(
                reason, "not everything came to its end in time; what is known was written", _write, _LAST_WORDS_S
            )

    def _leave(self, reason: str, words: str, last: Callable[[Lifeline, str], None], limit_s: float) -> None:
        """End the process here and now."""
        if not self._leaving.acquire(blocking=False):
            return
        worker = threading.Thread(target=_each, args=(last, reason), name="last words", daemon=True)
        worker.start()
        worker.join(limit_s)
        _give_terminal_back(self._terminal)
        if not self._is_done:
            with suppress(OSError):
                os.write(2, f"trailmark: {reason}: {words}\n".encode())
        os._exit(self.exit_code or 1)


@contextmanager
def _held_back() -> Iterator[None]:
    """Block the signals, and with them `Interrupted`, until the block ends."""
    with interruption.shielded():
        if not hasattr(signal, "pthread_sigmask"):  # not on Windows
            yield
            return
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _all_numbers())
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _all_numbers() -> list[int]:
    return [getattr(signal, name) for name in (*_NAMES, "SIGALRM", "SIGTSTP") if hasattr(signal, name)]


def _ignore(number: int, frame: FrameType | None) -> None:
    """Do nothing in the main thread."""


def _suspend(number: int) -> None:
    """Suspend this process until it gets SIGCONT; its robots are stopped before."""
    reason = f"suspended by {signal.Signals(number).name}"
    for lifeline in interruption.lifelines():
        lifeline.hold(reason)
    signal.pthread_kill(threading.get_ident(), signal.SIGSTOP)  # has stopped this thread before it returns
    for lifeline in interruption.lifelines():
        lifeline.release()


def _let_go_in_child() -> None:
    """Give the handlers up in a forked process, so that signals end it as any other."""
    for heard in reversed(_listening.copy()):  # each leaves the list
        heard.let_go()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_let_go_in_child)


def _each(call: Callable[[Lifeline, str], None], reason: str) -> None:
    for lifeline in interruption.lifelines():
        call(lifeline, reason)


def _stop(lifeline: Lifeline, reason: str) -> None:
    lifeline.stop(reason)


def _mark(lifeline: Lifeline, reason: str) -> None:
    lifeline.mark(reason)


def _write(lifeline: Lifeline, reason: str) -> None:
    lifeline.stop(reason)
    lifeline.mark(reason)
    lifeline.write(reason)


def _terminal_settings() -> Any:
    """Return how the terminal is set, where there is one that is ours."""
    with suppress(OSError, ValueError, ImportError, AttributeError):  # no standard input, or not such a system
        import termios

        if os.tcgetpgrp(0) == os.getpgrp():
            return termios.tcgetattr(0)
    return None


def _give_terminal_back(settings: Any) -> None:
    """Restore the terminal: a progress bar hides the cursor, and driving with keys switches the echo off."""
    if settings is None:
        return
    import termios

    with suppress(OSError, termios.error):
        if os.isatty(2):
            os.write(2, b"\x1b[?25h\r")
        termios.tcsetattr(0, termios.TCSADRAIN, settings)
