"""What counts as the failure of a part, and how it is reported: one policy for every call that leaves our code.

Whatever comes out of a part is its failure and names it: an `Exception`, ``sys.exit()``, a `KeyboardInterrupt` that it
raises itself. Two things pass as they are: an error of Trailmark that has its own words, and Ctrl-C.
"""

from __future__ import annotations

import dis
import threading
from collections.abc import Callable
from typing import NoReturn, TypeVar

from trailmark.errors import RunError, ShapeError, TrailmarkError
from trailmark.interruption import Interrupted

__all__ = ["call_guarded", "is_from_user", "raise_failure", "speaks_for_itself", "words_of"]

_T = TypeVar("_T")
_RAISE = dis.opmap["RAISE_VARARGS"]


def call_guarded(part: str, method: str, call: Callable[[], _T]) -> _T:
    """Call a method of a part and return its answer; what it raises becomes a `RunError` that names both.

    Parameters
    ----------
    part : str
        Kind and name, for example ``localizer 'floor'``.
    method : str
        What is called.
    call : callable
        Calls it.

    Raises
    ------
    RunError
        If it raises what is no error of Trailmark.
    """
    try:
        return call()
    except BaseException as error:
        raise_failure(error, part, method)


def raise_failure(
    error: BaseException,
    part: str,
    method: str,
    *,
    kind: type[RunError] = RunError,
    keeps: type[TrailmarkError] | tuple[()] = TrailmarkError,
) -> NoReturn:
    """Raise what a call of a part has raised, as an error that names part and method.

    Parameters
    ----------
    error : BaseException
        What came out of it.
    part, method : str
        Whose method it is, and which; the latter may go on with the frame at which it failed.
    kind : type of RunError
        What is raised.
    keeps : type of TrailmarkError
        Errors that are raised as they are, if they have words.

    Raises
    ------
    TrailmarkError
        As it is, if it is one of those.
    KeyboardInterrupt
        If the user has interrupted the program.
    RunError
        Otherwise.
    """
    if speaks_for_itself(error, keeps):
        raise error
    raise kind(f"{part} failed in {method}: {words_of(error)}", part) from error


def speaks_for_itself(error: BaseException, keeps: type[TrailmarkError] | tuple[()] = TrailmarkError) -> bool:
    """Return whether an exception is not a part's failure to be named: Ctrl-C, or one of `keeps` that has words.

    A `ShapeError` is one: the part has made an array that it must not make, and its words do not say who.
    """
    speaks = isinstance(error, keeps) and not isinstance(error, ShapeError) and bool(_text_of(error))
    return speaks or is_from_user(error)


def words_of(error: BaseException) -> str:
    """Return an exception in words: its type, and what it says if it says anything."""
    return f"{type(error).__name__}: {_text_of(error)}".rstrip(": ")


def is_from_user(error: BaseException) -> bool:
    """Return whether an exception is the user's Ctrl-C, not a `KeyboardInterrupt` that a part raises itself.

    Signals reach the main thread alone, and between two statements: what a ``raise`` statement outside of Trailmark
    has raised is no signal.
    """
    if isinstance(error, Interrupted):  # the command line raises it, for a signal
        return True
    if not isinstance(error, KeyboardInterrupt) or threading.current_thread() is not threading.main_thread():
        return False
    traceback = error.__traceback__
    while traceback is not None and traceback.tb_next is not None:
        traceback = traceback.tb_next
    if traceback is None or traceback.tb_frame.f_globals.get("__name__", "").partition(".")[0] == "trailmark":
        return True
    return traceback.tb_frame.f_code.co_code[traceback.tb_lasti] != _RAISE


def _text_of(error: BaseException) -> str:
    try:
        return str(error)
    except Exception:  # an exception of a plugin may fail even at this
        return ""
