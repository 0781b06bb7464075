"""The localizer `orb`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.geometry import Pose2
from trailmark.interfaces import Session
from trailmark_baselines.ground.camera import Grey, Points
from trailmark_baselines.ground.config import ORBConfig
from trailmark_baselines.ground.localizer import GroundPeer, KeyframeMatch, Unaligned
from trailmark_baselines.ground.rigid import alignment_covariance, ransac_rigid

__all__ = ["ORB"]

#: Standard deviation that a pair has at least [px].
_SIGMA_PX = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class _OrbView:
    ground: Points
    descriptors: npt.NDArray[np.uint8]


class ORB(GroundPeer[_OrbView]):
    """Features of the key frame, matched wherever they are."""

    config: ORBConfig

    def start(self, session: Session) -> None:
        """Check the camera.

        Raises
        ------
        ConfigError
            If it has no scale, or is not there.
        """
        super().start(session)
        self._orb = cv2.ORB.create(self.config.features, fastThreshold=self.config.fast_threshold)
        self._matcher = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True)

    def view(self, image: Grey) -> _OrbView:
        """Return the features of the picture, as places on the ground."""
        found: tuple[Any, Any] = self._orb.detectAndCompute(image, None)  # its stubs do not say that there may be none
        keypoints, descriptors = found
        pixels = np.array([keypoint.pt for keypoint in keypoints], np.float64).reshape(-1, 2)
        ground = self.camera.on_ground(pixels, (image.shape[1], image.shape[0]))
        return _OrbView(
            ground, np.empty((0, 32), np.uint8) if descriptors is None else np.asarray(descriptors, np.uint8)
        )

    def align(self, key: _OrbView, now: _OrbView, expected: Pose2) -> KeyframeMatch | Unaligned:
        """Match, and fit a rigid motion."""
        config, unit_m = self.config, self.camera.plane.metres_per_pixel[0]
        pairs = self._pairs(key, now)
        a, b = key.ground[pairs[:, 0]], now.ground[pairs[:, 1]]
        found = ransac_rigid(a / unit_m, b / unit_m, config.tolerance_px)
        n_agree = 0 if found is None else int(found[1].sum())
        details = {"pairs": float(len(a)), "agree": float(n_agree)}
        if found is None or n_agree < max(config.min_pairs, config.min_share * len(a)):
            return Unaligned(f"{n_agree} of {len(a)} pairs agree", details)
        pose, agree = Pose2(unit_m * found[0].x, unit_m * found[0].y, found[0].theta), found[1]
        covariance = alignment_covariance(a[agree], pose, b[agree], _SIGMA_PX * unit_m)
        return KeyframeMatch(pose, covariance, n_agree < 2 * config.min_pairs, details)

    def _pairs(self, key: _OrbView, now: _OrbView) -> npt.NDArray[np.intp]:
        if len(key.ground) == 0 or len(now.ground) == 0:
            return np.empty((0, 2), np.intp)
        matches = self._matcher.match(key.descriptors, now.descriptors)
        return np.array([(match.queryIdx, match.trainIdx) for match in matches], np.intp).reshape(-1, 2)
