"""Signals that end a bench, and how it ends then: as by Ctrl-C, and with their own exit code."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import click

from trailmark.cli.errors import say

__all__ = ["ended_by_signals"]

_NAMES = ("SIGTERM", "SIGHUP")  # Windows knows no hang-up


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Let SIGTERM and SIGHUP end what goes on here as Ctrl-C does; the exit code is then 128 and the signal's number.

    A signal that is ignored, as a hang-up under ``nohup``, stays so. A second one ends nothing sooner: cells are
    killed at the first.
    """
    numbers = [getattr(signal, name) for name in _NAMES if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    before = {number: handler for number, handler in before.items() if handler is not signal.SIG_IGN}
    received: list[int] = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        received.append(number)
        if len(received) == 1:
            raise KeyboardInterrupt

    for number in before:
        signal.signal(number, interrupt)
    try:
        yield
    except KeyboardInterrupt:
        say("interrupted: what is finished is kept; the same command goes on")
        if received:
            raise click.exceptions.Exit(128 + received[0]) from None
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
