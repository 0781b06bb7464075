"""Where the sensors of a robot of ROS are mounted: the frames of ``/tf_static``, recorded or live."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import Pose3

__all__ = ["R_SENSOR_OPTICAL", "FrameTree", "describe_mounting", "is_optical", "transforms_by_child"]

#: Optical axes (x right, y down, z forward) in sensor axes (x forward, y left, z up), REP-103: columns are the
#: optical axes as the sensor sees them.
R_SENSOR_OPTICAL: Floats = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])

_SMALLEST_NORM = 1e-6


def is_optical(kind: str, frame: str) -> bool:
    """Return whether the frame of a sensor has the axes of a picture.

    ``sensor_msgs/Image`` says so of all pictures; drivers that send them in a body frame call it ``..._link``.
    """
    return kind in ("image", "rgbd") and not frame.endswith("_link")


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

    def mounting(self, base: str, frame: str, *, is_optical: bool) -> Pose3 | None:
        """Return `pose_base_sensor` of the sensor in a frame; None where nothing leads from base to it.

        Raises
        ------
        ValueError
            If a transform on the way has no orientation.
        """
        to_base, to_frame = self._way_up(base.lstrip("/")), self._way_up(frame.lstrip("/"))
        shared = next((name for name in to_base if name in to_frame), None)
        if shared is None:
            return None
        T_shared_base = self._product(to_base[: to_base.index(shared)])
        T_shared_frame = self._product(to_frame[: to_frame.index(shared)])
        T_base_frame = np.linalg.inv(T_shared_base) @ T_shared_frame
        if is_optical:
            T_base_frame[:3, :3] = T_base_frame[:3, :3] @ R_SENSOR_OPTICAL.T
        return Pose3.from_matrix(T_base_frame)

    def _way_up(self, frame: str) -> list[str]:
        """Return the frame, its parent, and so on; a circle is left where it closes."""
        way = [frame]
        while way[-1] in self.parents and self.parents[way[-1]][0] not in way:
            way.append(self.parents[way[-1]][0])
        return way

    def _product(self, way: Iterable[str]) -> Floats:
        """Return ``T_top_frame`` of the frames from a frame up to the one below the top."""
        product: Floats = np.eye(4)
        for child in way:
            parent, T_parent_child = self.parents[child]
            if T_parent_child is None:
                raise ValueError(f"/tf_static gives {parent} -> {child} a quaternion that is zero or not finite")
            product = T_parent_child @ product
        return product


def transforms_by_child(message: Any) -> dict[str, tuple[str, Floats | None]]:
    """Return the transforms of a TFMessage by child frame; of one that comes twice, the last."""
    return {
        transform.child_frame_id.lstrip("/"): (transform.header.frame_id.lstrip("/"), _matrix(transform.transform))
        for transform in message.transforms
    }


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


def describe_mounting(pose: Pose3) -> str:
    """Return a mounting as a config says it; what is zero is left out."""
    lengths = {name: round(getattr(pose, name), 4) for name in ("x", "y", "z")}
    angles = {f"{name}_deg": round(math.degrees(getattr(pose, name)), 2) for name in ("roll", "pitch", "yaw")}
    return ", ".join(f"{key}: {value:g}" for key, value in (lengths | angles).items() if value) or "at base"
