"""Where sensors sit, from the transforms that never change."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import Pose3

__all__ = ["StaticFrames"]

# REP-103: an optical frame has x right, y down, z forward; sensor axes are x forward, y left, z up.
_R_SENSOR_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
_DEEPEST = 50


class StaticFrames:
    """The tree of /tf_static."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Floats]] = {}

    def add(self, message: Any) -> None:
        """Take the transforms of a TFMessage; those that are none are left out."""
        for transform in message.transforms:
            T_parent_child = _matrix(transform.transform)
            if T_parent_child is not None:
                child, parent = (name.lstrip("/") for name in (transform.child_frame_id, transform.header.frame_id))
                self._parents[child] = parent, T_parent_child

    def mounting(self, base: str, frame: str) -> Pose3 | None:
        """Return ``pose_base_sensor`` of the sensor whose messages bear a frame; None: no way leads there.

        A frame with ``optical`` in its name has the axes of a picture, which are turned to those of a sensor.
        """
        T_base_frame = self._between(base.lstrip("/"), frame.lstrip("/"))
        if T_base_frame is None:
            return None
        if "optical" in frame:
            T_base_frame = T_base_frame.copy()
            T_base_frame[:3, :3] = T_base_frame[:3, :3] @ _R_SENSOR_OPTICAL.T
        return Pose3.from_matrix(T_base_frame)

    def _between(self, base: str, frame: str) -> Floats | None:
        up_from_base, up_from_frame = dict(self._ancestors(base)), dict(self._ancestors(frame))
        for name, T_name_frame in up_from_frame.items():
            if name in up_from_base:
                return np.asarray(np.linalg.inv(up_from_base[name]) @ T_name_frame)
        return None

    def _ancestors(self, frame: str) -> Iterable[tuple[str, Floats]]:
        """Yield a frame and those above it, each with the transform that takes coordinates of the frame there."""
        T_above_frame = np.eye(4)
        yield frame, T_above_frame
        name = frame
        for _ in range(_DEEPEST):  # a ring of transforms has no top
            if name not in self._parents:
                return
            name, T_parent_child = self._parents[name]
            T_above_frame = T_parent_child @ T_above_frame
            yield name, T_above_frame


def _matrix(transform: Any) -> Floats | None:
    q, t = transform.rotation, transform.translation
    norm = math.sqrt(q.x**2 + q.y**2 + q.z**2 + q.w**2)
    if not (math.isfinite(norm) and norm > 1e-6 and all(math.isfinite(value) for value in (t.x, t.y, t.z))):
        return None
    x, y, z, w = q.x / norm, q.y / norm, q.z / norm, q.w / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), t.x],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), t.y],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), t.z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
