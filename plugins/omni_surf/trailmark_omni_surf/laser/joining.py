"""Whether a scan was taken where others were: its fit over a whole window, refused where it is not the only one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Fix, Lost
from trailmark.geometry import Pose2
from trailmark_omni_surf.laser.matching import SearchWindow, refined_starts
from trailmark_omni_surf.laser.scan_map import ScanMap
from trailmark_omni_surf.laser.told_fit import told_fit

__all__ = ["ScanJoiner"]

_SIGMAS = 3.0
_LEAST_M, _LEAST_RAD = 0.3, math.radians(4.0)
_THIN_M = 0.10
_ELSEWHERE_M, _ELSEWHERE_RAD = 0.3, math.radians(10.0)


@dataclass(frozen=True, slots=True)
class ScanJoiner:
    """Places a scan among others.

    Attributes
    ----------
    min_inlier_share : float
        Below this share of points near the others' walls, it does not fit.
    margin_m : float
        A fit elsewhere that costs no more than this beyond the best makes the answer ambiguous [m].
    """

    min_inlier_share: float
    margin_m: float

    def place(
        self, scans: Sequence[Floats], known: Mapping[int, Pose2], keyframe: int, guess: Pose2, covariance: Floats
    ) -> Fix | Lost:
        """Return the pose of a scan in the axes of others; see `Localizer.relate`."""
        scan_map = ScanMap.from_scans([scans[k] for k in known], list(known.values()), min_hits=1, thin_m=_THIN_M)
        points = np.ascontiguousarray(scans[keyframe], dtype=np.float64)
        span_m = max(_LEAST_M, _SIGMAS * math.sqrt(float(np.linalg.eigvalsh(covariance[:2, :2])[1])))
        span_rad = max(_LEAST_RAD, _SIGMAS * math.sqrt(float(covariance[2, 2])))
        window = SearchWindow(span_m=span_m, span_rad=span_rad, n_coarse=24, n_fine=8)
        poses, costs = refined_starts(scan_map, points, guess, window)
        best = int(np.argmin(costs))
        match = told_fit(scan_map, points, Pose2.from_array(poses[best]), guess)
        details = {"inlier_share": match.inlier_share, "residual_m": match.residual_m, "cost_m": match.cost_m}
        if match.inlier_share < self.min_inlier_share:
            return Lost(0.0, "the scan does not fit", details)
        if self._fits_elsewhere(match.pose_map_base, match.information, (poses, costs), match.cost_m):
            return Lost(0.0, "the scan fits in two places", details)
        return Fix(0.0, match.pose_map_base, match.information, details)

    def _fits_elsewhere(self, pose: Pose2, information: Floats, others: tuple[Floats, Floats], cost_m: float) -> bool:
        """Return whether a pose fits as well that differs also in directions that walls measure."""
        poses, costs = others
        away = poses - pose.array()
        away[:, 2] = np.angle(np.exp(1j * away[:, 2]))
        values, vectors = np.linalg.eigh(information[:2, :2])
        told = vectors[:, values > 1e-6 * max(float(values[1]), 1e-12)]
        offset_m = np.sqrt(((away[:, :2] @ told) ** 2).sum(axis=1))
        is_elsewhere = (offset_m > _ELSEWHERE_M) | (np.abs(away[:, 2]) > _ELSEWHERE_RAD)
        return bool((is_elsewhere & (costs - cost_m < self.margin_m)).any())
