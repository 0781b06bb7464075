"""By how many columns the upper half of the picture is truly displaced between two poses, from depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Depth, Floats
from trailmark.frames import Pinhole
from trailmark.geometry import Pose2, Pose3

__all__ = ["Eyepiece", "Surroundings"]

_SPARSE_PX = 4  # every fourth pixel along and across is enough for a median
_NEAREST_M = 0.1


@dataclass(frozen=True, slots=True)
class Eyepiece:
    """A camera on a robot, and how its pictures are cut into columns.

    Attributes
    ----------
    lens : Pinhole
        Its calibration.
    size : (int, int)
        Width and height [px].
    mounting : Pose3
        ``point_base = mounting @ point_sensor``.
    n_columns : int
        Columns of a change vector.
    """

    lens: Pinhole
    size: tuple[int, int]
    mounting: Pose3
    n_columns: int = 50

    @property
    def column_px(self) -> int:
        """Width of a column [px]."""
        return self.size[0] // self.n_columns

    def points(self, depth_m: Depth, pose: Pose2) -> Floats:
        """Return what the upper half shows as points in the map, (N, 3) [m].

        Parameters
        ----------
        depth_m : (H, W) float32
            Depth along the optical axis; not finite where there is nothing [m].
        pose : Pose2
            Of the robot.
        """
        half = depth_m[: depth_m.shape[0] // 2 : _SPARSE_PX, ::_SPARSE_PX].astype(np.float64)
        v, u = np.mgrid[: depth_m.shape[0] // 2 : _SPARSE_PX, : depth_m.shape[1] : _SPARSE_PX]
        seen = np.isfinite(half) & (half > 0.0)
        forward = half[seen]
        left = -(u[seen] - self.lens.cx) / self.lens.fx * forward
        up = -(v[seen] - self.lens.cy) / self.lens.fy * forward
        return self._pose(pose).transform(np.column_stack([forward, left, up]))

    def u_px(self, points_map: Floats, pose: Pose2) -> Floats:
        """Return in which pixel column each point is seen from a pose, (N,); NaN where it is not [px]."""
        forward, left, _ = self._pose(pose).inverse().transform(points_map).T
        u = self.lens.cx - self.lens.fx * left / np.maximum(forward, _NEAREST_M)
        is_seen = (forward > _NEAREST_M) & (u >= -0.5) & (u <= self.size[0] - 0.5)
        return np.where(is_seen, u, np.nan)

    def _pose(self, pose: Pose2) -> Pose3:
        return Pose3.from_planar(pose) @ self.mounting


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """What there is to see along a taught way, from depth pictures that were taken while teaching.

    Attributes
    ----------
    eyepiece : Eyepiece
        The camera.
    poses : sequence of Pose2
        Where each depth picture was taken.
    points : sequence of (N, 3) float64
        What each showed, in the map [m].
    """

    eyepiece: Eyepiece
    poses: Sequence[Pose2]
    points: Sequence[Floats]

    def shift_columns(self, taught: Pose2, seen: Pose2) -> float:
        """Return the median displacement between two poses, positive to the right [columns].

        Of what the picture of the taught pose shows in its upper half and that of the other pose still shows.
        """
        points = self.points[min(range(len(self.poses)), key=lambda k: self.poses[k].distance_to(taught))]
        moved_px = self.eyepiece.u_px(points, seen) - self.eyepiece.u_px(points, taught)
        return float(np.nanmedian(moved_px)) / self.eyepiece.column_px
