"""Gives a command Ctrl-C at every line of the code that hears of it: what becomes of the process, a line each.

::

    python tests/signals/instants.py [STEP]         # every STEP-th line

A process is forked for each instant, all from one that has imported everything.
"""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType
from typing import Any

from trailmark.cli import main

_CODE = ("trailmark/cli/signals.py", "trailmark/interruption.py", "trailmark/cli/__init__.py", "contextlib.py")


def run_until(nth_line: int) -> None:
    """Run a command, with a signal at its nth line of the code that hears of signals; 99: it has not so many."""
    n_lines = 0

    def on_line(frame: FrameType, event: str, _: object) -> Any:
        nonlocal n_lines
        if not frame.f_code.co_filename.endswith(_CODE):
            return None
        if event == "line":
            n_lines += 1
            if n_lines == nth_line:
                signal.raise_signal(signal.SIGINT)
        return on_line

    sys.argv = ["trailmark", "--version"]
    sys.settrace(on_line)
    try:
        main()
    finally:
        sys.settrace(None)
        if n_lines < nth_line:
            os._exit(99)


def every_instant(step: int) -> None:
    """Print what becomes of a command at every `step`-th instant, until there are no more."""
    nth_line = 1
    while True:
        sys.stdout.flush()
        child = os.fork()
        if child == 0:
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            run_until(nth_line)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if code == 99:
            return
        print(nth_line, code)
        nth_line += step


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    every_instant(int(sys.argv[1]) if len(sys.argv) > 1 else 1)
