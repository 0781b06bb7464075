"""Beliefs as messages of ROS 2."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Belief
from trailmark.geometry import Pose2
from trailmark_ros2.driving import sec_and_nanosec, stamp_of
from trailmark_ros2.message_types import new_message, serialize

__all__ = [
    "BeliefMessages",
    "covariance_of_six",
    "diagnostics_bytes",
    "path_bytes",
]

_PLANAR = np.ix_((0, 1, 5), (0, 1, 5))
# Height, roll and pitch of a robot on a floor are known: as AMCL and robot_localization have it in two dimensions.
_FLAT = 1e-9
_UNKNOWN_VARIANCE = 1e6
_UNKNOWN = np.diag([_UNKNOWN_VARIANCE, _UNKNOWN_VARIANCE, _FLAT, _FLAT, _FLAT, _UNKNOWN_VARIANCE])
_PLACE_BYTES = 7 * 8  # position and quaternion
_LEVELS = {"ok": 0, "warn": 1, "error": 2}


def covariance_of_six(covariance: Floats | None) -> Floats:
    """Return a covariance of x, y, z, roll, pitch, yaw, (36,) row-major; where nothing is known it is huge."""
    six = _UNKNOWN.copy()
    if covariance is not None:
        six[_PLANAR] = _bounded(np.asarray(covariance, dtype=np.float64))
    return six.ravel()


def _bounded(covariance: Floats) -> Floats:
    """Return a covariance with variances of at most the unknown's; correlations stay, so that it is one still."""
    if np.isfinite(covariance).all() and covariance.diagonal().max() <= _UNKNOWN_VARIANCE:
        return covariance
    is_known = np.isfinite(np.diag(covariance))
    variances = np.where(is_known, np.diag(covariance), _UNKNOWN_VARIANCE)
    shrink = np.sqrt(np.minimum(1.0, _UNKNOWN_VARIANCE / np.maximum(variances, _FLAT)))
    both = np.outer(is_known, is_known)
    bounded: Floats = np.where(both, covariance, 0.0) * np.outer(shrink, shrink)
    bounded[np.diag_indices(3)] = np.minimum(variances, _UNKNOWN_VARIANCE)
    return bounded


class BeliefMessages:
    """Beliefs as messages, in bytes.

    One is sent with every reading, so only stamps and numbers are written anew; the bytes between them are those of a
    message that was made once.

    Parameters
    ----------
    map_frame, base_frame : str
        Names of map and base.
    """

    def __init__(self, map_frame: str, base_frame: str) -> None:
        self._map_frame = map_frame
        head = header(0.0, map_frame)
        self._pose = _Form("geometry_msgs/msg/PoseWithCovarianceStamped", {"header": head}, n_numbers=43)
        texts = {"header": head, "child_frame_id": base_frame}
        self._odometry = _Form("nav_msgs/msg/Odometry", texts, n_numbers=85)
        self._transforms: dict[str, _Form] = {}
        self._last: tuple[Belief, bytes] | None = None

    def pose(self, belief: Belief) -> bytes:
        """Return a belief that knows its pose as PoseWithCovarianceStamped."""
        return self._pose.filled(belief.stamp_s, self._pose_with_covariance(belief))

    def odometry(self, belief: Belief) -> bytes:
        """Return a belief that knows its pose as Odometry in the map; its twist is in base axes."""
        twist = belief.twist
        speeds = struct.pack("<6d", twist.forward_mps, twist.left_mps, 0.0, 0.0, 0.0, twist.yaw_radps)
        # An estimator says how sure it is of the pose, not of the velocity.
        return self._odometry.filled(belief.stamp_s, self._pose_with_covariance(belief), speeds, _UNKNOWN.tobytes())

    def transform(self, pose_map_child: Pose2, stamp_s: float, child: str) -> bytes:
        """Return a transform as TFMessage: it takes coordinates of the child to those of the map."""
        if child not in self._transforms:
            texts = {"header": header(0.0, self._map_frame), "child_frame_id": child}
            stamped = new_message("geometry_msgs/msg/TransformStamped", texts)
            fields = {"transforms": [stamped]}
            self._transforms[child] = _Form("tf2_msgs/msg/TFMessage", fields, n_numbers=7, stamp_at=8)
        return self._transforms[child].filled(stamp_s, _place(pose_map_child))

    def _pose_with_covariance(self, belief: Belief) -> bytes:
        if self._last is None or self._last[0] is not belief:
            assert belief.pose_map_base is not None
            self._last = belief, _place(belief.pose_map_base) + covariance_of_six(belief.covariance).tobytes()
        return self._last[1]


