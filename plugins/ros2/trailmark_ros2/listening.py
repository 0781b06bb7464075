"""Whether the robot hears the commands that are sent to it, and ours alone."""

from __future__ import annotations

import logging
import time

from trailmark_ros2.dds import Network, Publisher
from trailmark_ros2.silence import reason_unheard

__all__ = ["ListenerWatch"]

logger = logging.getLogger(__name__)


class ListenerWatch:
    """Says when nobody reads a topic that we send, with the likely reason: the robot stands, and ROS says nothing.

    It says also who else sends it: the robot then follows whoever spoke last.

    Parameters
    ----------
    publisher : Publisher
        Of the topic.
    topic, type_name : str
        As ROS names them.
    patience_s : float
        How long nobody may read it [s].
    """

    def __init__(self, publisher: Publisher, topic: str, type_name: str, patience_s: float) -> None:
        self._publisher, self._topic, self._type_name = publisher, topic, type_name
        self._patience_s = patience_s
        self._read_s = time.monotonic()
        self._has_warned = False
        self._has_rivals = False

    def check(self, network: Network) -> None:
        """Warn once that nobody reads the topic, when somebody does again, and when another begins to send it."""
        now_s = time.monotonic()
        n_rivals = sum(writer.topic == self._topic and not network.is_own(writer) for writer in network.writers())
        if n_rivals and not self._has_rivals:
            logger.warning(
                "%s is sent by another program too: the robot follows whoever spoke last, also after a stop of ours;"
                " end the other, or let a multiplexer choose (twist_mux)",
                self._topic,
            )
        self._has_rivals = n_rivals > 0
        if self._publisher.n_matched:
            if self._has_warned:
                logger.warning("%s is read now", self._topic)
            self._read_s, self._has_warned = now_s, False
        elif not self._has_warned and now_s - self._read_s > self._patience_s:
            self._has_warned = True
            others = [reader for reader in network.readers() if not network.is_own(reader)]
            why = reason_unheard(self._topic, self._type_name, others)
            logger.warning("the robot hears no command on %s: %s", self._topic, why)
