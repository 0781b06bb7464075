"""DDS, by which ROS 2 talks; the only module that touches cyclonedds.

Bytes are taken and written as they are on the wire (`ddspy_take`, `ddspy_write`, a private layer: hence the pin to
version 11): the Python serialiser of cyclonedds takes 20 to 70 ms for a picture of 640 x 480, this 0.1 ms.
"""

from __future__ import annotations

import logging
import math
import os
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

from cyclonedds._clayer import ddspy_take, ddspy_write
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription
from cyclonedds.core import DDSException, InstanceState, Policy, Qos, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from trailmark.errors import ConfigError
from trailmark_ros2.message_types import deserialize, idl_type, ros_type_name, serialize, type_hash

__all__ = [
    "Endpoint",
    "Network",
    "Publisher",
    "Quality",
    "Sample",
    "Subscription",
    "Waiter",
    "default_domain",
    "open_domains",
]

logger = logging.getLogger(__name__)

LOOPBACK = "loopback"

# The name servers of DDS: each participant on a host takes a port of its own, and is asked there one by one.
_MAX_PARTICIPANTS = 32

# IgnoreTypeInformation: Cyclone 11 refuses the type objects of Fast DDS 3 and then silently gets nothing, while ROS
# says that it is matched (cyclonedds #2333). Without this line none of 200 messages arrives.
_CONFIG = """<CycloneDDS><Domain id="any">
<General>{general}</General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>{n}</MaxAutoParticipantIndex>{peers}</Discovery>
<Compatibility>
<IgnoreTypeInformation>1.15</IgnoreTypeInformation><AllowInvalidTryConstruct>true</AllowInvalidTryConstruct>
</Compatibility>
</Domain></CycloneDDS>"""

# Readers come and go more slowly than messages [s].
_LOOK_EVERY_S = 0.05

_ANY = SampleState.Any | ViewState.Any | InstanceState.Any

_domains: dict[int, tuple[str, Domain]] = {}
_domains_lock = threading.Lock()


