"""At the start: waiting for the robot's topics, and learning what they are."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from trailmark.errors import SourceError
from trailmark_ros2.dds import Endpoint, Network, Quality
from trailmark_ros2.readings import UNDERSTOOD
from trailmark_ros2.silence import reason_of_emptiness, reason_of_silence

__all__ = ["MetTopic", "Patience", "first_message", "meet_writers"]

logger = logging.getLogger(__name__)

_LOOK_EVERY_S = 0.05


class MetTopic:
    """A topic with what its writers offer.

    Attributes
    ----------
    type_name : str
        Of its messages.
    quality : Quality
        What every writer of it can serve.
    """

    def __init__(self, writers: Sequence[Endpoint], type_name: str, depth: int) -> None:
        self.type_name = type_name
        self.quality = Quality(all(writer.quality.is_reliable for writer in writers), depth=depth)


class Patience:
    """Waits until something holds; says once, after `silence_s`, what is missing; in the end gives up.

    Parameters
    ----------
    closed : Event
        Set when the source is closed meanwhile.
    silence_s, timeout_s : float
        When to say it, and when to give up [s].
    """

    def __init__(self, closed: threading.Event, silence_s: float, timeout_s: float) -> None:
        self._closed, self._silence_s, self._timeout_s = closed, silence_s, timeout_s
        self._began_s = time.monotonic()
        self._has_spoken = False

    def wait_until(self, holds: Callable[[], bool], missing: Callable[[], str]) -> None:
        """Return when it holds.

        Raises
        ------
        SourceError
            If it does not in time, or the source is closed.
        """
        while not holds():
            waited_s = time.monotonic() - self._began_s
            if waited_s > self._timeout_s:
                raise SourceError(f"{missing()} (waited for {waited_s:.0f} s; start_timeout_s)")
            if waited_s > self._silence_s and not self._has_spoken:
                self._has_spoken = True
                logger.warning("waiting for the robot: %s", missing())
            if self._closed.wait(_LOOK_EVERY_S):
                raise SourceError("closed while waiting for the robot")


def meet_writers(
    network: Network, wanted: Mapping[str, str | None], patience: Patience, depth: int
) -> dict[str, MetTopic]:
    """Wait until every topic has a writer of a type that is understood.

    Parameters
    ----------
    network : Network
        Where to look.
    wanted : mapping of str to (str or None)
        Topics, and the types that the config says.
    patience : Patience
        How long.
    depth : int
        How many messages may wait.

    Raises
    ------
    SourceError
        If a topic is sent as another type than is asked for, or as one that is not understood, or not at all.
    """
    met: dict[str, MetTopic] = {}

    def look() -> bool:
        others = [writer for writer in network.writers() if not network.is_own(writer)]
        for topic, type_name in wanted.items():
            own = [writer for writer in others if writer.topic == topic]
            if topic in met or not own:
                continue
            fitting = [writer for writer in own if type_name in (None, writer.type_name)]
            if not fitting:
                raise SourceError(f"{topic} is sent as {own[0].type_name}, and the config asks for {type_name}")
            found = fitting[0].type_name
            if found not in UNDERSTOOD:
                raise SourceError(f"{topic} is sent as {found}; understood are {', '.join(sorted(UNDERSTOOD))}")
            met[topic] = MetTopic([writer for writer in fitting if writer.type_name == found], found, depth)
        return len(met) == len(wanted)

    def missing() -> str:
        others = [writer for writer in network.writers() if not network.is_own(writer)]
        if not others:
            return reason_of_emptiness(network.domain, network.interface)
        return "; ".join(
            f"{topic}: {reason_of_silence(topic, type_name, Quality(False), others, network)}"
            for topic, type_name in wanted.items()
            if topic not in met
        )

    patience.wait_until(look, missing)
    return met


def first_message(network: Network, topic: str, type_name: str, quality: Quality, timeout_s: float) -> list[Any]:
    """Return what comes on a topic at once: of a latched one what stands, of another the first message."""
    if not any(writer.topic == topic and writer.type_name == type_name for writer in network.writers()):
        return []
    subscription = network.subscription(topic, type_name, quality)
    waiter = network.waiter([subscription])
    found: list[Any] = []
    deadline_s = time.monotonic() + timeout_s
    while time.monotonic() < deadline_s:
        waiter.wait(0.05)
        messages = subscription.messages()
        found += messages
        if found and (not messages or not quality.is_latched):
            break
    return found
