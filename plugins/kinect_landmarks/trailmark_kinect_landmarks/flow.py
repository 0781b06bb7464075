"""The localizer `kinect_flow`: optical-flow localization, the paper's second mode, Eqs. (1)-(2)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from trailmark.arrays import Bools, Depth, Floats, Grey8, Indices
from trailmark.errors import ShapeError
from trailmark.estimates import Belief, Estimate, Lost, Motion, information_from_covariance
from trailmark.frames import RGBD, Frame, Scalar, Scan
from trailmark.geometry import Pose2, Pose3
from trailmark.interfaces import Localizer, Session
from trailmark_kinect_landmarks.alignment import GATES, CloudAlignment, Refusal, align, planar_covariance
from trailmark_kinect_landmarks.camera import DepthPixels, LandmarkCamera, alignment_limits
from trailmark_kinect_landmarks.config import KinectFlowConfig
from trailmark_kinect_landmarks.depth import as_scan
from trailmark_kinect_landmarks.expectation import LEARNS_EVERY_S, Expectation
from trailmark_kinect_landmarks.refinding import follow
from trailmark_kinect_landmarks.systematic import motion_systematic
from trailmark_kinect_landmarks.watch import DepthWatch

__all__ = ["KinectFlow"]

_SIGMA_PX = 0.7
_MODEL_SIGMA_M = 0.004
_FLOOR = np.diag([0.0005**2, 0.0005**2, 0.0003**2])
_RENEW = 0.7  # share of the points that must be left, else new ones are taken
_TRIAL = 3  # judgements in agreement before a point votes: what is carried off at a walk has shown itself by then
_MOVES = 2  # judgements in a row against the others after which a point moves by itself
_ENOUGH = 12  # points that vote, so that those on trial need not be asked
_ENOUGH_SHARE = 0.5  # ... and of all that stand: a camera that turns fast has hardly others than new ones
_CELLS = (6, 8)  # rows and columns of the picture: one thing full of print is not given all the points


@dataclass(frozen=True, slots=True, eq=False)
class _Points:
    """Points that are followed.

    Attributes
    ----------
    uv : (N, 2) float64
        Their pixels in the newest picture.
    points_start, cov_start : (N, 3), (N, 3, 3) float64
        Where they stand, in the axes of the start [m].
    n_agreed, n_against : (N,) int
        Judgements in agreement, and in a row against the others; one each `LEARNS_EVERY_S` at most.
    """

    uv: Floats
    points_start: Floats
    cov_start: Floats
    n_agreed: Indices
    n_against: Indices

    def __len__(self) -> int:
        return len(self.uv)

    def rows(self, which: Bools, uv: Floats) -> _Points:
        """Return some of them, at their new pixels."""
        kept = self.points_start[which], self.cov_start[which], self.n_agreed[which], self.n_against[which]
        return _Points(uv[which], *kept)

    def after_votes(self, known: Bools, agrees: Bools) -> _Points:
        """Return them after a picture in which `known` were measured, and `agrees` of those agreed."""
        agreed = self.n_agreed + (known & agrees)
        against = np.where(known, np.where(agrees, 0, self.n_against + 1), self.n_against)
        return _Points(self.uv, self.points_start, self.cov_start, agreed, against)

    @property
    def is_moving(self) -> Bools:
        """Which move by themselves; they are followed on, so that what they stand on is not taken for new."""
        return np.asarray(self.n_against >= _MOVES)


_NONE = _Points(np.empty((0, 2)), np.empty((0, 3)), np.empty((0, 3, 3)), np.empty(0, np.intp), np.empty(0, np.intp))


class KinectFlow(Localizer):
    """Follows points with depth from picture to picture and solves Eq. (2) for the motion.

    Points are measured once and kept while they are in sight, so that errors do not add up at every picture. A new one
    votes when it has agreed with the others for some pictures; one that moves against them votes no more.
    """

    config: KinectFlowConfig

    def start(self, session: Session) -> None:
        """Get ready for the first picture."""
        config = self.config
        scan_info = session.sensors[config.scan] if config.scan else None
        self._camera = LandmarkCamera(config, session.sensors[config.camera], scan_info)
        self._watch = DepthWatch(session.name or "kinect_flow", config.camera)
        self._rng = session.rng
        self._scan: Scan | None = None
        self._before: Grey8 | None = None
        self._followed = _NONE
        self._T_start_base = np.eye(4)
        self._expectation = Expectation()
        self._told: tuple[float, Pose2, Floats] | None = None
        self._voted_s = -math.inf
        self._n_lost = self._n_registered = 0

    def counters(self) -> Mapping[str, int]:
        """Return how often it was lost, and how often depth was found to lie elsewhere than given."""
        return {"lost": self._n_lost, "registered": self._n_registered}

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return the motion since the picture before, or `Lost` when the points do not carry one."""
        payload = frame.payload
        if isinstance(payload, Scan | Scalar):
            self._scan = as_scan(payload)
            return ()
        if not isinstance(payload, RGBD):
            raise ShapeError(f"kinect_flow takes rgbd, but sensor {frame.sensor!r} gave {type(payload).__name__}")
        grey = np.asarray(cv2.cvtColor(payload.bgr, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
        registered_m = self._camera.register_depth(payload)
        self._watch.look_at_depths(registered_m)
        depth_m = self._camera.clean_depth(registered_m, grey)
        before, self._before = self._before, grey
        if before is None or before.shape != grey.shape:
            self._renew(grey, depth_m, _NONE)
            self._expectation.begin(frame.stamp_s, self._T_start_base)
            self._told = (frame.stamp_s, self._pose(), np.zeros((3, 3)))
            return ()
        answer = self._estimate_motion(frame.stamp_s, before, grey, depth_m)
        if self._watch.look(frame.stamp_s, grey, registered_m, self._expectation.rates()):
            self._register(payload, grey)
        return [answer]

    def _register(self, payload: RGBD, grey: Grey8) -> None:
        """Take all points anew, with depth where it was found to lie."""
        self._n_registered += 1
        self._camera.registration = self._watch.registration.found
        depth_m = self._camera.clean_depth(self._camera.register_depth(payload), grey)
        self._renew(grey, depth_m, _NONE)

    def _estimate_motion(self, stamp_s: float, before: Grey8, grey: Grey8, depth_m: Depth) -> Estimate:
        uv, good = follow(before, grey, self._followed.uv)
        followed = self._followed.rows(good, uv)
        measured = self._camera.measure(followed.uv, depth_m, _SIGMA_PX, self._scan)
        answer = self._align(stamp_s, followed, measured)
        if isinstance(answer, Refusal):
            self._n_lost += 1
            self._told = None
            self._renew(grey, depth_m, _NONE)
            self._expectation.begin(stamp_s, self._T_start_base)
            return Lost(stamp_s, answer.reason, {"n_points": float(len(uv))})
        D = len(answer.t)
        self._T_start_base = np.eye(4)
        self._T_start_base[:D, :D], self._T_start_base[:D, 3] = answer.R, answer.t
        self._expectation.took(stamp_s, self._T_start_base)
        known, agrees = self._judge_points(followed, measured)
        if not 0.0 <= stamp_s - self._voted_s < LEARNS_EVERY_S:
            self._voted_s = stamp_s
            followed = followed.after_votes(known, agrees)
        self._followed = followed
        if (~followed.is_moving).sum() < _RENEW * self.config.points:
            self._renew(grey, depth_m, followed)
        depth = float(np.linalg.norm(measured.points_base[agrees], axis=1).mean()) if agrees.any() else 0.0
        return self._told_as_motion(stamp_s, answer, depth)

    def _told_as_motion(self, stamp_s: float, alignment: CloudAlignment, depth_m: float) -> Estimate:
        # Half of an alignment's covariance is where the points were first seen, which is the same in both pictures.
        pose, covariance = self._pose(), planar_covariance(alignment) / 2.0 + _FLOOR
        told, self._told = self._told, (stamp_s, pose, covariance)
        details = {"n_agree": float(alignment.inliers.sum()), "residual_m": alignment.residual_m}
        if told is None:
            return Lost(stamp_s, "begins anew after a gap", details)
        since_s, since, spread_before = told
        turn = Pose2(theta=-since.theta).matrix()
        step = since.between(pose)
        spread = turn @ (covariance + spread_before) @ turn.T
        spread += motion_systematic(self._watch.share, step, stamp_s - since_s, depth_m)
        return Motion(since_s, stamp_s, step, information_from_covariance(spread), details)

    def _align(self, stamp_s: float, followed: _Points, measured: DepthPixels) -> CloudAlignment | Refusal:
        """Solve Eq. (2) for the points that may vote; where they are few, for those on trial too."""
        able = np.isfinite(measured.points_base).all(axis=1) & ~followed.is_moving
        voting = able & (followed.n_agreed >= _TRIAL)
        rows = np.flatnonzero(voting if voting.sum() >= max(_ENOUGH, _ENOUGH_SHARE * able.sum()) else able)
        D = 2 if self.config.solve == "plane" else 3
        return align(
            followed.points_start[rows, :D],
            measured.points_base[rows, :D],
            followed.cov_start[rows, :D, :D],
            measured.cov_base[rows, :D, :D] + _MODEL_SIGMA_M**2 * np.eye(D),
            rng=self._rng,
            limits=alignment_limits(self.config),
            expected=self._expectation.motion(stamp_s, D),
        )

    def _judge_points(self, followed: _Points, measured: DepthPixels) -> tuple[Bools, Bools]:
        """Return which points are measured, and which of them stand where they should."""
        R, t = self._T_start_base[:3, :3], self._T_start_base[:3, 3]
        D = 2 if self.config.solve == "plane" else 3
        known = np.asarray(np.isfinite(measured.points_base).all(axis=1))
        misses = (measured.points_base @ R.T + t - followed.points_start)[:, :D]
        cov = R @ measured.cov_base @ R.T + followed.cov_start + _MODEL_SIGMA_M**2 * np.eye(3)
        squared = np.einsum("ni,nij,nj->n", misses, np.linalg.inv(cov[:, :D, :D]), misses)
        return known, np.asarray(squared < GATES[D])  # NaN compares false

    def _renew(self, grey: Grey8, depth_m: Depth, kept: _Points) -> None:
        """Choose new points beside those that are kept, as seen from the pose of the belief."""
        uv = _corners(grey, kept.uv, self.config.points, self.config.apart_px)
        measured = self._camera.measure(uv, depth_m, _SIGMA_PX, self._scan)
        known = np.isfinite(measured.points_base).all(axis=1)
        R, t = self._T_start_base[:3, :3], self._T_start_base[:3, 3]
        points, cov = measured.points_base[known] @ R.T + t, R @ measured.cov_base[known] @ R.T
        none = np.zeros(len(points), np.intp)
        new = _Points(uv[known], points, cov, none, none)
        fields = ("uv", "points_start", "cov_start", "n_agreed", "n_against")
        self._followed = _Points(*(np.concatenate([getattr(kept, f), getattr(new, f)]) for f in fields))

    def _pose(self) -> Pose2:
        return Pose3.from_matrix(self._T_start_base).planar()


def _corners(grey: Grey8, taken_uv: Floats, n: int, apart_px: int) -> Floats:
    """Return corners away from pixels that are taken, (K, 2): in each cell of the picture its share at most."""
    free = np.full(grey.shape, 255, np.uint8)
    for u, v in np.rint(taken_uv).astype(int):
        cv2.circle(free, (int(u), int(v)), apart_px, 0, -1)
    found = cv2.goodFeaturesToTrack(grey, 4 * n, 0.005, apart_px, mask=free, blockSize=5)
    if found is None:
        return np.empty((0, 2))
    uv = np.asarray(found, dtype=np.float64).reshape(-1, 2)  # best first
    shape = np.array(grey.shape[::-1])
    cells = [
        (np.clip(pixels / shape, 0.0, 0.999) * _CELLS[::-1]).astype(np.intp) @ (1, _CELLS[1])
        for pixels in (uv, taken_uv)
    ]
    room = np.full(_CELLS[0] * _CELLS[1], math.ceil(2.0 * n / (_CELLS[0] * _CELLS[1])))
    np.subtract.at(room, cells[1], 1)
    kept: list[int] = []
    for row, cell in enumerate(cells[0]):
        if room[cell] > 0 and len(kept) + len(taken_uv) < n:
            room[cell] -= 1
            kept.append(row)
    return np.asarray(uv[kept])