@dataclass(frozen=True, slots=True)
class Quality:
    """How messages of a topic are delivered.

    Attributes
    ----------
    is_reliable : bool
        Whether lost ones are sent again; a best-effort writer and a reliable reader never match.
    is_latched : bool
        Whether who comes late gets the last ones (ROS: transient local).
    depth : int
        How many are kept.
    """

    is_reliable: bool = True
    is_latched: bool = False
    depth: int = 10

    def __str__(self) -> str:
        durability = ", transient local" if self.is_latched else ""
        return f"{'reliable' if self.is_reliable else 'best effort'}{durability}"


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A writer or reader that is on the network.

    Attributes
    ----------
    topic : str
        As ROS names it: ``/odom``.
    type_name : str
        As ROS names it: ``nav_msgs/msg/Odometry``.
    quality : Quality
        What it offers or asks for; the depth is not told.
    participant : str
        Identity of the program it belongs to.
    """

    topic: str
    type_name: str
    quality: Quality
    participant: str


@dataclass(frozen=True, slots=True)
class Sample:
    """A message as it came.

    Attributes
    ----------
    cdr : bytes
        The message.
    sent_s : float
        When its writer wrote it, in the writer's clock [s].
    writer : int
        Which writer: another number after it has been started again.
    """

    cdr: bytes
    sent_s: float
    writer: int


def default_domain() -> int:
    """Return the domain that ROS is told by ``ROS_DOMAIN_ID``; 0 without."""
    text = os.environ.get("ROS_DOMAIN_ID", "").strip()
    return int(text) if text.isdigit() else 0


def open_domains() -> set[int]:
    """Return the domains that this process has opened; they stay open until it ends."""
    return set(_domains)


class Network:
    """A place on the network: publishes, subscribes, and sees who is there.

    Parameters
    ----------
    domain : int
        Of ROS.
    interface : str
        ``loopback``: programs of this machine alone; else the name or address of a network interface.

    Raises
    ------
    ConfigError
        If the domain is open through another interface already, or the interface cannot be used.
    """

    def __init__(self, domain: int, interface: str = LOOPBACK) -> None:
        self.domain, self.interface = domain, interface
        _open_domain(domain, interface)
        self._participant: Any = DomainParticipant(domain)
        self._topics: dict[tuple[str, str], Any] = {}
        self._writers = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
        self._readers = BuiltinDataReader(self._participant, BuiltinTopicDcpsSubscription)
        self._key = str(self._participant.guid)

    def close(self) -> None:
        """Leave the network."""
        self._topics.clear()
        self._writers = self._readers = self._participant = None

    def publisher(self, topic: str, type_name: str, quality: Quality) -> Publisher:
        """Return a publisher of a topic."""
        writer = DataWriter(self._participant, self._topic(topic, type_name), qos=_qos(quality, type_name))
        return Publisher(writer, is_latched=quality.is_latched)

    def subscription(self, topic: str, type_name: str, quality: Quality) -> Subscription:
        """Return a subscription to a topic."""
        reader = DataReader(self._participant, self._topic(topic, type_name), qos=_qos(quality, type_name))
        return Subscription(topic, type_name, quality, reader)

    def writers(self) -> list[Endpoint]:
        """Return the writers of topics of ROS that are on the network, our own included."""
        return _endpoints(self._writers)

    def readers(self) -> list[Endpoint]:
        """Return the readers of topics of ROS that are on the network, our own included."""
        return _endpoints(self._readers)

    def is_own(self, endpoint: Endpoint) -> bool:
        """Return whether an endpoint is of this network object."""
        return endpoint.participant == self._key

    def waiter(self, subscriptions: Iterable[Subscription]) -> Waiter:
        """Return what waits for messages on any of the subscriptions."""
        return Waiter(self._participant, subscriptions)

    def _topic(self, topic: str, type_name: str) -> Any:
        key = topic, type_name
        if key not in self._topics:
            self._topics[key] = Topic(self._participant, f"rt{topic}", idl_type(type_name))
        return self._topics[key]


class Waiter:
    """Waits for messages."""

    def __init__(self, participant: Any, subscriptions: Iterable[Subscription]) -> None:
        self._set = WaitSet(participant)
        for subscription in subscriptions:
            self._set.attach(subscription.condition)

    def wait(self, timeout_s: float) -> None:
        """Return when a message has come, or after a time."""
        self._set.wait(max(1, int(1e9 * timeout_s)))


class Subscription:
    """Messages of one topic, as bytes.

    Attributes
    ----------
    topic, type_name : str
        As ROS names them.
    quality : Quality
        What was asked for.
    condition : object
        Waits for messages.
    """

    def __init__(self, topic: str, type_name: str, quality: Quality, reader: Any) -> None:
        self.topic, self.type_name, self.quality = topic, type_name, quality
        self._reader = reader
        self._has_warned = False
        self.condition = ReadCondition(reader, SampleState.NotRead | ViewState.Any | InstanceState.Any)

    def take(self, n: int = 64) -> list[Sample]:
        """Return the messages that have come, the oldest first."""
        taken = ddspy_take(self._reader._ref, _ANY, n)
        if isinstance(taken, int):
            raise DDSException(taken, f"while taking messages of {self.topic}")
        return [
            Sample(bytes(cdr), info.source_timestamp / 1e9, info.publication_handle)
            for cdr, info in taken
            if info.valid_data
        ]

    def messages(self, n: int = 64) -> list[Any]:
        """Return the messages that have come, deserialised; those that are none are left out, the first with a word."""
        return [message for sample in self.take(n) if (message := self.message_of(sample)) is not None]

    def message_of(self, sample: Sample) -> Any:
        """Return a message, deserialised; None, the first time with a word, for bytes that are none."""
        try:
            return deserialize(sample.cdr, self.type_name)
        except Exception as error:  # bytes from the network may be anything
            log = logger.debug if self._has_warned else logger.warning
            log("%s: a message cannot be read and is left out: %s: %s", self.topic, type(error).__name__, error)
            self._has_warned = True
        return None

    @property
    def n_matched(self) -> int:
        """How many writers it is matched with."""
        return int(self._reader.get_subscription_matched_status().current_count)

    @property
    def refused_policy(self) -> Literal["", "reliability", "durability", "another policy"]:
        """The policy for which a writer was refused, the last time; empty: none was."""
        status = self._reader.get_requested_incompatible_qos_status()
        if not status.total_count:
            return ""
        names: dict[int, Literal["reliability", "durability"]] = {11: "reliability", 2: "durability"}
        return names.get(int(status.last_policy_id), "another policy")


class Publisher:
    """Sends messages of one topic.

    Attributes
    ----------
    is_latched : bool
        Whether who comes late gets the last ones.
    """

    def __init__(self, writer: Any, *, is_latched: bool) -> None:
        self._writer, self.is_latched = writer, is_latched
        self._looked_s, self._is_read = -math.inf, False

    def send(self, message: Any) -> None:
        """Send a message of rosbags' types."""
        self.send_bytes(serialize(message))

    def send_bytes(self, cdr: bytes) -> None:
        """Send a message as CDR bytes."""
        code = ddspy_write(self._writer._ref, cdr)
        if code is not None and code < 0:
            raise DDSException(code, "while writing a message")

    def wait_for_acknowledgments(self, timeout_s: float) -> bool:
        """Wait until every reliable reader has everything; False: it took too long."""
        # Not by `wait_for_acks`, which stumbles over its own name of the code where the time is up (11.0.1).
        return bool(self._writer._wait_for_acks(self._writer._ref, duration(milliseconds=int(1000 * timeout_s))) == 0)

    @property
    def is_wanted(self) -> bool:
        """Whether a message is of use to anybody: there is a reader, or one that comes late gets the last message."""
        now_s = time.monotonic()
        if now_s - self._looked_s > _LOOK_EVERY_S:
            self._looked_s, self._is_read = now_s, self.n_matched > 0
        return self.is_latched or self._is_read

    @property
    def n_matched(self) -> int:
        """How many readers it is matched with."""
        return int(self._writer.get_publication_matched_status().current_count)


