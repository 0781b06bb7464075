"""Gives a command Ctrl-C at every line of the code that hears of it: what becomes of the process, a line each.

::

    python tests/signals/instants.py [STEP]         # every STEP-th line of `trailmark --version`
    python tests/signals/instants.py [STEP] run ... # of a run, once its toy robot has started; in an empty folder

A process is forked for each instant, all from one that has imported everything. A line is the number of the instant,
the exit code, and what the robot was told last.
"""

from __future__ import annotations

import os
import shutil
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import Any

from trailmark.cli import main

_HEARING = ("trailmark/cli/signals.py", "trailmark/interruption.py", "trailmark/cli/__init__.py", "contextlib.py")
_RUNNING = (
    *("pipeline/lifecycle.py", "pipeline/startup.py", "pipeline/pipeline.py", "pipeline/run/loop.py"),
    *("pipeline/ending/hangs.py", "pipeline/sources/stream.py", "trailmark/failures.py", "trailmark/cli/run.py"),
)
#: What `toy_robot.py` writes, and a run's folder.
LOG, OUT = Path("robot.log"), Path("out")


def run_until(nth_line: int, words: list[str]) -> None:
    """Run a command, with a signal at its nth line of the code that hears of signals; 99: it has not so many."""
    n_lines, has_begun = 0, not words
    code = (*_HEARING, *_RUNNING) if words else _HEARING

    def on_line(frame: FrameType, event: str, _: object) -> Any:
        nonlocal n_lines, has_begun
        if not frame.f_code.co_filename.endswith(code):
            return None
        if event == "line":
            has_begun = has_begun or LOG.exists()
            n_lines += has_begun
            if n_lines == nth_line:
                signal.raise_signal(signal.SIGINT)
        return on_line

    sys.argv = ["trailmark", *(words or ["--version"])]
    sys.settrace(on_line)
    try:
        main()
    finally:
        sys.settrace(None)
        if n_lines < nth_line:
            os._exit(99)


def every_instant(step: int, words: list[str]) -> None:
    """Print what becomes of a command at every `step`-th instant, until there are no more."""
    nth_line = 1
    while True:
        LOG.unlink(missing_ok=True)
        shutil.rmtree(OUT, ignore_errors=True)
        sys.stdout.flush()
        child = os.fork()
        if child == 0:
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            run_until(nth_line, words)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if code == 99:
            return
        told = LOG.read_text().splitlines()[-1:] if LOG.exists() else []
        print(nth_line, code, *(line.split(" ", 1)[1] for line in told))
        nth_line += step


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    every_instant(int(sys.argv[1]) if len(sys.argv) > 1 else 1, sys.argv[2:])
