"""How a program that a signal has told to end comes to its end: what is cut off, what may finish, who stops the robot.

Nothing here touches a signal's handler. The command line has handlers (`trailmark.cli.signals`) and says here when it
was told to end; in a program of a user's own nobody says so, and everything below has no effect.

`Interrupted` is raised in the main thread, wherever it is, except inside of ``with shielded(patience_s)``: there not
before so much time has gone since the signal. What hangs is not waited for: two seconds after the signal the program
leaves, and every `Lifeline` stops its robot and writes what is known.
"""

from __future__ import annotations

import math
import signal
import threading
import time
from abc import ABC, abstractmethod
from types import TracebackType
from typing import Any, Self

__all__ = [
    "CLOSE_S",
    "FINISH_S",
    "KEEP_S",
    "STEP_S",
    "STOP_S",
    "TELL_S",
    "Interrupted",
    "Lifeline",
    "ask_to_end",
    "asked_since_s",
    "ending_signal",
    "forget",
    "is_due",
    "is_kept",
    "join",
    "lifelines",
    "patience_s",
    "raise_soon",
    "reason_of",
    "settle",
    "shielded",
]

# What may go on for how long after the signal; the program is gone after two seconds [s].
#: A command to stop.
STOP_S = 0.4
#: A step of the loop, so that it mostly ends between two frames.
STEP_S = 0.2
#: What localizers still have in work, and what they do when teaching ends.
FINISH_S = 0.6
#: Closing a part.
CLOSE_S = 0.9
#: Metrics, and the words at the end.
TELL_S = 1.1
#: Writing what is known: the only thing that is waited for beyond the two seconds.
KEEP_S = 10.0

# After it was raised, what unwinds has this long before it is raised again: somebody may have caught and dropped it.
_REPEAT_S = 0.7

# A request is heard so soon by whoever waits [s].
_SLICE_S = 0.05


class Interrupted(KeyboardInterrupt):
    """A signal asked the program to end.

    Parameters
    ----------
    number : int
        Of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number

    def __str__(self) -> str:
        return signal.Signals(self.number).name


class Lifeline(ABC):
    """Stops a robot and keeps what is known when the program cannot end in order; called from another thread."""

    @abstractmethod
    def stop(self, reason: str) -> None:
        """Stop the robot, if there is one that moves."""

    @abstractmethod
    def hold(self, reason: str) -> None:
        """Stop the robot for as long as the process is suspended; it takes no command before `release`."""

    @abstractmethod
    def release(self) -> None:
        """Let the run command the robot again."""

    @abstractmethod
    def mark(self, reason: str) -> None:
        """Write in an instant that this was interrupted."""

    @abstractmethod
    def write(self, reason: str) -> None:
        """Write what is known; there is about a second for it."""

    def __enter__(self) -> Self:
        _lifelines.append(self)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self in _lifelines:
            _lifelines.remove(self)


class _Request:
    """The one request to end."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Reset it to no request, in place: other modules hold this object."""
        self.by: Interrupted | None = None
        self.at_s = math.inf
        self.raised_s = -math.inf
        self.settled_s = 0.0
        self.shield_s: float | None = None

    @property
    def patience_s(self) -> float:
        """How long after the request the main thread may go on: as the innermost shield says, if there is one [s]."""
        return self.settled_s if self.shield_s is None else self.shield_s


_request = _Request()
_lifelines: list[Lifeline] = []
_main_ident = threading.main_thread().ident


def ask_to_end(number: int) -> Interrupted:
    """Note that a signal asked the program to end; the first one counts. Any thread."""
    if _request.by is None:
        _request.at_s = time.monotonic()
        _request.by = Interrupted(number)
    return _request.by


def forget() -> None:
    """Begin anew, without a request."""
    _request.clear()


def ending_signal() -> Interrupted | None:
    """Return the signal that asked the program to end; None: there was none."""
    return _request.by


def asked_since_s() -> float:
    """Return the time since a signal asked the program to end [s]; ``-inf``: none has."""
    return -math.inf if _request.by is None else time.monotonic() - _request.at_s


def is_due() -> bool:
    """Return whether `Interrupted` is to be raised in the main thread now, and take note that it is."""
    since_s = asked_since_s()
    if since_s < _request.patience_s or since_s - _request.raised_s < _REPEAT_S:
        return False
    _request.raised_s = since_s
    return True


def raise_soon() -> None:
    """Take note that what was raised came to nothing, in a destructor for instance: the next look raises it again."""
    _request.raised_s = -math.inf


def settle() -> None:
    """Take note that the request was answered: what it ended is over, and outside of shields it is not raised again.

    What then hangs all the same is left behind two seconds after the signal, and a run that begins ends at once.
    """
    if _request.by is not None:
        _request.settled_s = math.inf


def is_kept() -> bool:
    """Return whether the main thread writes what is known, which is not cut off."""
    return _request.patience_s == KEEP_S


def lifelines() -> list[Lifeline]:
    """Return those of the runs that are going on."""
    return list(_lifelines)


def patience_s(limit_s: float, until_s: float = CLOSE_S) -> float:
    """Return how long to wait for another thread: `limit_s`, or the time left until `until_s` after the request [s]."""
    since_s = asked_since_s()
    return limit_s if since_s < 0 else max(0.0, min(limit_s, until_s - since_s))


def join(thread: threading.Thread, limit_s: float) -> None:
    """Wait for a thread to end, but not beyond what `patience_s` allows."""
    until_s = time.monotonic() + limit_s
    while thread.is_alive():
        left_s = min(until_s - time.monotonic(), patience_s(math.inf))
        if left_s <= 0.0:
            return
        thread.join(min(left_s, _SLICE_S))


def reason_of(error: KeyboardInterrupt) -> str:
    """Return why a run was interrupted, in words."""
    if not isinstance(error, Interrupted):
        return "interrupted by the user"
    return f"interrupted by the user ({error})" if error.number == signal.SIGINT else f"interrupted by {error}"


class shielded:
    """Lets what stands inside go on for a while after the program was told to end; ``inf``: as long as the program.

    The innermost one counts. In other threads than the main one it has no effect: nothing is raised there.

    Parameters
    ----------
    patience_s : float
        Time since the request [s].
    """

    __slots__ = ("_outer_s", "_patience_s")

    def __init__(self, patience_s: float = math.inf) -> None:
        self._patience_s = patience_s

    def __enter__(self) -> None:
        if threading.get_ident() == _main_ident:
            self._outer_s, _request.shield_s = _request.shield_s, self._patience_s

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if threading.get_ident() == _main_ident:
            _request.shield_s = self._outer_s


def __getattr__(name: str) -> Any:
    if name != "asked":  # every import asks for __path__
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from trailmark.deprecation import deprecated_name  # hardly ever asked for

    return deprecated_name(__name__, name, {"asked": ending_signal})
