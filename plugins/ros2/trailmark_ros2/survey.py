"""What is on a network of ROS 2: topics, types, how they are delivered, how often."""

from __future__ import annotations

import time
from collections import Counter, defaultdict

from trailmark.errors import ConfigError, SourceError
from trailmark_ros2 import dds
from trailmark_ros2.message_types import is_known
from trailmark_ros2.readings import UNDERSTOOD
from trailmark_ros2.silence import reason_of_emptiness

__all__ = ["survey_network"]

#: How long to look; longer, until somebody is seen, and then so long at least [s].
_LOOK_S, _PATIENCE_S, _COUNTING_S = 1.8, 4.0, 1.2
_LOOK_EVERY_S = 0.05
# A rate that was counted for less is none [s].
_LEAST_S = 0.3


def survey_network(where: str) -> list[dict[str, str]]:
    """Return the topics of a domain, within 2 s; within 4 s where nobody is seen at first.

    Parameters
    ----------
    where : str
        ``DOMAIN`` or ``DOMAIN/INTERFACE``; empty: the domain of the environment, on loopback.

    Raises
    ------
    ConfigError
        If that is no domain, or the interface cannot be used.
    SourceError
        If nobody is there, with the likely reasons.
    """
    number, _, interface = where.partition("/")
    if number and not (number.isdigit() and int(number) <= 232):
        raise ConfigError(f"ros2://{where}: {number!r} is no domain of ROS; write ros2://0, or ros2://0/eth0")
    network = dds.Network(int(number) if number else dds.default_domain(), interface or dds.LOOPBACK)
    try:
        rates_hz = _rates_hz(network)
        readers = Counter(endpoint.topic for endpoint in network.readers() if not network.is_own(endpoint))
        by_topic: defaultdict[tuple[str, str], list[dds.Endpoint]] = defaultdict(list)
        for endpoint in _writers_of_others(network):
            by_topic[endpoint.topic, endpoint.type_name].append(endpoint)
        rows = [_row(*key, writers, rates_hz.get(key), readers) for key, writers in sorted(by_topic.items())]
    finally:
        network.close()
    if not rows and not readers:
        raise SourceError(reason_of_emptiness(network.domain, network.interface))
    written = {topic for topic, _ in by_topic}
    return rows + [
        {"topic": topic, "type": "", "writers": "0", "readers": str(n), "quality": "", "rate": "", "sensor": ""}
        for topic, n in sorted(readers.items())
        if topic not in written
    ]


def _row(
    topic: str, type_name: str, writers: list[dds.Endpoint], rate_hz: float | None, readers: Counter[str]
) -> dict[str, str]:
    return {
        "topic": topic,
        "type": type_name,
        "writers": str(len(writers)),
        "readers": str(readers[topic]),
        "quality": " / ".join(sorted({str(writer.quality) for writer in writers})),
        "rate": "unknown" if rate_hz is None else f"{rate_hz:.3g} Hz",
        "sensor": "" if topic == "/tf_static" else UNDERSTOOD.get(type_name, ""),
    }


def _writers_of_others(network: dds.Network) -> list[dds.Endpoint]:
    return [endpoint for endpoint in network.writers() if not network.is_own(endpoint)]


def _rates_hz(network: dds.Network) -> dict[tuple[str, str], float]:
    """Count what comes of the topics whose types are known; latched messages that stood before count not.

    Programs are found by and by, Fast DDS within 0.1 to 1.2 s: a topic is listened to once it is seen, and where nobody
    is seen at all one waits longer.
    """
    best_effort = dds.Quality(is_reliable=False, depth=1000)
    subscriptions: dict[tuple[str, str], dds.Subscription] = {}
    begun_s: dict[tuple[str, str], float] = {}
    stamps_s: defaultdict[tuple[str, str], list[float]] = defaultdict(list)
    began_s = time.monotonic()
    until_s = began_s + _PATIENCE_S
    waiter = network.waiter(())
    while (now_s := time.monotonic()) < until_s:
        writers = _writers_of_others(network)
        if until_s == began_s + _PATIENCE_S and (writers or network.readers()):
            until_s = max(began_s + _LOOK_S, now_s + _COUNTING_S)
        seen = {(writer.topic, writer.type_name) for writer in writers if is_known(writer.type_name)}
        new = seen - subscriptions.keys()
        for key in new:
            subscriptions[key], begun_s[key] = network.subscription(*key, best_effort), now_s
        if new:
            waiter = network.waiter(subscriptions.values())
        waiter.wait(_LOOK_EVERY_S)
        for key, subscription in subscriptions.items():
            stamps_s[key] += [time.monotonic()] * len(subscription.take(1000))
    counted_s = {key: time.monotonic() - key_begun_s for key, key_begun_s in begun_s.items()}
    return {key: _rate_hz(stamps_s[key], counted_s[key]) for key in subscriptions if counted_s[key] >= _LEAST_S}


def _rate_hz(stamps_s: list[float], counted_s: float) -> float:
    if len(stamps_s) < 2 or stamps_s[-1] - stamps_s[0] < 0.1:
        return len(stamps_s) / counted_s
    return (len(stamps_s) - 1) / (stamps_s[-1] - stamps_s[0])
