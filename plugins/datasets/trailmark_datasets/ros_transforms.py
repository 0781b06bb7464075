"""Transforms in recordings of ROS: where sensors are mounted (``/tf_static``), and one transform followed over time."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import SourceError
from trailmark.geometry import Pose2, Pose3
from trailmark.sources.ros_messages import planar_pose, stamp_of
from trailmark_datasets.bagfile import BagFile
from trailmark_datasets.planar import OPTICAL

__all__ = ["TRANSFORM_TYPES", "FrameTree", "expect_transform", "frame_pair", "planar_transforms", "read_static_tree"]

#: Types of messages that hold transforms.
TRANSFORM_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")

_STATIC_TOPIC = "tf_static"
_BASES = ("base_link", "base_footprint", "base")
_SMALLEST_NORM = 1e-6


def frame_pair(text: str) -> tuple[str, str] | None:
    """Return parent and child of ``"PARENT -> CHILD"``; None where the text is a topic."""
    parent, arrow, child = (part.strip().lstrip("/") for part in text.partition("->"))
    return (parent, child) if arrow else None


@dataclass(frozen=True, slots=True)
class FrameTree:
    """Frames that never move against each other, each with its parent.

    Attributes
    ----------
    parents : mapping of str to (str, (4, 4) float or None)
        Of a child: the parent and ``T_parent_child``, None where its quaternion is zero or not finite.
    """

    parents: Mapping[str, tuple[str, Floats | None]]

    @property
    def frames(self) -> frozenset[str]:
        """All frames of the tree."""
        return frozenset(self.parents) | frozenset(parent for parent, _ in self.parents.values())

    def base(self, wanted: str | None, where: str) -> str | None:
        """Return the frame that is base: the one that is wanted, else one of the usual names that is there.

        Raises
        ------
        SourceError
            If the one that is wanted is not there.
        """
        if wanted is None:
            return next((name for name in _BASES if name in self.frames), None)
        name = wanted.lstrip("/")
        if name not in self.frames:
            close = get_close_matches(name, self.frames, n=1)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            known = ", ".join(sorted(self.frames)) or "none"
            raise SourceError(f"{where}: base_frame {wanted!r} is not in /tf_static{hint}; frames: {known}")
        return name

    def mounting(self, base: str, frame: str, where: str, *, is_optical: bool) -> Pose3 | None:
        """Return `pose_base_sensor` of the sensor in a frame; None where nothing leads from base to it.

        Raises
        ------
        SourceError
            If a transform on the way has no orientation.
        """
        to_base, to_frame = self._way_up(base), self._way_up(frame.lstrip("/"))
        shared = next((name for name in to_base if name in to_frame), None)
        if shared is None:
            return None
        T_shared_base = self._product(to_base[: to_base.index(shared)], where)
        T_shared_frame = self._product(to_frame[: to_frame.index(shared)], where)
        T_base_frame = np.linalg.inv(T_shared_base) @ T_shared_frame
        if is_optical:
            T_base_frame[:3, :3] = T_base_frame[:3, :3] @ OPTICAL.T
        return Pose3.from_matrix(T_base_frame)

    def _way_up(self, frame: str) -> list[str]:
        """Return the frame, its parent, and so on; a circle is left where it closes."""
        way = [frame]
        while way[-1] in self.parents and self.parents[way[-1]][0] not in way:
            way.append(self.parents[way[-1]][0])
        return way

    def _product(self, way: Iterable[str], where: str) -> Floats:
        """Return ``T_top_frame`` of the frames from a frame up to the one below the top."""
        product: Floats = np.eye(4)
        for child in way:
            parent, T_parent_child = self.parents[child]
            if T_parent_child is None:
                raise SourceError(
                    f"{where}: /tf_static gives {parent} -> {child} a quaternion that is zero or not finite;"
                    " set tf_static: false and say the mounting in the config"
                )
            product = T_parent_child @ product
        return product


def read_static_tree(bag: BagFile) -> FrameTree:
    """Return the transforms of ``/tf_static``, under whatever namespace; of one that is told twice, the last."""
    topics = [name for name, kind in bag.topics.items() if kind in TRANSFORM_TYPES and name.endswith(_STATIC_TOPIC)]
    parents: dict[str, tuple[str, Floats | None]] = {}
    for message in bag.messages(topics):
        if isinstance(message, SourceError):
            raise message
        for transform in message.content.transforms:
            child = transform.child_frame_id.lstrip("/")
            parents[child] = (transform.header.frame_id.lstrip("/"), _matrix(transform.transform))
    return FrameTree(parents)


def _matrix(move: Any) -> Floats | None:
    """Return the (4, 4) matrix of a Transform message; None where it is no transform."""
    q = np.array([move.rotation.x, move.rotation.y, move.rotation.z, move.rotation.w], float)
    t = np.array([move.translation.x, move.translation.y, move.translation.z], float)
    norm = math.hypot(*q)  # which does not overflow
    if not (np.isfinite(norm) and np.all(np.isfinite(t)) and norm > _SMALLEST_NORM):
        return None
    x, y, z, w = q / norm
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = t
    return matrix


def planar_transforms(message: Any, pair: tuple[str, str], where: str) -> Iterator[tuple[float, Pose2]]:
    """Yield stamp [s] and pose of the child in the parent's plane, as often as a message tells the pair.

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
