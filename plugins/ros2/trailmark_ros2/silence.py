"""Why a topic is silent, in words, from what is seen of the network."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path

from trailmark_ros2.dds import LOOPBACK, Endpoint, Network, Quality, open_domains

__all__ = ["reason_of_emptiness", "reason_of_silence", "reason_unheard"]

#: Where Linux lists the UDP ports that programs of this machine listen at.
_UDP_PORTS = Path("/proc/net/udp")
#: DDS asks for the programs of a domain at one port, and gives each a port of its own from the tenth on.
_FIRST_PORT, _PORTS_OF_A_DOMAIN, _FIRST_OWN_PORT = 7400, 250, 10
#: From here on the system gives ports to whoever asks for any.
_ANY_PORT = 32768
_MOST_NAMED = 5


def reason_of_emptiness(domain: int, interface: str) -> str:
    """Return the likely reasons why nobody is seen on a network, and what to do, in two lines.

    Parameters
    ----------
    domain : int
        The domain that is looked at.
    interface : str
        Through what: ``loopback``, or the name or address of a network interface.
    """
    others = sorted(_domains_of_others())[:_MOST_NAMED]
    hint = f"; in use on this machine: domain {', '.join(map(str, others))}" if others else ""
    where = "on loopback: no program of this machine is there" if interface == LOOPBACK else f"through {interface}"
    if interface == LOOPBACK:
        advice = (
            f"Is the robot's software running, with ROS_DOMAIN_ID={domain}? If it is on another machine or in a"
            f" container, or its RMW is Cyclone DDS, name the network interface (interface: eth0, or ros2://{domain}/eth0)."
        )
    else:
        advice = (
            f"Is the robot on, in the same network, with ROS_DOMAIN_ID={domain}? There, ROS_AUTOMATIC_DISCOVERY_RANGE="
            "LOCALHOST or OFF (ROS_LOCALHOST_ONLY=1 until Humble) hides it, and so does a firewall or a network that"
            " carries no multicast (many Wi-Fi, VPN and containers)."
        )
    no_dds = "A robot with RMW_IMPLEMENTATION=rmw_zenoh_cpp speaks no DDS, and is never seen"
    return f"nothing at all is seen in ROS domain {domain} {where}{hint}\n{advice} {no_dds}"


def _domains_of_others() -> set[int]:
    """Return the domains of which programs of this machine have ports open, without those that are open here."""
    try:
        lines = _UDP_PORTS.read_text(encoding="ascii").splitlines()[1:]
        ports = {int(line.split()[1].rpartition(":")[2], 16) for line in lines}
    except (OSError, ValueError, IndexError):
        return set()  # another system, or none that tells
    places = (divmod(port - _FIRST_PORT, _PORTS_OF_A_DOMAIN) for port in ports if _FIRST_PORT <= port < _ANY_PORT)
    return {domain for domain, place in places if place in (0, _FIRST_OWN_PORT)} - open_domains()


def reason_of_silence(
    topic: str,
    type_name: str | None,
    quality: Quality,
    writers: Sequence[Endpoint],
    network: Network,
) -> str:
    """Return the likely reason why no message comes on a topic.

    Parameters
    ----------
    topic : str
        The topic.
    type_name : str or None
        Type that is asked for; None: any.
    quality : Quality
        What is asked for.
    writers : sequence of Endpoint
        All writers of others that are on the network.
    network : Network
        What is looked at.
    """
    own = [writer for writer in writers if writer.topic == topic]
    if not writers:
        return reason_of_emptiness(network.domain, network.interface)
    if not own:
        return f"nobody sends it{_others(topic, writers)}"
    others = sorted({writer.type_name for writer in own} - {type_name})
    if type_name is not None and all(writer.type_name != type_name for writer in own):
        return f"it is sent as {', '.join(others)}, and was asked for as {type_name}"
    fitting = [writer for writer in own if type_name in (None, writer.type_name)]
    if quality.is_reliable and not any(writer.quality.is_reliable for writer in fitting):
        return "its writer is best effort, and it was asked for as reliable: they never match"
    if quality.is_latched and not any(writer.quality.is_latched for writer in fitting):
        return "its writer keeps nothing for who comes later (volatile), and it was asked for as transient local"
    return (
        "its writer is there and fits, but sends nothing; if other programs get its messages, look whether the"
        " definitions of the type are the same"
    )


def reason_unheard(topic: str, type_name: str, readers: Sequence[Endpoint]) -> str:
    """Return the likely reason why nobody hears what we send on a topic, reliably and volatile.

    Parameters
    ----------
    topic, type_name : str
        The topic, and as what it is sent.
    readers : sequence of Endpoint
        All readers of others that are on the network.
    """
    own = [reader for reader in readers if reader.topic == topic]
    if not own:
        return f"nobody reads it{_others(topic, readers)}"
    types = sorted({reader.type_name for reader in own})
    if type_name not in types:
        return f"it is read as {', '.join(types)}, and sent as {type_name}"
    if all(reader.quality.is_latched for reader in own if reader.type_name == type_name):
        return "its reader asks for what was sent before it came (transient local): they never match"
    return "its reader is there and fits, but is not matched; are the definitions of the type the same?"


def _others(topic: str, endpoints: Sequence[Endpoint]) -> str:
    names = sorted({endpoint.topic for endpoint in endpoints})
    close = get_close_matches(topic, names, n=1)
    hint = f" (did you mean {close[0]}?)" if close else ""
    return f"{hint}; there are {', '.join(names)}" if names else ""
