"""Where sensors sit, from the transforms that never change."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from trailmark.arrays import Floats
from trailmark.geometry import Pose3
from trailmark.sources.frame_tree import FrameTree, describe_mounting, is_optical, transforms_by_child

if TYPE_CHECKING:
    from trailmark_ros2.feeds import TopicFeed

__all__ = ["mounting_of", "static_tree", "tell_of_frames"]

logger = logging.getLogger(__name__)

# A frame that sits so near to base, seen from above, and is turned so little about any axis, is base [m, rad].
_AT_BASE = 1e-3
_POSES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped")


def static_tree(messages: Iterable[Any], topic: str = "/tf_static") -> FrameTree:
    """Return the transforms of the messages of a topic; of one that is told twice, the last.

    A frame that is told to have two parents is warned of: which of them is told last is a matter of chance.
    """
    parents: dict[str, tuple[str, Floats | None]] = {}
    parent_names: dict[str, str] = {}
    for message in messages:
        for transform in message.transforms:
            child, now = transform.child_frame_id.lstrip("/"), transform.header.frame_id.lstrip("/")
            before = parent_names.get(child, now)
            if before != now:
                logger.warning("%s gives %s two parents, %s and %s; the latter is used", topic, child, before, now)
            parent_names[child] = now
        parents |= transforms_by_child(message)
    return FrameTree(parents)


def tell_of_frames(feed: TopicFeed, tree: FrameTree, *, base_frame: str, map_frame: str) -> None:
    """Warn of odometry that is not of base, and of poses that are not in the map: their numbers are taken as if.

    Parameters
    ----------
    feed : TopicFeed
        Of the topic; has had a message.
    tree : FrameTree
        What ``/tf_static`` says.
    base_frame, map_frame : str
        How the config calls base and map.
    """
    child, type_name = feed.child_frame_id, feed.subscription.type_name
    if child and not _is_at_base(tree, base_frame, child):
        logger.warning(
            "%s tells the way of %r, and is taken as that of base, %r (base_frame): right only where the two are one",
            feed.topic,
            child,
            base_frame,
        )
    if type_name in _POSES and feed.frame_id not in ("", map_frame.lstrip("/")):
        logger.warning(
            "%s tells poses in %r, and they are taken as in the map, %r (map_frame): right only where the two are one",
            feed.topic,
            feed.frame_id,
            map_frame,
        )


def _is_at_base(tree: FrameTree, base: str, frame: str) -> bool:
    """Return whether a frame is base, or above or below it, by ``/tf_static``."""
    if frame == base.lstrip("/"):
        return True
    try:
        mounting = tree.mounting(base, frame, is_optical=False)
    except ValueError:
        return False
    if mounting is None:
        return False
    return max(map(abs, (mounting.x, mounting.y, mounting.roll, mounting.pitch, mounting.yaw))) < _AT_BASE


def mounting_of(tree: FrameTree, base: str, sensor: str, *, frame: str, kind: str) -> tuple[Pose3 | None, str]:
    """Return `pose_base_sensor` and where it was found, or None and why not; the latter is warned of.

    Parameters
    ----------
    tree : FrameTree
        What ``/tf_static`` says.
    base : str
        Frame of base.
    sensor : str
        Of the run.
    frame : str
        That its messages bear.
    kind : str
        Of the sensor.
    """
    if not tree.parents:
        return None, ""
    why = f"nothing in /tf_static leads from {base!r} (base_frame) to {frame!r}"
    mounting: Pose3 | None = None
    try:
        mounting = tree.mounting(base, frame, is_optical=is_optical(kind, frame))
    except ValueError as error:
        why = str(error)
    if mounting is None:
        logger.warning("%s: %s: unless sensors: of the config says its mounting, it sits at base", sensor, why)
        return None, why
    return mounting, f"/tf_static ({base} -> {frame}: {describe_mounting(mounting)})"
