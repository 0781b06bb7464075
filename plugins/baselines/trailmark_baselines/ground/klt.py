"""The localizer `klt`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np

from trailmark.geometry import Pose2
from trailmark_baselines.ground.camera import Grey, Points
from trailmark_baselines.ground.config import KLTConfig
from trailmark_baselines.ground.localizer import GroundPeer, KeyframeMatch, Unaligned
from trailmark_baselines.ground.rigid import alignment_covariance, ransac_rigid

__all__ = ["KLT"]

#: Standard deviation that a tracked corner has at least [px].
_SIGMA_PX = 0.03
#: Fewer than this share of the key frame's corners: it is replaced.
_THIN = 0.5


@dataclass(eq=False)
class _Corners:
    image: Grey
    config: KLTConfig

    @cached_property
    def corners(self) -> Points:
        """Corners (N, 2) [px], looked for when the picture becomes a key frame."""
        config = self.config
        found: Any = cv2.goodFeaturesToTrack(self.image, config.corners, config.quality, config.distance_px)
        return np.empty((0, 2)) if found is None else np.asarray(found, np.float64).reshape(-1, 2)


class KLT(GroundPeer[_Corners]):
    """Corners of the key frame, looked for around where the last motion says that they are."""

    config: KLTConfig

    def view(self, image: Grey) -> _Corners:
        """Return the picture."""
        return _Corners(image, self.config)

    def align(self, key: _Corners, now: _Corners, expected: Pose2) -> KeyframeMatch | Unaligned:
        """Track the corners of the key frame and fit a rigid motion."""
        config, size = self.config, (now.image.shape[1], now.image.shape[0])
        ground = self.camera.on_ground(key.corners, size)
        guess = self.camera.in_picture(expected.inverse() @ ground, size)
        inside = np.all((guess >= 0.0) & (guess <= np.array(size) - 1.0), axis=1)
        before, after = self._track_corners(key.image, now.image, key.corners[inside], guess[inside])
        unit_m = self.camera.plane.metres_per_pixel[0]
        a, b = (self.camera.on_ground(points, size) for points in (before, after))
        found = ransac_rigid(a / unit_m, b / unit_m, config.tolerance_px)  # in pixels: OpenCV's precision is absolute
        n_agree = 0 if found is None else int(found[1].sum())
        details = {"tracked": float(len(a)), "agree": float(n_agree)}
        if found is None or n_agree < max(config.min_corners, config.min_share * len(a)):
            return Unaligned(f"{n_agree} of {len(a)} tracked corners agree", details)
        pose, agree = Pose2(unit_m * found[0].x, unit_m * found[0].y, found[0].theta), found[1]
        covariance = alignment_covariance(a[agree], pose, b[agree], _SIGMA_PX * unit_m)
        return KeyframeMatch(pose, covariance, n_agree < _THIN * len(key.corners), details)

    def _track_corners(self, key: Grey, now: Grey, corners: Points, guess: Points) -> tuple[Points, Points]:
        """Return the corners that were tracked and where they are now, (N, 2) each [px]."""
        if len(corners) == 0:
            return corners, corners
        start = guess.astype(np.float32).reshape(-1, 1, 2)
        window = (self.config.window_px, self.config.window_px)
        after, status, _ = cv2.calcOpticalFlowPyrLK(
            key, now, corners.astype(np.float32).reshape(-1, 1, 2), start, winSize=window,
            maxLevel=self.config.levels, flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
            criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.01),
        )  # fmt: skip
        is_tracked = np.asarray(status).ravel() == 1
        return corners[is_tracked], np.asarray(after, np.float64).reshape(-1, 2)[is_tracked]
