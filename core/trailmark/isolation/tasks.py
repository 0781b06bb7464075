"""Teach, replay and stop on request: one run at a time, as a program of its own that ends as by Ctrl-C."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal

from trailmark.interruption import Lifeline
from trailmark.isolation.orphan import ENDS_WITH_STDIN

__all__ = ["Task", "TaskRunner", "task_command"]

logger = logging.getLogger(__name__)

Task = Literal["teach", "replay"]
_TASKS: Mapping[str, Task] = {"teach": "teach", "replay": "replay"}
#: How long a run has to end after each signal, before the next is sent [s].
_PATIENCE: Sequence[tuple[int, float]] = ((signal.SIGINT, 5.0), (signal.SIGTERM, 3.0), (signal.SIGKILL, 5.0))


def task_command(
    task: Task, config: Path, store: Path, *, settings: Sequence[str] = (), extra: Sequence[str] = ()
) -> list[str]:
    """Return the command line of a task; teaching replaces the path in the store.

    Parameters
    ----------
    task : {"teach", "replay"}
        What to do.
    config, store : Path
        Of the robot, and the path store that is written or followed.
    settings : sequence of str
        Overrides of the config, as of ``--set``.
    extra : sequence of str
        Further options.
    """
    line = [sys.executable, "-P", "-m", "trailmark.cli", task, str(config), "--store", str(store), *extra]
    line += [part for setting in settings for part in ("--set", setting)]
    return [*line, "--overwrite-store"] if task == "teach" else line


class TaskRunner:
    """Does ``teach``, ``replay`` and ``stop``, and says what is going on.

    One run at a time: another task while one is going on is refused. A run is a program of its own, so that one which
    fails leaves whoever asked for it. Stopping it is what Ctrl-C does: the robot is stopped at once, and the run ends
    in order. From any thread, one at a time.

    Parameters
    ----------
    command_of : callable
        Returns the command line of a task.
    say : callable
        Is told the state whenever it changes: ``idle``, a task, ``stopping teach``, ``idle: teach was stopped``.
    """

    def __init__(self, command_of: Callable[[Task], list[str]], say: Callable[[str], None]) -> None:
        self._command_of = command_of
        self._say_elsewhere = say
        self._running: _TaskProcess | None = None
        self._task = ""
        self._is_stopping = False
        self._lock, self._stop_lock = threading.RLock(), threading.RLock()
        self.state = ""

    @property
    def is_running(self) -> bool:
        """Whether a run is going on, or is being stopped."""
        return self._running is not None

    def begin(self) -> None:
        """Say that nothing is going on yet."""
        self._say("idle")

    def take(self, asked: str) -> str:
        """Do what is asked for; return why it is refused, empty where it is not."""
        if asked == "stop":
            self.stop()
            return ""
        with self._lock:
            task = _TASKS.get(asked)
            if task is None:
                refusal = f"{asked!r} is no task: teach, replay and stop are"
            elif self._running is not None:
                what = "being stopped" if self._is_stopping else "going on"
                refusal = f"{asked} is refused: {self._task} is {what}"
            else:
                refusal = self._start(task)
        if not refusal:
            return ""
        logger.warning("%s", refusal)
        return refusal

    def look(self) -> None:
        """Say so if the run has ended by itself."""
        with self._lock:
            if self._running is not None and not self._is_stopping and (code := self._running.poll()) is not None:
                self._running = None
                how = "ended" if code == 0 else f"ended with exit code {code}"
                self._say(f"idle: {self._task} {how}")

    def stop(self) -> None:
        """End the run that is going on, in order as Ctrl-C does; the robot is stopped at once.

        Whoever looks meanwhile is not held up; who stops it too waits for its end.
        """
        with self._stop_lock:
            with self._lock:
                running = self._running
                if running is None:
                    return
                self._is_stopping = True
                self._say(f"stopping {self._task}")
            try:
                running.end(self._task)
                with self._lock:
                    self._running = None
                    self._say(f"idle: {self._task} was stopped")
            finally:
                self._is_stopping = False

    def _start(self, task: Task) -> str:
        """Begin a task; return why it cannot begin, empty where it has."""
        logger.warning("%s begins", task)
        try:
            self._running = _TaskProcess(self._command_of(task))
        except OSError as error:
            return f"{task} cannot begin: {error.strerror or error}"
        self._task = task
        self._say(task)
        return ""

    def _say(self, state: str) -> None:
        if state != self.state:
            self.state = state
            logger.info("%s", state)
            self._say_elsewhere(state)


class _TaskProcess(Lifeline):
    """A run that goes on, in a session of its own: what a terminal sends reaches it through us, and once.

    A signal that ends our program stops its robot at once, whatever else goes on here; one that suspends our program
    suspends it too, after its robot.
    """

    def __init__(self, command: list[str]) -> None:
        environment = os.environ | {ENDS_WITH_STDIN: "1"}  # a pipe that is ours alone: it ends with us
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, env=environment, start_new_session=True)
        self._is_told = False
        self.__enter__()

    def poll(self) -> int | None:
        """Return the exit code, if it has ended."""
        code = self._process.poll()
        if code is not None:
            self.__exit__(None, None, None)
        return code

    def end(self, name: str) -> None:
        """Let it end in order; what does not end is ended."""
        for number, patience_s in _PATIENCE:
            if number != signal.SIGINT:
                self._process.send_signal(number)
            else:
                self.stop(name)
            try:
                self._process.wait(patience_s)
                break
            except subprocess.TimeoutExpired:
                logger.warning("%s does not end by signal %d", name, number)
        self.__exit__(None, None, None)

    def stop(self, reason: str) -> None:
        """Tell it to end; a second time would mean that it is to leave at once."""
        if not self._is_told:
            self._is_told = True
            self._process.send_signal(signal.SIGINT)

    def hold(self, reason: str) -> None:
        """Suspend it; it stops its robot before."""
        self._process.send_signal(signal.SIGTSTP)

    def release(self) -> None:
        """Let it go on."""
        self._process.send_signal(signal.SIGCONT)

    def mark(self, reason: str) -> None:
        """It marks itself."""

    def write(self, reason: str) -> None:
        """It writes itself."""
