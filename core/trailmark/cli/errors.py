"""How an error looks to the user: what is wrong, where, what to do; never a traceback."""

from __future__ import annotations

import errno
import os
import sys
from contextlib import suppress
from typing import TextIO

import click

from trailmark.errors import RunError, TrailmarkError
from trailmark.interruption import ending_signal, reason_of

__all__ = ["exit_code_of", "fail", "has_lost_its_reader", "say"]

#: The disk is full, or a file may not grow: no fault of the program's, and none of the request.
_DISK = frozenset({errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EIO})


def say(message: str) -> None:
    """Write a line to standard error."""
    click.echo(message, err=True)


def fail(message: str, code: int = 1) -> None:
    """Print an error and exit."""
    say(f"trailmark: {message}")
    sys.exit(code)


def _show(error: click.ClickException) -> None:
    """Print click's error in one line; a group without a command shows its help."""
    if isinstance(error, click.exceptions.NoArgsIsHelpError):
        error.show()
        return
    context = error.ctx if isinstance(error, click.UsageError) else None
    command = "trailmark" if context is None else context.command_path
    message = " ".join(error.format_message().rstrip(".").split())  # choices stand on lines of their own
    hint = "" if "--help" in message or "id you mean" in message else f"; '{command} --help' shows how"
    say(f"{command}: {message[:1].lower()}{message[1:]}{hint}")


def has_lost_its_reader() -> bool:
    """Return whether click has left because standard output is closed; it does so with exit code 1."""
    return type(sys.stdout).__name__.endswith("PacifyFlushWrapper")


def _silence(stream: TextIO) -> None:
    """Discard buffered output: Python would report its failure at exit."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def exit_code_of(error: BaseException) -> int:
    """Report an error and return the exit code that it means."""
    if isinstance(error, click.exceptions.Exit):
        return error.exit_code
    if isinstance(error, KeyboardInterrupt | click.Abort):
        signal = ending_signal()
        say("trailmark: interrupted" if signal is None else f"trailmark: {reason_of(signal)}")
        return 130
    if isinstance(error, click.ClickException):
        _show(error)
        return 2
    if isinstance(error, BrokenPipeError):  # the reader of our output went away, as `| head` does
        _silence(sys.stdout)
        return 0
    if isinstance(error, TrailmarkError):
        say(f"trailmark: {error}")
        return 1 if isinstance(error, RunError) else 2
    if isinstance(error, OSError) and error.filename is not None and error.errno not in _DISK:
        say(f"trailmark: {error.filename}: {error.strerror}")
        return 2
    if isinstance(error, OSError) and error.errno in _DISK:
        say(f"trailmark: cannot write{f' to {error.filename}' if error.filename else ''}: {error.strerror}")
        return 1
    say(
        f"trailmark: internal error: {type(error).__name__}: {error}\n"
        "This is a bug. Run again with TRAILMARK_DEBUG=1 for the traceback, and report it."
    )
    return 1
