"""Teach, replay and stop by a topic: a server that starts runs as programs of their own, and ends them."""

from __future__ import annotations

import logging
import signal
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

from trailmark_ros2 import dds
from trailmark_ros2.message_types import new_message

__all__ = ["STRING", "TaskServer"]

logger = logging.getLogger(__name__)

STRING = "std_msgs/msg/String"

Task = Literal["teach", "replay"]
_TASKS: Mapping[str, Task] = {"teach": "teach", "replay": "replay"}
#: How long a run has to end after each signal, before the next is sent [s].
_PATIENCE: Sequence[tuple[int, float]] = ((signal.SIGINT, 5.0), (signal.SIGTERM, 3.0), (signal.SIGKILL, 5.0))
_LOOK_EVERY_S = 0.05


class TaskServer:
    """Hears ``teach``, ``replay`` and ``stop`` as std_msgs/String, and says what is going on the same way.

    One run at a time: another task while one is going on is refused. A run is a program of its own, so that one which
    fails leaves the server. The state is latched: who comes late hears it.

    Parameters
    ----------
    network : dds.Network
        Where to listen.
    task, state : str
        The two topics.
    command_of : callable
        Returns the command line of a task, ``teach`` or ``replay``.
    """

    def __init__(self, network: dds.Network, *, task: str, state: str, command_of: Callable[[Task], list[str]]) -> None:
        self._command_of = command_of
        self._tasks = network.subscription(task, STRING, dds.Quality(depth=10))
        self._states = network.publisher(state, STRING, dds.Quality(is_latched=True, depth=1))
        self._running: subprocess.Popen[bytes] | None = None
        self._task = ""
        self._said = ""

    def serve(self, is_over: Callable[[], bool] = lambda: False) -> None:
        """Work until it is over, or an exception; a run that is going on is ended then."""
        try:
            self._say("idle")
            while not is_over():
                self.step()
                time.sleep(_LOOK_EVERY_S)
        finally:
            self._end_run()

    def step(self) -> None:
        """Do what was asked for since the last time, and say what has changed."""
        for message in self._tasks.messages():
            self._take(message)
        if self._running is not None and (code := self._running.poll()) is not None:
            self._running = None
            self._say(f"idle: {self._task} ended" if code == 0 else f"idle: {self._task} ended with exit code {code}")

    def _take(self, message: Any) -> None:
        asked = str(message.data)[:40]
        if asked == "stop":
            self._end_run()
        elif (task := _TASKS.get(asked)) is None:
            logger.warning("%r is no task: teach, replay and stop are", asked)
        elif self._running is not None:
            logger.warning("%s is refused: %s is going on", asked, self._task)
        else:
            self._start_run(task)

    def _start_run(self, task: Task) -> None:
        self._task = task
        logger.warning("%s begins", task)
        self._running = subprocess.Popen(self._command_of(task), stdin=subprocess.DEVNULL)
        self._say(task)

    def _end_run(self) -> None:
        """End the run that is going on, in order as Ctrl-C does; the robot is stopped at once."""
        running, self._running = self._running, None
        if running is None:
            return
        self._say(f"stopping {self._task}")
        for number, patience_s in _PATIENCE:
            running.send_signal(number)
            try:
                running.wait(patience_s)
                break
            except subprocess.TimeoutExpired:
                logger.warning("%s does not end by signal %d", self._task, number)
        self._say(f"idle: {self._task} was stopped")

    def _say(self, state: str) -> None:
        if state != self._said:
            self._said = state
            logger.info("%s", state)
            self._states.send(new_message(STRING, {"data": state}))