def _open_domain(domain: int, interface: str) -> None:
    with _domains_lock:
        if domain in _domains:
            if _domains[domain][0] != interface:
                raise ConfigError(
                    f"ROS domain {domain} is open on interface {_domains[domain][0]!r} already, and cannot be opened on"
                    f" {interface!r} too: give all parts of a run the same interface"
                )
            return
        try:
            _domains[domain] = interface, Domain(domain, _cyclone_config(interface))
        except DDSException as error:
            raise ConfigError(f"ROS domain {domain} cannot be opened on interface {interface!r}: {error}") from error


def _cyclone_config(interface: str) -> str:
    from xml.sax.saxutils import quoteattr

    if interface == LOOPBACK:
        general = (
            '<Interfaces><NetworkInterface address="127.0.0.1" multicast="false"/></Interfaces>'
            "<AllowMulticast>false</AllowMulticast>"
        )
        return _CONFIG.format(general=general, n=_MAX_PARTICIPANTS, peers='<Peers><Peer address="127.0.0.1"/></Peers>')
    key = "address" if interface[:1].isdigit() else "name"
    general = f"<Interfaces><NetworkInterface {key}={quoteattr(interface)}/></Interfaces>"
    return _CONFIG.format(general=general, n=_MAX_PARTICIPANTS, peers="")


def _qos(quality: Quality, type_name: str) -> Qos:
    policies = [
        Policy.Reliability.Reliable(duration(milliseconds=100))
        if quality.is_reliable
        else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if quality.is_latched else Policy.Durability.Volatile,
        Policy.History.KeepLast(quality.depth),
        Policy.Userdata(f"typehash={type_hash(type_name)};".encode()),  # ROS since Iron complains without
    ]
    return Qos(*policies)


def _endpoints(reader: Any) -> list[Endpoint]:
    found: dict[str, Endpoint] = {}
    for sample in reader.read(2000):
        topic = sample.topic_name
        if sample.sample_info.instance_state != InstanceState.Alive or not topic.startswith("rt/"):
            continue
        qos = sample.qos
        quality = Quality(Policy.Reliability.BestEffort not in qos, Policy.Durability.TransientLocal in qos, depth=0)
        endpoint = Endpoint(topic[2:], ros_type_name(sample.type_name), quality, str(sample.participant_key))
        found[str(sample.key)] = endpoint
    return list(found.values())
