"""Laser odometry of others, for the same scans: small_gicp and kiss-icp, where they are installed.

Both are made for three dimensions. A scan is given to them as walls: its points at five heights 5 cm apart, so that
the normals of neighbourhoods are those of walls. Everything else is left as they ship, apart from sizes that are for
streets: the voxels of kiss-icp (0.25 m), and the neighbourhoods of small_gicp (0.05 m, 1 m to a match).
"""

from __future__ import annotations

import importlib
import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from laser_floors import Instant

from trailmark.arrays import Floats
from trailmark.geometry import Pose2

__all__ = ["PEERS", "why_missing"]

_HEIGHTS_M = np.arange(5) * 0.05
_KEEP_SCANS, _KEYSCAN_M, _KEYSCAN_RAD, _MAX_RANGE_M = 12, 0.25, math.radians(10.0), 30.0


def why_missing(module: str) -> str:
    """Return why a peer cannot be run; nothing where it can."""
    try:
        importlib.import_module(module)
    except ImportError as error:
        return f"not installed: {error}"
    return ""


def gicp(instants: Sequence[Instant]) -> tuple[list[Pose2], dict[str, float]]:
    """Return the poses by small_gicp's GICP, from the wheels' step, to the keyscans that `scan_odometry` would keep."""
    import small_gicp

    pose = keyscan = Pose2()
    scans = deque([_walls(instants[0])], maxlen=_KEEP_SCANS)
    target, tree = small_gicp.preprocess_points(scans[0], downsampling_resolution=0.05)
    poses, cpu_ms = [pose], list[float]()
    for last, one in pairwise(instants):
        before = time.thread_time()
        guess = pose @ last.odometry.between(one.odometry)
        walls = _walls(one)
        source, _ = small_gicp.preprocess_points(walls, downsampling_resolution=0.05)
        found = small_gicp.align(target, source, tree, _matrix(guess), max_correspondence_distance=1.0)
        pose = _planar(found.T_target_source) if found.converged else guess
        way = keyscan.between(pose)
        if math.hypot(way.x, way.y) >= _KEYSCAN_M or abs(way.theta) >= _KEYSCAN_RAD:
            keyscan = pose
            scans.append(_moved(pose, walls))
            target, tree = small_gicp.preprocess_points(np.concatenate(scans), downsampling_resolution=0.05)
        cpu_ms.append(1e3 * (time.thread_time() - before))
        poses.append(pose)
    return poses, {"ms": float(np.median(cpu_ms))}


def kiss(instants: Sequence[Instant]) -> tuple[list[Pose2], dict[str, float]]:
    """Return the poses by kiss-icp's odometry, which takes no wheels."""
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config = KISSConfig()
    config.data.max_range, config.data.deskew = _MAX_RANGE_M, False
    config.mapping.voxel_size = 0.25
    config.registration.max_num_threads = 1
    odometry, poses, cpu_ms = KissICP(config), list[Pose2](), list[float]()
    for one in instants:
        before = time.process_time()
        odometry.register_frame(_walls(one), np.zeros(0))
        cpu_ms.append(1e3 * (time.process_time() - before))
        poses.append(_planar(odometry.last_pose))
    return poses, {"ms": float(np.median(cpu_ms))}


Peer = Callable[[Sequence[Instant]], tuple[list[Pose2], dict[str, float]]]
#: Name of the row, module, and what runs it.
PEERS: tuple[tuple[str, str, Peer], ...] = (
    ("small_gicp, from the wheels", "small_gicp", gicp),
    ("kiss-icp, alone", "kiss_icp", kiss),
)


def _walls(instant: Instant) -> Floats:
    """Return the points of a scan at each of the heights, (N, 3) [m]."""
    points = instant.scan.points()
    points = points[np.hypot(points[:, 0], points[:, 1]) < min(_MAX_RANGE_M, instant.scan.range_max_m)]
    return np.concatenate([np.column_stack([points, np.full(len(points), height)]) for height in _HEIGHTS_M])


def _matrix(pose: Pose2) -> Floats:
    cos, sin = math.cos(pose.theta), math.sin(pose.theta)
    return np.array([[cos, -sin, 0.0, pose.x], [sin, cos, 0.0, pose.y], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def _moved(pose: Pose2, walls: Floats) -> Floats:
    return np.column_stack([pose @ walls[:, :2], walls[:, 2]])


def _planar(matrix: Any) -> Pose2:
    return Pose2(float(matrix[0, 3]), float(matrix[1, 3]), math.atan2(matrix[1, 0], matrix[0, 0]))
