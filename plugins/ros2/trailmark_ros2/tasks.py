"""Teach, replay and stop by a topic: a server that starts runs as programs of their own, and ends them."""

from __future__ import annotations

import time
from collections.abc import Callable

from trailmark.isolation.tasks import Task, TaskRunner
from trailmark_ros2 import dds
from trailmark_ros2.message_types import new_message

__all__ = ["STRING", "TaskServer"]

STRING = "std_msgs/msg/String"

_LOOK_EVERY_S = 0.05


class TaskServer:
    """Hears ``teach``, ``replay`` and ``stop`` as std_msgs/String, and says what is going on the same way.

    What they do is `TaskRunner`'s. The state is latched: who comes late hears it.

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
        self._tasks = network.subscription(task, STRING, dds.Quality(depth=10))
        self._states = network.publisher(state, STRING, dds.Quality(is_latched=True, depth=1))
        self._runner = TaskRunner(command_of, self._send)

    def serve(self, is_over: Callable[[], bool] = lambda: False) -> None:
        """Work until it is over, or an exception; a run that is going on is ended then."""
        try:
            self._runner.begin()
            while not is_over():
                self.step()
                time.sleep(_LOOK_EVERY_S)
        finally:
            self._runner.stop()

    def step(self) -> None:
        """Do what was asked for since the last time, and say what has changed."""
        for message in self._tasks.messages():
            self._runner.take(str(message.data)[:40])
        self._runner.look()

    def _send(self, state: str) -> None:
        self._states.send(new_message(STRING, {"data": state}))
