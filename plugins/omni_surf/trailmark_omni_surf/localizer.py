"""The localizer ``omni_surf``: remembers tracked LI points while taught, localizes by their landmarks afterwards."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from trailmark.errors import ConfigError, ShapeError
from trailmark.estimates import Belief, Estimate, Fix, Lost, information_from_covariance
from trailmark.frames import Frame, Image, Omni
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, Session
from trailmark.paths import Keyframe
from trailmark_omni_surf.bearings import BearingFix, BearingNoise
from trailmark_omni_surf.centre import CentreFinder
from trailmark_omni_surf.config import OmniSurfConfig
from trailmark_omni_surf.features import Features, create_features, grey_of
from trailmark_omni_surf.flows import NOTHING, FlowOptions, FlowResult, by_detection, by_tracking
from trailmark_omni_surf.landmark_map import Candidates, LandmarkMap, keyframe_arrays, measured_candidates
from trailmark_omni_surf.selection import SelectionModel, shipped_model
from trailmark_omni_surf.tracking import TrackBook, TrackOptions
from trailmark_omni_surf.warm_up import warm_up

__all__ = ["OmniSurf"]

Grey = npt.NDArray[np.uint8]

_MAP = "landmarks"
_SAME_PLACE_M, _SAME_PLACE_RAD = 0.5, math.radians(15.0)
_ENOUGH_SHARE = 0.6  # a refresh that finds fewer of the tracked landmarks than this is not taken


class OmniSurf(Localizer):
    """Bearings to taught landmarks give the pose, without a start pose and without a calibrated mirror."""

    config: OmniSurfConfig
    _image: Grey | None
    _finding: FlowResult
    _n_tracked: int
    _last_pose: tuple[Pose2, Pose2] | None
    _pending: tuple[Pose2, Pose2, int] | None

    def start(self, session: Session) -> None:
        """Load the landmarks and compile the kernels.

        Raises
        ------
        ConfigError
            If the camera's calibration is of another model, or the features differ from the taught ones.
        """
        config, sensor = self.config, session.sensors[self.config.camera]
        if not isinstance(sensor.calibration, Omni | None):
            raise ConfigError(
                f"omni_surf takes an omnidirectional camera, but {sensor.name!r} is calibrated as "
                f"{type(sensor.calibration).__name__}; give it the keys of Omni: turns, forward_deg, or none"
            )
        self._mode, self._localizer_map = session.mode, session.map
        self._pose_base_camera = sensor.pose_base_sensor.planar()
        self._pose_camera_base = self._pose_base_camera.inverse()
        self._centre = CentreFinder.of(sensor.calibration or Omni(), config)
        self._extract = create_features(config.features, config.n_features, config.quality)
        self._options = _flow_options(config)
        self._book = TrackBook(_track_options(config))
        self._last_keyframe: tuple[float, Pose2] | None = None
        self._forget()
        self._pending = None
        self._counters = {"main_flow": 0, "sub_flow": 0, "landmarks_removed": 0}
        warm_up(self._extract)
        self._landmarks = self._load_map() if self._mode != "teach" else None

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Remember tracked points in teach; otherwise return a `Fix`, or `Lost` with the reason."""
        if not isinstance(frame.payload, Image):
            kind = type(frame.payload).__name__
            raise ShapeError(f"omni_surf takes pictures, but sensor {frame.sensor!r} gave {kind}")
        image = grey_of(frame.payload)
        problem = self._centre.look(image)
        if problem:
            self._forget()
            return [Lost(frame.stamp_s, problem)]
        if self._mode == "teach":
            self._teach(frame.stamp_s, image, belief)
            return ()
        if self._landmarks is None or not len(self._landmarks):
            return [Lost(frame.stamp_s, "no landmarks: nothing was taught here, or nothing could be measured")]
        return [self._localize(self._landmarks, frame.stamp_s, image, belief)]

    def finish(self) -> None:
        """Measure the remembered points, select the landmarks among them and save them."""
        if self._localizer_map is None:
            return
        keyframes = self._localizer_map.keyframes()
        if not keyframes:
            return
        candidates = measured_candidates(keyframes, self.config.n_longest)
        chosen = self._selected(candidates)
        landmarks = LandmarkMap.of(candidates, chosen, self.config.features)
        self._localizer_map.save(_MAP, landmarks.to_arrays())
        self._localizer_map.save(
            "candidates",
            {"features": candidates.features, "measured": candidates.positions, "is_chosen": chosen.astype(np.uint8)},
        )

    def counters(self) -> Mapping[str, int]:
        """Return how often each flow ran, and how many landmarks the tracking error removed."""
        return {**self._counters, "tracks_rejoined": self._book.n_rejoined}

    # --- teach -------------------------------------------------------------------------------------------------------

    def _teach(self, stamp_s: float, image: Grey, belief: Belief) -> None:
        """Carry all tracks into the picture; at a new place, remember what was found again."""
        camera = self._centre.camera
        seen = self._book.update(image, self._features_inside(image))
        pose = belief.pose_map_base
        if pose is None or self._localizer_map is None or not self._is_new_place(belief.travelled_m, pose):
            return
        self._last_keyframe = (belief.travelled_m, pose)
        arrays = keyframe_arrays(seen, camera, self._pose_base_camera)
        self._localizer_map.add(Keyframe(belief.travelled_m, stamp_s, pose, arrays))

    def _features_inside(self, image: Grey) -> Features:
        features = self._extract(image)
        return features.chosen(self._centre.camera.is_inside(features.uv))

    def _is_new_place(self, travelled_m: float, pose: Pose2) -> bool:
        if self._last_keyframe is None:
            return True
        last_m, last_pose = self._last_keyframe
        turn_rad = abs(last_pose.between(pose).theta)
        return travelled_m - last_m >= self.config.keyframe_m or turn_rad >= math.radians(self.config.keyframe_deg)

    def _selected(self, candidates: Candidates) -> npt.NDArray[np.bool_]:
        """Return which candidates become landmarks."""
        config = self.config
        if config.selection == "all" or not len(candidates.ids):
            return np.ones(len(candidates.ids), dtype=bool)
        if config.selection == "covariance":
            sigma = np.sqrt(np.linalg.eigvalsh(candidates.covariances)[:, -1])
            return np.asarray(2.0 * sigma < config.label_distance_m)
        model = SelectionModel.load(config.model) if config.model is not None else shipped_model()
        return np.asarray(model.probability(candidates.features) >= 0.5)

    # --- localize ----------------------------------------------------------------------------------------------------

    def _localize(self, landmarks: LandmarkMap, stamp_s: float, image: Grey, belief: Belief) -> Estimate:
        """Track while enough landmarks are tracked (main flow), detect otherwise (sub flow)."""
        start = self._expected(belief)
        tracked = self._track(landmarks, image, start)
        finding, is_tracked = tracked, True
        if tracked.fix is None or self._n_tracked >= self.config.refresh_every:
            # Differs from the paper: a failed main flow costs no picture, and one that goes well is refreshed.
            detected = self._detect(landmarks, image, start)
            if tracked.fix is None or len(detected.uv) >= _ENOUGH_SHARE * len(tracked.uv):
                finding, is_tracked = detected, False
        if finding.fix is None:
            self._forget()
            self._pending = None
            return Lost(stamp_s, finding.reason, {"landmarks": float(finding.n_seen)})
        if not self._is_sure(finding.fix.pose_map_base, start, belief.pose_odom_base):
            self._forget()
            reason = f"{len(finding.uv)} landmarks agree on a place: looking again to make sure"
            return Lost(stamp_s, reason, {"landmarks": float(finding.n_seen)})
        self._image, self._finding = image, finding
        return self._answer(stamp_s, finding, finding.fix, belief, is_tracked)

    def _is_sure(self, pose_map_camera: Pose2, start: Pose2 | None, pose_odom_base: Pose2) -> bool:
        """Return whether a pose is where it was expected, or was found in enough pictures in a row."""
        if start is not None and _is_near(start, pose_map_camera):
            self._pending = None
            return True
        n_seen = 1
        if self._pending is not None:
            pose_before, odom_before, n_before = self._pending
            moved = self._pose_camera_base @ odom_before.between(pose_odom_base) @ self._pose_base_camera
            if _is_near(pose_before @ moved, pose_map_camera):
                n_seen = n_before + 1
        self._pending = (pose_map_camera, pose_odom_base, n_seen)
        return n_seen >= self.config.confirm_pictures

    def _track(self, landmarks: LandmarkMap, image: Grey, start: Pose2 | None) -> FlowResult:
        """Main flow, where it can be gone."""
        if start is None or not self._is_main_flow(image):
            return NOTHING
        assert self._image is not None
        found = by_tracking(self._image, image, self._finding, landmarks, self._centre.camera, self._options, start)
        self._n_tracked += 1
        self._counters["main_flow"] += 1
        self._counters["landmarks_removed"] += found.n_seen - len(found.uv)
        return found

    def _detect(self, landmarks: LandmarkMap, image: Grey, start: Pose2 | None) -> FlowResult:
        """Sub flow."""
        self._n_tracked = 0
        self._counters["sub_flow"] += 1
        return by_detection(image, self._extract, landmarks, self._centre.camera, self._options, start)

    def _is_main_flow(self, image: Grey) -> bool:
        """Step 5: more than T_n landmarks are left."""
        is_same_size = self._image is not None and self._image.shape == image.shape
        return self.config.use_tracking and is_same_size and len(self._finding.uv) > self.config.min_tracked

    def _expected(self, belief: Belief) -> Pose2 | None:
        """Return where the camera should be: the last pose, carried along by the motion since.

        Without tracking there is none: every picture is looked at by itself.
        """
        if self._last_pose is None or not self.config.use_tracking:
            return None
        pose_map_base, pose_odom_base = self._last_pose
        return pose_map_base @ pose_odom_base.between(belief.pose_odom_base) @ self._pose_base_camera

    def _answer(self, stamp_s: float, finding: FlowResult, fix: BearingFix, belief: Belief, is_tracked: bool) -> Fix:
        pose_map_base = fix.pose_map_base @ self._pose_camera_base  # `locate` speaks of the camera
        self._last_pose = (pose_map_base, belief.pose_odom_base)
        details = {
            "landmarks": float(finding.n_seen),
            "agreeing": float(len(finding.uv)),
            "tracked": float(is_tracked),
            "error_deg": math.degrees(float(np.sqrt(np.mean(fix.errors_rad[fix.is_inlier] ** 2)))),
        }
        return Fix(stamp_s, pose_map_base, self._about_base(fix), details)

    def _about_base(self, fix: BearingFix) -> npt.NDArray[np.float64]:
        """Carry the information from the camera to base, and add what the landmarks are off together."""
        lever = fix.pose_map_base @ self._pose_camera_base
        dx, dy = fix.pose_map_base.x - lever.x, fix.pose_map_base.y - lever.y
        jacobian = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])  # camera pose after base pose
        covariance = np.linalg.inv(jacobian.T @ fix.information @ jacobian)
        heading_rad = math.radians(self.config.map_sigma_deg)
        covariance += np.diag([self.config.map_sigma_m**2, self.config.map_sigma_m**2, heading_rad**2])
        return information_from_covariance((covariance + covariance.T) / 2.0)

    def _forget(self) -> None:
        self._image = None
        self._finding = NOTHING
        self._n_tracked = 0
        self._last_pose = None

    def _load_map(self) -> LandmarkMap | None:
        saved = self._localizer_map.load(_MAP) if self._localizer_map is not None else None
        if saved is None:
            return None
        landmarks = LandmarkMap.from_arrays(saved)
        if landmarks.feature_name != self.config.features:
            raise ConfigError(
                f"the place was taught with features: {landmarks.feature_name}, but the config says "
                f"{self.config.features}; use the same, or teach it again"
            )
        return landmarks


def _is_near(expected: Pose2, pose: Pose2) -> bool:
    off = expected.between(pose)
    return math.hypot(off.x, off.y) <= _SAME_PLACE_M and abs(off.theta) <= _SAME_PLACE_RAD


def _flow_options(config: OmniSurfConfig) -> FlowOptions:
    noise = BearingNoise(
        math.radians(config.bearing_sigma_deg), math.radians(config.tracking_error_deg), config.max_position_sigma_m
    )
    return FlowOptions(
        noise,
        config.descriptor_gate,
        config.ratio,
        config.min_agreeing,
        config.max_rival_share,
        config.min_agreeing_share,
        math.radians(config.max_gap_deg),
    )


def _track_options(config: OmniSurfConfig) -> TrackOptions:
    gate = config.descriptor_gate
    return TrackOptions(gate, config.position_gate_px, rejoin_gate=0.75 * gate)
