"""The map so far, while it is taught: scans near the robot, rasterised again when one is added."""

from __future__ import annotations

from collections import deque

from trailmark.arrays import Floats
from trailmark.geometry import Pose2
from trailmark_omni_surf.laser.scan_map import ScanMap

__all__ = ["GrowingMap"]

_N_RECENT = 30  # scans; more would only slow the raster down
_NEAR_M = 3.0
_THIN_M = 0.10  # coarser than the map that is kept: this one is made anew for every scan that is remembered


class GrowingMap:
    """Remembers the scans of the last stretch of way and makes a map of them.

    Older scans near by are no part of it: a scan matched to them would jump, and tell a motion that was none. Places
    seen again are joined when teaching ends.
    """

    def __init__(self) -> None:
        self._scans: deque[tuple[Floats, Pose2]] = deque(maxlen=_N_RECENT)
        self._map: ScanMap | None = None

    def knows(self, pose: Pose2) -> bool:
        """Return whether there is anything to match against near the pose."""
        return any(taken.distance_to(pose) < _NEAR_M for _, taken in self._scans)

    def add(self, points_base: Floats, pose_map_base: Pose2) -> None:
        """Take a scan at its pose."""
        self._scans.append((points_base, pose_map_base))
        self._map = None

    def scan_map(self) -> ScanMap:
        """Return the map of the scans."""
        if self._map is None:
            scans, poses = [scan for scan, _ in self._scans], [pose for _, pose in self._scans]
            self._map = ScanMap.from_scans(scans, poses, min_hits=1, thin_m=_THIN_M)
        return self._map
