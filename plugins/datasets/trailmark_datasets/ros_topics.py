"""Which topics of a recording become which sensors."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches

from trailmark.errors import SourceError
from trailmark.sources.ros_messages import IMAGE_TYPES, KINDS
from trailmark.sources.ros_poses import POSE_TYPES
from trailmark_datasets.config import RosbagConfig
from trailmark_datasets.ros_transforms import TRANSFORM_TYPES, frame_pair

__all__ = ["Choice", "choose_topics", "sensor_name"]


@dataclass(frozen=True, slots=True)
class Choice:
    """A topic and what it feeds.

    Attributes
    ----------
    sensor : str
        Name of the sensor.
    topic : str
        The topic.
    kind : str
        Kind of the sensor.
    is_named : bool
        Whether the config named it; others that turn out not to be understood are left out.
    pair : (str, str) or None
        Parent and child of the transform that is its odometry; None for any other message.
    """

    sensor: str
    topic: str
    kind: str
    is_named: bool
    pair: tuple[str, str] | None = None


def choose_topics(config: RosbagConfig, available: Mapping[str, str], where: str) -> list[Choice]:
    """Return the topics to read: those of the config, or all that are understood.

    Parameters
    ----------
    config : RosbagConfig
        Its `topics` and `rgbd`.
    available : mapping of str to str
        Topics that hold messages, and their types.
    where : str
        The recording, for messages.

    Raises
    ------
    SourceError
        If a topic is missing or of a type that is not understood, or two topics make the same name.
    """
    choices = []
    for name, two in config.rgbd.items():
        for topic in (two.colour, two.depth):
            _check_topic(topic, available, where, IMAGE_TYPES)
            choices.append(Choice(name, topic, "rgbd", True))
    if config.topics is not None:
        for name, topic in config.topics.items():
            pair = frame_pair(topic)
            if pair is not None:
                choices += [Choice(name, tf, "odometry", True, pair) for tf in _moving_transforms(available, where)]
                continue
            _check_topic(topic, available, where, (*KINDS, *POSE_TYPES))
            choices.append(Choice(name, topic, KINDS.get(available[topic], "pose"), True))
    else:
        paired = {choice.topic for choice in choices}
        rest = (topic for topic in sorted(available) if topic not in paired and available[topic] in KINDS)
        choices += [Choice(sensor_name(topic), topic, KINDS[available[topic]], False) for topic in rest]
    if not choices:
        raise SourceError(f"{where}: no topic is understood; topics: {_list_topics(available)}")
    _check_unique(choices, where)
    return choices


def _moving_transforms(available: Mapping[str, str], where: str) -> list[str]:
    found = [topic for topic, kind in available.items() if kind in TRANSFORM_TYPES and not topic.endswith("tf_static")]
    if not found:
        raise SourceError(f"{where}: no topic holds transforms that move (/tf); topics: {_list_topics(available)}")
    return found


def sensor_name(topic: str) -> str:
    """Return the sensor's name of a topic: ``/front/image_raw`` becomes ``front_image_raw``."""
    name = re.sub(r"[^a-z0-9]+", "_", topic.lower()).strip("_")
    return name if name[:1].isalpha() else f"topic_{name}"


def _check_topic(topic: str, available: Mapping[str, str], where: str, types: tuple[str, ...]) -> None:
    if topic not in available:
        close = get_close_matches(topic, available, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        raise SourceError(f"{where}: no messages on topic {topic!r}{hint}; topics: {_list_topics(available)}")
    if available[topic] not in types:
        raise SourceError(
            f"{where}: topic {topic!r} is of type {available[topic]}; understood here: {', '.join(types)}"
        )


def _check_unique(choices: list[Choice], where: str) -> None:
    by_name: dict[str, Choice] = {}
    for choice in choices:
        other = by_name.setdefault(choice.sensor, choice)
        is_same = other.kind == choice.kind == "rgbd" or (other.pair is not None and other.pair == choice.pair)
        if other is not choice and not is_same:
            raise SourceError(
                f"{where}: topics {other.topic} and {choice.topic} both make a sensor {choice.sensor!r};"
                " name them in topics: {name: /topic}"
            )


def _list_topics(available: Mapping[str, str]) -> str:
    return ", ".join(f"{topic} ({kind})" for topic, kind in sorted(available.items())) or "none"
