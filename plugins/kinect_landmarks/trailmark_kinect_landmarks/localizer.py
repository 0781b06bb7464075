"""The localizers `kinect_landmarks` and `kinect_motion`: find landmarks, remember, find them again, triangulate."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import ShapeError
from trailmark.estimates import Belief, Estimate, Fix, Lost, Motion, information_from_covariance
from trailmark.frames import RGBD, Frame, Scalar, Scan
from trailmark.geometry import Pose2, Pose3
from trailmark.interfaces import Localizer, Session
from trailmark.paths import Keyframe
from trailmark_kinect_landmarks.alignment import Refusal
from trailmark_kinect_landmarks.camera import LandmarkCamera, alignment_limits
from trailmark_kinect_landmarks.colour import Light
from trailmark_kinect_landmarks.config import KinectLandmarksConfig
from trailmark_kinect_landmarks.depth import as_scan
from trailmark_kinect_landmarks.doubts import Doubts
from trailmark_kinect_landmarks.effort import Effort
from trailmark_kinect_landmarks.expectation import Expectation
from trailmark_kinect_landmarks.eye import LandmarkDetector, PreparedImage
from trailmark_kinect_landmarks.fuzzy import SearchPlan
from trailmark_kinect_landmarks.landmarks import TrackedLandmarks
from trailmark_kinect_landmarks.memory import Anchor, LandmarkMemory, MemoryLimits
from trailmark_kinect_landmarks.paper_numbers import paper_numbers
from trailmark_kinect_landmarks.registration import Registration
from trailmark_kinect_landmarks.solver import PoseSolver, Solved
from trailmark_kinect_landmarks.stages import StagePictures
from trailmark_kinect_landmarks.systematic import motion_systematic, systematic_covariance
from trailmark_kinect_landmarks.tracker import Tracker
from trailmark_kinect_landmarks.watch import DepthWatch
from trailmark_kinect_landmarks.whereabouts import Whereabouts, restart_covariance

__all__ = ["KinectLandmarks", "KinectMotion"]

logger = logging.getLogger(__name__)

_MAP = "map"
_LIGHT = "light"
_REGISTRATION = "registration"
#: Of a fix however many landmarks agree: what all of them share (calibration, stamps).
_FLOOR = np.diag([0.003**2, 0.003**2, 0.0015**2])
_START_LANDMARKS = 3


class KinectLandmarks(Localizer):
    """Pose from landmarks in colour and depth (Toth et al. 2015)."""

    config: KinectLandmarksConfig

    def start(self, session: Session) -> None:
        """Load the map of this place where there is one; otherwise landmarks are remembered from the start pose on."""
        config = self.config
        self._session = session
        self._camera = LandmarkCamera(
            config, session.sensors[config.camera], session.sensors[config.scan] if config.scan else None
        )
        self._watch = DepthWatch(session.name or "kinect_landmarks", config.camera)
        self._eye = LandmarkDetector(config, self._camera)
        self._memory = LandmarkMemory(MemoryLimits(config.trial, config.moved_after, config.remembered))
        self._solver = PoseSolver(config, self._memory, alignment_limits(config), session.rng)
        self._tracker = Tracker(config, self._camera, self._eye, self._memory, self._solver)
        self._effort = Effort(config, session.sensors[config.camera].rate_hz)
        self._stages = StagePictures(config.debug_images) if config.debug_images else None
        self._light: float | None = None
        self._scan: Scan | None = None
        self._expectation, self._whereabouts = Expectation(), Whereabouts(config.restart_s)
        self._doubts = Doubts(config, self._memory, self._camera, self._solver, self._whereabouts)
        self._start_pose: Pose2 | None = None
        self._told: tuple[float, Pose2, Floats] | None = None
        self._counts = {"lost": 0, "restarts": 0, "relocalized": 0, "registered": 0}
        if session.mode != "teach":
            self._load()

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Process a picture; readings of the light sensor and the laser are kept for the next one."""
        self._effort.note_time(self._session.last_latency_s())
        payload = frame.payload
        if frame.sensor == self.config.scan and isinstance(payload, Scan | Scalar):
            self._scan = as_scan(payload)
            return ()
        if isinstance(payload, Scalar):
            self._light = payload.value
            return ()
        if not isinstance(payload, RGBD):
            raise ShapeError(f"kinect_landmarks takes rgbd, but {frame.sensor!r} gave {type(payload).__name__}")
        return self._observe(frame.stamp_s, payload, belief)

    def _observe(self, stamp_s: float, payload: RGBD, belief: Belief) -> Sequence[Estimate]:
        plan = self._effort.plan()
        picture = self._eye.prepare(payload, self._light, self._scan, plan.scale)
        is_expected = self._is_expected(stamp_s)
        self._whereabouts.follow(belief)
        self._watch.look_at_depths(picture.registered_m)
        predicted = self._expectation.pose(stamp_s) if is_expected else None
        again, others, done = self._tracker.look(picture, plan, predicted, self._whereabouts.lead)
        if self._solver.notices_tilt(stamp_s, again):
            self._begin_in_space()
        expected = self._expectation.motion(stamp_s, self._solver.n_dimensions) if is_expected else None
        if len(self._memory) == 0:
            return self._begin(stamp_s, others, belief)
        solved = self._solver.solve(again, expected)
        is_followed = is_expected and not self._whereabouts.is_assumed
        against = solved.reason if isinstance(solved, Refusal) else ""
        if isinstance(solved, Solved) and not is_followed:
            against = self._doubts.about(solved, again, self._tracker.n_near, picture)
            if against:
                self._tracker.let_go()
        if isinstance(solved, Refusal) or against:
            self._effort.note_picture(picture, done, len(again), 0)
            if self._may_restart(stamp_s, others, picture):
                self._restart(stamp_s, others, belief)
                against += "; remembers anew"
            details = {"n_landmarks": float(len(again) + len(others)), "n_refound": float(len(again))}
            return [self._lost_now(stamp_s, against, details)]
        self._effort.note_picture(picture, done, len(again) + len(others), len(solved.agreeing))
        is_surprise = self._expectation.is_surprised(stamp_s, solved.T_map_base)
        rows = self._tracker.learn(stamp_s, solved, again, others, is_doubtful=is_surprise)
        self._remember(stamp_s, belief, solved.T_map_base, rows)
        self._counts["relocalized"] += expected is None
        self._expectation.took(stamp_s, solved.T_map_base)
        if self._stages is not None:
            self._stages.write(stamp_s, picture, solved.agreeing, self._camera)
        answers = self._answer(stamp_s, solved, picture)
        planar = Pose3.from_matrix(solved.T_map_base).planar()
        known = solved.covariance + _FLOOR + systematic_covariance(self._watch.share, solved.drift, None)
        self._whereabouts.begin(solved.T_map_base, covariance=known, belief=belief)
        odom = belief.pose_odom_base
        self._watch.compare_ways((planar.x, planar.y), (odom.x, odom.y))
        if self._watch.look(stamp_s, picture.grey, picture.registered_m, self._expectation.rates()):
            self._register(payload, solved, plan)
        return answers

    def _register(self, payload: RGBD, solved: Solved, plan: SearchPlan) -> None:
        """Begin anew with depth where it was found to lie: landmarks that were seen before stand at wrong depths."""
        self._counts["registered"] += 1
        if self._memory.is_taught.any():
            logger.warning(
                "%s: this place was taught with depth that did not lie on colour; teach it again", self._session.name
            )
            return
        found = self._camera.registration = self._watch.registration.found
        assert found is not None
        share = found.share((payload.bgr.shape[1], payload.bgr.shape[0]))
        systematic = systematic_covariance(share, solved.drift, None)
        anchor = Anchor(solved.T_map_base, solved.covariance + systematic)
        self._memory.clear()
        self._tracker.forget()
        picture = self._eye.prepare(payload, self._light, self._scan, plan.scale)
        _, others, _ = self._tracker.look(picture, plan, None)
        self._tracker.remember(others, anchor)

    def latency_s(self) -> float:
        """Return what the last picture takes by the finders that looked at it [s]."""
        return self._effort.latency_s

    def finish(self) -> None:
        """Gather the landmarks that were remembered on the way into a map."""
        localizer_map = self._session.map
        keyframes = [] if localizer_map is None else localizer_map.keyframes()
        if localizer_map is None or not keyframes:
            return
        gathered = LandmarkMemory()
        registration = keyframes[-1].arrays.get(_REGISTRATION, Registration().array())
        for keyframe in keyframes:  # what was remembered before depth was registered stands at wrong depths
            if np.array_equal(keyframe.arrays.get(_REGISTRATION, registration), registration):
                gathered.load(_landmarks_of(keyframe.arrays))
        about = {_LIGHT: keyframes[0].arrays[_LIGHT], _REGISTRATION: registration}
        localizer_map.save(_MAP, gathered.arrays() | about)

    def counters(self) -> Mapping[str, int]:
        """Return how often it was lost, began anew, or found back."""
        return {**self._counts, "remembered": len(self._memory), "moved": int(self._memory.is_moved.sum())}

    def _load(self) -> None:
        saved = self._session.map.load(_MAP) if self._session.map is not None else None
        if saved is None:
            return
        self._memory.load(_landmarks_of(saved))
        registration = Registration(*saved.get(_REGISTRATION, Registration().array()).tolist())
        if registration != Registration():
            self._camera.registration = registration
            self._watch.registration.take(registration)
        picture, measured = (*saved[_LIGHT], np.nan)[:2]
        self._eye.reference_light = Light(float(picture), None if np.isnan(measured) else float(measured))
        self._start_pose = self._session.start_pose or Pose2()
        if self._session.start_pose is not None and self.config.solve == "plane":
            self._expectation.begin(-np.inf, Pose3.from_planar(self._session.start_pose).matrix())
            self._whereabouts.begin(Pose3.from_planar(self._session.start_pose).matrix(), is_assumed=True)

    def _begin(self, stamp_s: float, others: TrackedLandmarks, belief: Belief) -> Sequence[Estimate]:
        """Remember what is seen from the start; only if it could carry a pose."""
        pose = belief.pose_map_base or self._session.start_pose
        if pose is None:
            return [self._lost_now(stamp_s, "no start pose, and no map of this place", {})]
        needed = max(_START_LANDMARKS, self.config.min_landmarks)
        if len(others) < needed:
            return [self._lost_now(stamp_s, f"{len(others)} landmarks with depth, {needed} are needed", {})]
        T_map_base = Pose3.from_planar(pose).matrix()
        rows = self._tracker.remember(others, Anchor(T_map_base, np.zeros((3, 3))))
        self._remember(stamp_s, belief, T_map_base, rows)
        self._start_pose = pose
        self._expectation.begin(stamp_s, T_map_base)
        self._whereabouts.begin(T_map_base, belief=belief)
        self._told = (stamp_s, pose, np.zeros((3, 3)))
        return ()

    def _is_expected(self, stamp_s: float) -> bool:
        """Return whether a pose is expected; not while lost."""
        return self._expectation.last is not None and not self._is_gap(stamp_s)

    def _is_gap(self, stamp_s: float) -> bool:
        """Return whether the last pose is known, and older than `restart_s`."""
        last = self._expectation.last
        return last is not None and np.isfinite(last[0]) and stamp_s - last[0] > self.config.restart_s

    def _begin_in_space(self) -> None:
        """Say that the camera tilts, and expect it anywhere near: what was learned of its movement was of the plane."""
        logger.warning(
            "%s: the camera %r tilts, so that poses in the plane are wrong: from now on they are solved in space, by"
            " all landmarks that are followed. Set 'solve: space'",
            self._session.name or "kinect_landmarks",
            self.config.camera,
        )
        if self._expectation.last is not None:
            self._expectation.begin(*self._expectation.last)

    def _may_restart(self, stamp_s: float, others: TrackedLandmarks, picture: PreparedImage) -> bool:
        """Return whether landmarks are remembered anew: lost for a while, enough are seen, and not surely elsewhere."""
        is_enough = len(others) >= max(_START_LANDMARKS, self.config.min_landmarks)
        return is_enough and self._is_gap(stamp_s) and not self._doubts.is_surely_elsewhere(picture)

    def _restart(self, stamp_s: float, others: TrackedLandmarks, belief: Belief) -> None:
        """Remember landmarks anew where motions lead, by the belief or from the last pose; without them at that."""
        lead, last = self._whereabouts.lead, self._expectation.last
        assert last is not None
        if self._whereabouts.is_told_motion(belief) and belief.pose_map_base is not None:
            T_map_base = Pose3.from_planar(belief.pose_map_base).matrix()
            covariance = restart_covariance(0.0, belief.covariance)
        elif lead is not None:
            T_map_base, covariance = lead.T_map_base, restart_covariance(0.0, self._whereabouts.covariance)
        else:
            T_map_base = last[1]
            covariance = restart_covariance(stamp_s - last[0], self._whereabouts.covariance)
        self._tracker.remember(others, Anchor(T_map_base, covariance))
        self._expectation.begin(stamp_s, T_map_base)
        self._whereabouts.begin(T_map_base, covariance=covariance, belief=belief, is_assumed=True)
        self._counts["restarts"] += 1

    def _lost_now(self, stamp_s: float, reason: str, details: Mapping[str, float]) -> Lost:
        self._counts["lost"] += 1
        self._told = None  # a motion begins anew after a gap
        last = self._expectation.last
        if last is not None and not np.isfinite(last[0]):
            self._expectation.forget()  # the start pose did not fit the map: search all of it
            self._whereabouts.forget()
        return Lost(stamp_s, reason, details)

    def _remember(self, stamp_s: float, belief: Belief, T_map_base: Floats, rows: npt.NDArray[np.intp]) -> None:
        """Keep new landmarks in the localizer map while teaching."""
        localizer_map = self._session.map
        if self._session.mode != "teach" or localizer_map is None or len(rows) == 0:
            return
        light = self._eye.reference_light or Light(1.0)
        lights = np.array([light.picture, np.nan if light.measured is None else light.measured])
        registration = (self._camera.registration or Registration()).array()
        arrays = self._memory.arrays(rows) | {_LIGHT: lights, _REGISTRATION: registration}
        pose = Pose3.from_matrix(T_map_base).planar()
        localizer_map.add(Keyframe(belief.travelled_m, stamp_s, pose, arrays))

    def moved(self, keyframe: Keyframe, pose_map_base: Pose2) -> Keyframe:
        """Return a keyframe with its landmarks where they lie seen from another pose."""
        shift = Pose3.from_planar(pose_map_base @ keyframe.pose_map_base.inverse()).matrix()
        arrays = dict(keyframe.arrays)
        if "points" in arrays:
            arrays["points"] = arrays["points"] @ shift[:3, :3].T + shift[:3, 3]
        for name in ("cov", "anchor_cov"):
            if name in arrays:
                arrays[name] = shift[:3, :3] @ arrays[name] @ shift[:3, :3].T
        if "anchor" in arrays:
            anchor = arrays["anchor"].copy()
            anchor[:, :2] = anchor[:, :2] @ shift[:2, :2].T + shift[:2, 3]
            anchor[:, 2] += pose_map_base.theta - keyframe.pose_map_base.theta
            arrays["anchor"] = anchor
        return Keyframe(keyframe.station_m, keyframe.stamp_s, pose_map_base, arrays)

    def _answer(self, stamp_s: float, solved: Solved, picture: PreparedImage) -> Sequence[Estimate]:
        R, t = solved.T_map_base[:3, :3], solved.T_map_base[:3, 3]
        pose = Pose2(float(t[0]), float(t[1]), float(np.arctan2(R[1, 0], R[0, 0])))
        details = paper_numbers(solved.agreeing.seen, (self._start_pose or Pose2()).between(pose), self._camera)
        details |= {
            "n_agree": float(len(solved.agreeing)),
            "n_reserve": float(len(solved.agreeing) - self._solver.n_needed),
            "n_remembered": float(len(self._memory)),
            "n_moved": float(self._memory.is_moved.sum()),
            "residual_m": solved.residual_m,
            "light": picture.light,
        } | self._effort.details()
        return self._estimates(stamp_s, pose, solved, details)

    def _estimates(
        self, stamp_s: float, pose: Pose2, solved: Solved, details: Mapping[str, float]
    ) -> Sequence[Estimate]:
        systematic = systematic_covariance(self._watch.share, solved.drift, self._expectation.rates())
        covariance = solved.covariance + _FLOOR + systematic
        return [Fix(stamp_s, pose, information_from_covariance(covariance), details)]


class KinectMotion(KinectLandmarks):
    """Gives the same as motion since the last answer, for estimators that fuse it with fixes of others."""

    def _estimates(
        self, stamp_s: float, pose: Pose2, solved: Solved, details: Mapping[str, float]
    ) -> Sequence[Estimate]:
        covariance = solved.covariance + _FLOOR
        told, self._told = self._told, (stamp_s, pose, covariance)
        if told is None:  # the first after a gap has nothing to begin from
            return ()
        since_s, since, before = told
        turn = Pose2(theta=-since.theta).matrix()
        spread = turn @ (covariance + before) @ turn.T
        step = since.between(pose)
        systematic = motion_systematic(self._watch.share, step, stamp_s - since_s, solved.drift.depth_m)
        information = information_from_covariance(spread + systematic)
        return [Motion(since_s, stamp_s, step, information, details)]


def _landmarks_of(arrays: Mapping[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
    return {name: array for name, array in arrays.items() if name not in (_LIGHT, _REGISTRATION)}
