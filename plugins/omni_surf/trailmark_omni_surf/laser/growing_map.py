"""The map so far, while it is taught: scans near the robot, rasterised again when one is added."""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from trailmark.geometry import Pose2
from trailmark_omni_surf.laser.scan_map import ScanMap

__all__ = ["GrowingMap"]

_N_RECENT = 30  # scans; more would only slow the raster down, older ones come back by `_REVISIT_M`
_REVISIT_M = 1.5
_THIN_M = 0.10  # coarser than the map that is kept: this one is made anew for every scan that is remembered


class GrowingMap:
    """Remembers scans and makes a local map of those taken near the newest one.

    Old scans near by are part of it, so that a place seen again pulls the path onto itself.
    """

    def __init__(self) -> None:
        self._scans: list[tuple[npt.NDArray[np.float64], Pose2]] = []
        self._recent: deque[int] = deque(maxlen=_N_RECENT)
        self._map: ScanMap | None = None

    def knows(self, pose: Pose2) -> bool:
        """Whether there is anything to match against near the pose."""
        return any(self._scans[idx][1].distance_to(pose) < 2 * _REVISIT_M for idx in self._recent)

    def add(self, points_base: npt.NDArray[np.float64], pose_map_base: Pose2) -> None:
        """Take a scan at its pose."""
        self._recent.append(len(self._scans))
        self._scans.append((points_base, pose_map_base))
        self._map = None

    def scan_map(self) -> ScanMap:
        """Return the map around the newest scan."""
        if self._map is None:
            chosen = [self._scans[idx] for idx in self._chosen()]
            scans, poses = [scan for scan, _ in chosen], [pose for _, pose in chosen]
            self._map = ScanMap.from_scans(scans, poses, min_hits=1, thin_m=_THIN_M)
        return self._map

    def _chosen(self) -> list[int]:
        newest = self._scans[-1][1]
        old = [
            idx
            for idx in range(len(self._scans) - len(self._recent))
            if self._scans[idx][1].distance_to(newest) < _REVISIT_M
        ]
        return [*old[-_N_RECENT:], *self._recent]
