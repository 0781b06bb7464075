"""The localizer `orb_rgbd`: what an engineer writes in an afternoon with OpenCV."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import ConfigError, SensorMismatchError, ShapeError
from trailmark.estimates import Belief, Estimate, Lost, Motion, information_from_covariance
from trailmark.frames import RGBD, DepthCamera, Frame, Pinhole
from trailmark.geometry import Pose3
from trailmark.interfaces import Localizer, Session
from trailmark_baselines.rgbd.config import OrbRgbdConfig
from trailmark_baselines.rgbd.rigid import ransac_rigid

__all__ = ["OrbRgbd"]


_SENSOR_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # REP-103
_SIGMA_M = 0.01  # of a pair at 1 m
_FLOOR = np.diag([0.002**2, 0.002**2, 0.002**2])
_PATIENCE = 5  # pictures without a motion until it begins anew


@dataclass(frozen=True, slots=True, eq=False)
class _OrbFeatures:
    stamp_s: float
    descriptors: npt.NDArray[np.uint8]
    points_base: Floats
    depth_m: Floats


class OrbRgbd(Localizer):
    """Frame-to-frame motion in space from ORB features with depth, projected to the plane of the first pose.

    A picture that shows no motion is skipped: the next one is compared with the last good one, so that nothing is lost.
    """

    config: OrbRgbdConfig
    uses_belief = False
    begins_early = True

    def start(self, session: Session) -> None:
        """Read the calibration.

        Raises
        ------
        ConfigError
            If there is none, or depth is not registered to colour.
        """
        info = session.sensors[self.config.camera]
        calibration = info.calibration
        if isinstance(calibration, DepthCamera) and calibration.depth is None and calibration.depth_kind == "z":
            calibration = calibration.colour
        if not isinstance(calibration, Pinhole):
            raise SensorMismatchError(
                f"{session.name or 'orb_rgbd'}: needs a calibrated colour camera with depth (z) registered to it;"
                f" sensor {info.name!r} has {'none' if calibration is None else type(calibration).__name__}"
            )
        self._lens, self._pose_base_camera = calibration, info.pose_base_sensor
        self._orb = cv2.ORB.create(self.config.features)
        self._matcher = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True)
        self._rng = session.rng
        self._before: _OrbFeatures | None = None
        self._T_first_base = np.eye(4)
        self._n_lost = self._n_in_a_row = 0

    def counters(self) -> Mapping[str, int]:
        """Return how often it was lost."""
        return {"lost": self._n_lost}

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return the motion since the picture before, or `Lost` when too few pairs agree."""
        if not isinstance(frame.payload, RGBD):
            raise ShapeError(f"orb_rgbd takes rgbd, but {frame.sensor!r} gave {type(frame.payload).__name__}")
        now = self._features(frame.stamp_s, frame.payload)
        before = self._before
        if before is None:
            self._before = now
            return ()
        pairs = self._pairs(before, now)
        depth_m = np.maximum(before.depth_m[pairs[:, 0]], now.depth_m[pairs[:, 1]])
        tolerance_m = self.config.tolerance_m * np.maximum(depth_m, 1.0) ** 2
        points = before.points_base[pairs[:, 0]], now.points_base[pairs[:, 1]]
        found = ransac_rigid(*points, tolerance_m, self._rng, self.config.tries)
        n_agree = 0 if found is None else int(found[2].sum())
        details = {"n_pairs": float(len(pairs)), "n_agree": float(n_agree)}
        if found is None or n_agree < self.config.min_pairs:
            self._n_lost += 1
            self._n_in_a_row += 1
            if self._n_in_a_row >= _PATIENCE:  # nothing of it is in sight any more
                self._before, self._n_in_a_row = now, 0
            return [Lost(now.stamp_s, f"{n_agree} pairs agree, {self.config.min_pairs} are needed", details)]
        R, t, inliers = found
        self._before, self._n_in_a_row = now, 0
        return [self._motion(before.stamp_s, now, R, t, now.points_base[pairs[inliers, 1]], details)]

    def _motion(
        self, since_s: float, now: _OrbFeatures, R: Floats, t: Floats, points: Floats, details: Mapping[str, float]
    ) -> Motion:
        since = Pose3.from_matrix(self._T_first_base).planar()
        step = np.eye(4)
        step[:3, :3], step[:3, 3] = R, t
        self._T_first_base = self._T_first_base @ step
        motion = since.between(Pose3.from_matrix(self._T_first_base).planar())
        covariance = _covariance(points) + _FLOOR
        return Motion(since_s, now.stamp_s, motion, information_from_covariance(covariance), details)

    def _features(self, stamp_s: float, payload: RGBD) -> _OrbFeatures:
        if payload.depth_m.shape != payload.bgr.shape[:2]:
            raise ConfigError("orb_rgbd needs depth of the size of colour, registered to it")
        keypoints, descriptors = self._orb.detectAndCompute(cv2.cvtColor(payload.bgr, cv2.COLOR_BGR2GRAY), None)
        uv = np.array([keypoint.pt for keypoint in keypoints], dtype=np.float64).reshape(-1, 2)
        whole = np.rint(uv).astype(np.intp)
        depth_m = payload.depth_m[whole[:, 1], whole[:, 0]].astype(np.float64)
        good = (depth_m > 0.0) & (depth_m < self.config.far_m)
        if not good.any():
            return _OrbFeatures(stamp_s, np.empty((0, 32), np.uint8), np.empty((0, 3)), np.empty(0))
        rays = cv2.undistortPoints(
            uv[good].reshape(-1, 1, 2), self._lens.matrix(), np.array(self._lens.distortion or (0.0,) * 4)
        )
        flat = np.asarray(rays, dtype=np.float64).reshape(-1, 2)
        optical = np.column_stack([flat, np.ones(len(flat))]) * depth_m[good, None]
        points = self._pose_base_camera.transform(optical @ _SENSOR_FROM_OPTICAL.T)
        return _OrbFeatures(stamp_s, np.asarray(descriptors, np.uint8)[good], points, depth_m[good])

    def _pairs(self, before: _OrbFeatures, now: _OrbFeatures) -> npt.NDArray[np.intp]:
        if len(before.descriptors) == 0 or len(now.descriptors) == 0:
            return np.empty((0, 2), np.intp)
        matches = self._matcher.match(before.descriptors, now.descriptors)
        return np.array([(match.queryIdx, match.trainIdx) for match in matches], dtype=np.intp).reshape(-1, 2)


def _covariance(points: Floats) -> Floats:
    """Return the covariance of the planar motion, every pair being as good as its depth."""
    sigma_m = _SIGMA_M * np.maximum(points[:, 0], 1.0) ** 2
    J = np.zeros((len(points), 2, 3))
    J[:, 0, 0] = J[:, 1, 1] = 1.0
    J[:, 0, 2], J[:, 1, 2] = -points[:, 1], points[:, 0]
    H = np.einsum("nij,nik,n->jk", J, J, 1.0 / sigma_m**2)
    return np.asarray(np.linalg.inv(H + 1e-9 * np.eye(3)))
