"""Where sensors sit, from the transforms that never change."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from typing import Any

from trailmark.arrays import Floats
from trailmark.geometry import Pose3
from trailmark.sources.frame_tree import FrameTree, describe_mounting, is_optical, transforms_by_child

__all__ = ["mounting_of", "static_tree"]

logger = logging.getLogger(__name__)


def static_tree(messages: Iterable[Any]) -> FrameTree:
    """Return the transforms of the messages of ``/tf_static``; of one that is told twice, the last."""
    parents: dict[str, tuple[str, Floats | None]] = {}
    for message in messages:
        parents |= transforms_by_child(message)
    return FrameTree(parents)


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
