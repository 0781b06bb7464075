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

_DISCOVERY_S = 0.6
_COUNTING_S = 1.2


def survey_network(where: str) -> list[dict[str, str]]:
    """Return the topics of a domain, within 2 s.

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
        time.sleep(_DISCOVERY_S)
        endpoints = [endpoint for endpoint in network.writers() if not network.is_own(endpoint)]
        readers = Counter(endpoint.topic for endpoint in network.readers() if not network.is_own(endpoint))
        by_topic: defaultdict[tuple[str, str], list[dds.Endpoint]] = defaultdict(list)
        for endpoint in endpoints:
            by_topic[endpoint.topic, endpoint.type_name].append(endpoint)
        rates_hz = _rates_hz(network, by_topic)
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


def _rates_hz(
    network: dds.Network, by_topic: defaultdict[tuple[str, str], list[dds.Endpoint]]
) -> dict[tuple[str, str], float]:
    """Count what comes of the topics whose types are known; latched messages that stood before count not."""
    known = [key for key in by_topic if is_known(key[1])]
    best_effort = dds.Quality(is_reliable=False, depth=1000)
    subscriptions = {key: network.subscription(*key, best_effort) for key in known}
    if not subscriptions:
        return {}
    waiter = network.waiter(subscriptions.values())
    stamps_s: defaultdict[tuple[str, str], list[float]] = defaultdict(list)
    until_s = time.monotonic() + _COUNTING_S
    while (left_s := until_s - time.monotonic()) > 0.0:
        waiter.wait(min(left_s, 0.1))
        for key, subscription in subscriptions.items():
            stamps_s[key] += [time.monotonic()] * len(subscription.take(1000))
    return {key: _rate_hz(stamps_s[key]) for key in known}


def _rate_hz(stamps_s: list[float]) -> float:
    if len(stamps_s) < 2 or stamps_s[-1] - stamps_s[0] < 0.1:
        return len(stamps_s) / _COUNTING_S
    return (len(stamps_s) - 1) / (stamps_s[-1] - stamps_s[0])
