"""The localizer `kinect_flow`: optical-flow localization, the paper's second mode, Eqs. (1)-(2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.errors import ShapeError
from trailmark.estimates import Belief, Estimate, Lost, Motion, information_from_covariance
from trailmark.frames import RGBD, Frame, Scalar, Scan
from trailmark.geometry import Pose2, Pose3
from trailmark.interfaces import Localizer, Session
from trailmark_kinect_landmarks.alignment import CloudAlignment, Refusal, align, planar_covariance
from trailmark_kinect_landmarks.camera import LandmarkCamera, alignment_limits
from trailmark_kinect_landmarks.config import KinectFlowConfig
from trailmark_kinect_landmarks.depth import as_scan
from trailmark_kinect_landmarks.expectation import Expectation
from trailmark_kinect_landmarks.refinding import follow

__all__ = ["KinectFlow"]

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

_SIGMA_PX = 0.7
_MODEL_SIGMA_M = 0.004
_FLOOR = np.diag([0.001**2, 0.001**2, 0.001**2])
_RENEW = 0.5  # share of the points that must be left, else new ones are taken


@dataclass(frozen=True, slots=True, eq=False)
class _Points:
    """Points that are followed: where they stand, and their pixels in the newest picture."""

    uv: Array
    points_start: Array
    cov_start: Array

    def rows(self, which: npt.NDArray[np.bool_], uv: Array) -> _Points:
        return _Points(uv[which], self.points_start[which], self.cov_start[which])


class KinectFlow(Localizer):
    """Follows points with depth from picture to picture and solves Eq. (2) for the motion.

    Points are measured once and kept while enough of them stay in sight, so that errors do not add up at every
    picture. What moves against the others is no inlier of the alignment and is let go.
    """

    config: KinectFlowConfig

    def start(self, session: Session) -> None:
        """Get ready for the first picture."""
        config = self.config
        scan_info = session.sensors[config.scan] if config.scan else None
        self._camera = LandmarkCamera(config, session.sensors[config.camera], scan_info)
        self._rng = session.rng
        self._scan: Scan | None = None
        self._before: Grey | None = None
        self._followed: _Points | None = None
        self._T_start_base = np.eye(4)
        self._expectation = Expectation()
        self._told: tuple[float, Pose2, Array] | None = None
        self._n_lost = 0

    def counters(self) -> Mapping[str, int]:
        """Return how often it was lost."""
        return {"lost": self._n_lost}

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return the motion since the picture before, or `Lost` when the points do not carry one."""
        payload = frame.payload
        if isinstance(payload, Scan | Scalar):
            self._scan = as_scan(payload)
            return ()
        if not isinstance(payload, RGBD):
            raise ShapeError(f"kinect_flow takes rgbd, but sensor {frame.sensor!r} gave {type(payload).__name__}")
        grey = np.asarray(cv2.cvtColor(payload.bgr, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
        depth_m = self._camera.corrected(self._camera.registered(payload), payload.bgr)
        before, self._before = self._before, grey
        if before is None or before.shape != grey.shape or self._followed is None:
            self._renew(grey, depth_m)
            self._expectation.begin(frame.stamp_s, self._T_start_base)
            self._told = (frame.stamp_s, self._pose(), np.zeros((3, 3)))
            return ()
        return [self._moved(frame.stamp_s, before, grey, depth_m)]

    def _moved(self, stamp_s: float, before: Grey, grey: Grey, depth_m: npt.NDArray[np.float32]) -> Estimate:
        assert self._followed is not None
        uv, good = follow(before, grey, self._followed.uv)
        followed = self._followed.rows(good, uv)
        answer = self._aligned(stamp_s, followed, depth_m)
        if isinstance(answer, Refusal):
            self._n_lost += 1
            self._told = None
            self._renew(grey, depth_m)
            self._expectation.begin(stamp_s, self._T_start_base)
            return Lost(stamp_s, answer.reason, {"n_points": float(len(uv))})
        alignment, inliers = answer
        D = len(alignment.t)
        self._T_start_base = np.eye(4)
        self._T_start_base[:D, :D], self._T_start_base[:D, 3] = alignment.R, alignment.t
        self._expectation.took(stamp_s, self._T_start_base)
        self._followed = followed.rows(inliers, followed.uv)
        if inliers.sum() < _RENEW * self.config.points:
            self._renew(grey, depth_m)
        return self._told_as_motion(stamp_s, alignment)

    def _told_as_motion(self, stamp_s: float, alignment: CloudAlignment) -> Estimate:
        pose, covariance = self._pose(), planar_covariance(alignment) + _FLOOR
        told, self._told = self._told, (stamp_s, pose, covariance)
        details = {"n_agree": float(alignment.inliers.sum()), "residual_m": alignment.residual_m}
        if told is None:
            return Lost(stamp_s, "begins anew after a gap", details)
        since_s, since, spread_before = told
        turn = Pose2(theta=-since.theta).matrix()
        information = information_from_covariance(turn @ (covariance + spread_before) @ turn.T)
        return Motion(since_s, stamp_s, since.between(pose), information, details)

    def _aligned(
        self, stamp_s: float, followed: _Points, depth_m: npt.NDArray[np.float32]
    ) -> tuple[CloudAlignment, npt.NDArray[np.bool_]] | Refusal:
        """Solve Eq. (2); also returns which points to go on with: all that agree, or have no depth now."""
        measured = self._camera.measure(followed.uv, depth_m, _SIGMA_PX, self._scan)
        known = np.flatnonzero(np.isfinite(measured.points_base).all(axis=1))
        D = 2 if self.config.solve == "plane" else 3
        answer = align(
            followed.points_start[known, :D],
            measured.points_base[known, :D],
            followed.cov_start[known, :D, :D],
            measured.cov_base[known, :D, :D] + _MODEL_SIGMA_M**2 * np.eye(D),
            rng=self._rng,
            limits=alignment_limits(self.config),
            expected=self._expectation.motion(stamp_s, D),
        )
        if isinstance(answer, Refusal):
            return answer
        stays = np.ones(len(followed.uv), dtype=np.bool_)
        stays[known] = answer.inliers
        return answer, stays

    def _renew(self, grey: Grey, depth_m: npt.NDArray[np.float32]) -> None:
        """Take new points, as they are seen from where it is believed to be."""
        found = cv2.goodFeaturesToTrack(grey, self.config.points, 0.005, self.config.apart_px, blockSize=5)
        uv = np.empty((0, 2)) if found is None else np.asarray(found, dtype=np.float64).reshape(-1, 2)
        measured = self._camera.measure(uv, depth_m, _SIGMA_PX, self._scan)
        known = np.isfinite(measured.points_base).all(axis=1)
        R, t = self._T_start_base[:3, :3], self._T_start_base[:3, 3]
        self._followed = _Points(uv[known], measured.points_base[known] @ R.T + t, R @ measured.cov_base[known] @ R.T)

    def _pose(self) -> Pose2:
        return Pose3.from_matrix(self._T_start_base).planar()