class _Form:
    """The bytes of a message that begins with a stamp and ends with numbers, to be filled with others.

    Parameters
    ----------
    type_name : str
        Of the message.
    fields : mapping of str to object
        Its texts, and what they stand in.
    n_numbers : int
        How many float64 it ends with.
    stamp_at : int
        Where the stamp begins: behind the 4 bytes of CDR, and behind its length where the message is a sequence.
    """

    def __init__(self, type_name: str, fields: Mapping[str, Any], *, n_numbers: int, stamp_at: int = 4) -> None:
        cdr = serialize(new_message(type_name, fields))
        self._begin, self._texts = cdr[:stamp_at], cdr[stamp_at + 8 : len(cdr) - 8 * n_numbers]

    def filled(self, stamp_s: float, *numbers: bytes) -> bytes:
        """Return the message of another stamp, with other numbers."""
        stamp = struct.pack("<iI", *sec_and_nanosec(stamp_s))
        return b"".join((self._begin, stamp, self._texts, *numbers))


def _place(pose: Pose2) -> bytes:
    """Return position and quaternion, or translation and rotation."""
    half = pose.theta / 2.0
    return struct.pack("<7d", pose.x, pose.y, 0.0, 0.0, 0.0, math.sin(half), math.cos(half))


def header(stamp_s: float, frame_id: str) -> Any:
    """Return a header."""
    return new_message("std_msgs/msg/Header", {"stamp": stamp_of(stamp_s), "frame_id": frame_id})


def path_bytes(poses: Sequence[Pose2], stamp_s: float, map_frame: str) -> bytes:
    """Return poses as Path, all of one stamp: thousands of them are sent twice a second."""
    head = header(stamp_s, map_frame)
    stamped = new_message("geometry_msgs/msg/PoseStamped", {"header": head})
    shown = [new_message("nav_msgs/msg/Path", {"header": head, "poses": [stamped] * n}) for n in range(3)]
    none, one, two = map(serialize, shown)
    if not poses:
        return none
    # From the second on all are of one length: numbers stand where 8 divides their place.
    texts = np.frombuffer(two[len(one) : len(two) - _PLACE_BYTES], np.uint8)
    further = np.empty((len(poses) - 1, len(texts) + _PLACE_BYTES), np.uint8)
    further[:, : len(texts)] = texts
    further[:, len(texts) :] = _places(poses[1:]).view(np.uint8)
    counted = none[:-4] + struct.pack("<I", len(poses))
    return b"".join((counted, one[len(none) : -_PLACE_BYTES], _place(poses[0]), further.tobytes()))


def _places(poses: Sequence[Pose2]) -> Floats:
    """Return position and quaternion of each pose, (N, 7)."""
    planar = np.array([(pose.x, pose.y, pose.theta / 2.0) for pose in poses]).reshape(-1, 3)
    places = np.zeros((len(poses), 7))
    places[:, :2], places[:, 5], places[:, 6] = planar[:, :2], np.sin(planar[:, 2]), np.cos(planar[:, 2])
    return places


def diagnostics_bytes(stamp_s: float, name: str, level: str, values: Mapping[str, str], *, summary: str) -> bytes:
    """Return one status as DiagnosticArray, in bytes; the level is ok, warn or error."""
    pairs = [new_message("diagnostic_msgs/msg/KeyValue", {"key": key, "value": value}) for key, value in values.items()]
    status = new_message(
        "diagnostic_msgs/msg/DiagnosticStatus",
        {"level": _LEVELS[level], "name": name, "message": summary, "hardware_id": "trailmark", "values": pairs},
    )
    fields = {"header": header(stamp_s, ""), "status": [status]}
    return serialize(new_message("diagnostic_msgs/msg/DiagnosticArray", fields))
