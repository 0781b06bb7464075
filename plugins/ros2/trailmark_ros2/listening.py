"""Whether the robot hears the commands that are sent to it."""

from __future__ import annotations

import logging
import time

from trailmark_ros2.dds import Network, Publisher
from trailmark_ros2.silence import reason_unheard

__all__ = ["ListenerWatch"]

logger = logging.getLogger(__name__)


class ListenerWatch:
    """Says when nobody reads a topic that we send, with the likely reason: the robot stands, and ROS says nothing.

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

    def check(self, network: Network) -> None:
        """Warn once that nobody reads the topic, and when somebody does again."""
        now_s = time.monotonic()
        if self._publisher.n_matched:
            if self._has_warned:
                logger.warning("%s is read now", self._topic)
            self._read_s, self._has_warned = now_s, False
        elif not self._has_warned and now_s - self._read_s > self._patience_s:
            self._has_warned = True
            others = [reader for reader in network.readers() if not network.is_own(reader)]
            why = reason_unheard(self._topic, self._type_name, others)
            logger.warning("the robot hears no command on %s: %s", self._topic, why)
