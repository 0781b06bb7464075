"""Why a topic is silent, in words, from what is seen of the network."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches

from trailmark_ros2.dds import Endpoint, Quality

__all__ = ["reason_of_silence", "reason_unheard"]


def reason_of_silence(
    topic: str, type_name: str | None, quality: Quality, writers: Sequence[Endpoint], domain: int
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
    domain : int
        The domain that is looked at.
    """
    own = [writer for writer in writers if writer.topic == topic]
    if not writers:
        return (
            f"nothing at all is seen in ROS domain {domain}: is the robot on, in the same domain (ROS_DOMAIN_ID),"
            " and does `interface` lead to it?"
        )
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
