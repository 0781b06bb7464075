"""Transforms in recordings of ROS: where sensors are mounted (``/tf_static``), and one transform followed over time."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from trailmark.arrays import Floats
from trailmark.errors import SourceError
from trailmark.geometry import Pose2
from trailmark.sources.frame_tree import FrameTree, transforms_by_child
from trailmark.sources.ros_messages import planar_pose, stamp_of
from trailmark_datasets.bagfile import BagFile

__all__ = [
    "TRANSFORM_TYPES",
    "base_frame_of",
    "expect_transform",
    "frame_pair",
    "planar_transforms",
    "read_static_tree",
]

#: Types of messages that hold transforms.
TRANSFORM_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")

_STATIC_TOPIC = "tf_static"
_BASES = ("base_link", "base_footprint", "base")


def frame_pair(text: str) -> tuple[str, str] | None:
    """Return parent and child of ``"PARENT -> CHILD"``; None where the text is a topic."""
    parent, arrow, child = (part.strip().lstrip("/") for part in text.partition("->"))
    return (parent, child) if arrow else None


def base_frame_of(tree: FrameTree, wanted: str | None, where: str) -> str | None:
    """Return the frame that is base: the one that is wanted, else one of the usual names that is there.

    Raises
    ------
    SourceError
        If the one that is wanted is not there.
    """
    if wanted is None:
        return next((name for name in _BASES if name in tree.frames), None)
    name = wanted.lstrip("/")
    if name not in tree.frames:
        close = get_close_matches(name, tree.frames, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ""
        known = ", ".join(sorted(tree.frames)) or "none"
        raise SourceError(f"{where}: base_frame {wanted!r} is not in /tf_static{hint}; frames: {known}")
    return name


def read_static_tree(bag: BagFile) -> FrameTree:
    """Return the transforms of ``/tf_static``, under whatever namespace; of one that comes twice, the last."""
    topics = [name for name, kind in bag.topics.items() if kind in TRANSFORM_TYPES and name.endswith(_STATIC_TOPIC)]
    parents: dict[str, tuple[str, Floats | None]] = {}
    for message in bag.messages(topics):
        if isinstance(message, SourceError):
            raise message
        parents |= transforms_by_child(message.content)
    return FrameTree(parents)


def planar_transforms(message: Any, pair: tuple[str, str], where: str) -> Iterator[tuple[float, Pose2]]:
    """Yield stamp [s] and pose of the child in the parent's plane, for each message that has the pair.

    Raises
    ------
    ValueError
        If an orientation is none.
    """
    for transform in message.transforms:
        if (transform.header.frame_id.lstrip("/"), transform.child_frame_id.lstrip("/")) == pair:
            move = transform.transform
            yield stamp_of(transform, where), planar_pose(_TransformAsPose(move.translation, move.rotation))


def expect_transform(bag: BagFile, topics: Collection[str], pair: tuple[str, str]) -> None:
    """Refuse a transform that never comes, naming those that do.

    Raises
    ------
    SourceError
        If no message of the topics holds it.
    """
    seen: set[tuple[str, str]] = set()
    for message in bag.messages(topics):
        if isinstance(message, SourceError):
            continue  # said when the recording is read
        for one in message.content.transforms:
            seen.add((one.header.frame_id.lstrip("/"), one.child_frame_id.lstrip("/")))
        if pair in seen:
            return
    known = ", ".join(f"'{parent} -> {child}'" for parent, child in sorted(seen)) or "none"
    raise SourceError(f"{bag.path}: no transform '{pair[0]} -> {pair[1]}' in {', '.join(topics)}; there are {known}")


@dataclass(frozen=True, slots=True)
class _TransformAsPose:
    position: Any
    orientation: Any
