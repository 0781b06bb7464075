"""Localizes by bearings to taught landmarks: tracks them from picture to picture, or detects them anew."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats, Grey8
from trailmark.estimates import Belief, Estimate, Fix, Lost, information_from_covariance
from trailmark.geometry import Pose2, wrap_angle
from trailmark_omni_surf.bearings import BearingFix, BearingNoise, position_sigma, widened
from trailmark_omni_surf.config import OmniSurfConfig
from trailmark_omni_surf.features import FeatureExtractor
from trailmark_omni_surf.flows import NOTHING, FlowOptions, FlowResult, by_detection, by_tracking
from trailmark_omni_surf.landmark_map import LandmarkMap
from trailmark_omni_surf.pixel_bearings import PixelBearings
from trailmark_omni_surf.taught_views import TaughtViews, unwrapped_view
from trailmark_omni_surf.wobble import Wobble

__all__ = ["BearingLocalizer"]

_SAME_PLACE_M, _SAME_PLACE_RAD = 0.5, math.radians(15.0)
# Errors of landmarks are seen alike on so long a way (1/e, as measured in five simulated places), and while base rests.
_LASTS_M, _LASTS_S = 0.25, 10.0
_N_LOOKS = 4  # pictures whose fit counts, the last ones
_ENOUGH_SHARE = 0.6  # a refresh that finds fewer of the tracked landmarks than this is not taken
# By how much a pose errs for each metre beside the taught way: landmarks lie on the lines of sight from there, and how
# far along these shows from aside.
_ASIDE, _ASIDE_RAD_PER_M = 0.2, 0.04
_DENIED = 9  # times as many pictures must confirm a place to which odometry does not lead from the last answer
_MOST_UNCONFIRMED = 4  # pictures in a row, at most, in which what is tracked is not recognised
# Squared distance of two poses, in their covariance, that chance exceeds in 1 % (chi square of three numbers).
_ONE_POSE = 11.34


@dataclass(frozen=True, slots=True)
class _UnsurePlace:
    """A place that was not expected, and how well each picture so far fits it; NaN where that is not known."""

    pose_map_camera: Pose2
    pose_odom_base: Pose2
    shares: tuple[float, ...]

    def doubt(self, n_needed: int, place_fit: float) -> str:
        """Return why it is not told yet, or nothing."""
        if len(self.shares) < n_needed:
            return "looking again to make sure"
        known = [share for share in self.shares[-_N_LOOKS:] if not math.isnan(share)]
        if known and float(np.mean(known)) < place_fit:
            return f"it fits what was taught there by {np.mean(known):.1%} of what it could, {place_fit:.1%} are asked"
        return ""


@dataclass(frozen=True, slots=True)
class _LastAnswer:
    """The last pose that was told, and where odometry was then."""

    stamp_s: float
    pose_map_base: Pose2
    pose_odom_base: Pose2

    def correlation_s(self, stamp_s: float, pose_map_base: Pose2, belief: Belief) -> float:
        """Return how long an error lasts at the speed since then: while the same landmarks are seen from near by."""
        way_m = self._way_m(pose_map_base, belief)
        return min(_LASTS_M * (stamp_s - self.stamp_s) / max(way_m, 1e-9), _LASTS_S)

    def _way_m(self, pose_map_base: Pose2, belief: Belief) -> float:
        """Return the way since then [m]; that between the answers, where nothing tells of motion."""
        if math.isinf(belief.motion_age_s):
            return self.pose_map_base.distance_to(pose_map_base)
        return self.pose_odom_base.distance_to(belief.pose_odom_base)


class BearingLocalizer:
    """Finds the pose in a picture from bearings to landmarks, and keeps what the next picture is compared with.

    Parameters
    ----------
    config : OmniSurfConfig
        The localizer's options.
    landmarks : LandmarkMap
        The taught landmarks; not empty.
    views : TaughtViews
        What was seen along the taught way.
    way : (N, 2) float64
        Where base was then; empty where that is not known [m].
    extract : FeatureExtractor
        Finds the features of a picture.
    pose_base_camera : Pose2
        Mounting of the camera.
    """

    def __init__(
        self,
        config: OmniSurfConfig,
        landmarks: LandmarkMap,
        views: TaughtViews,
        way: Floats,
        *,
        extract: FeatureExtractor,
        pose_base_camera: Pose2,
    ) -> None:
        self._config = config
        self._views, self._way = views, way
        self._landmarks = landmarks
        self._extract = extract
        self._pose_base_camera = pose_base_camera
        self._pose_camera_base = pose_base_camera.inverse()
        self._options = _flow_options(config)
        self._counters = {"main_flow": 0, "sub_flow": 0, "landmarks_removed": 0}
        self._unsure: _UnsurePlace | None = None
        self._image: Grey8 | None = None
        self._finding = NOTHING
        self._n_tracked = self._n_unconfirmed = 0
        self._last: _LastAnswer | None = None
        self._wobble = Wobble()

    def counters(self) -> Mapping[str, int]:
        """Return how often each flow ran, and how many landmarks the tracking error removed."""
        return self._counters

    def locate(self, stamp_s: float, image: Grey8, camera: PixelBearings, belief: Belief) -> Estimate:
        """Track while enough landmarks are tracked (main flow), detect otherwise (sub flow)."""
        start = self._expected_pose(belief)
        finding = self._track(image, camera, start)
        is_tracked = finding.fix is not None
        if not is_tracked or self._n_tracked >= self._config.refresh_every:
            # Differs from the paper: a failed main flow costs no picture, and one that goes well is refreshed.
            detected = self._detect(image, camera, start)
            if self._takes_detected(finding, detected):
                finding, is_tracked = detected, False
        if finding.fix is None:
            self.forget()
            self._unsure = None
            return Lost(stamp_s, finding.reason, {"landmarks": float(finding.n_seen)})
        pose_map_camera = finding.fix.pose_map_base  # `locate` speaks of the camera
        if start is not None and _is_near(start, pose_map_camera):
            self._unsure = None
        else:
            doubt = self._doubt(stamp_s, pose_map_camera, image, camera, belief)
            if doubt:
                self.forget()
                reason = f"{len(finding.uv)} landmarks agree on a place: {doubt}"
                return Lost(stamp_s, reason, {"landmarks": float(finding.n_seen)})
        self._image, self._finding = image, finding
        return self._answer(stamp_s, finding, finding.fix, belief, is_tracked)

    def _doubt(
        self, stamp_s: float, pose_map_camera: Pose2, image: Grey8, camera: PixelBearings, belief: Belief
    ) -> str:
        """Return why a pose that was not expected is not believed; nothing after enough pictures that fit it."""
        shares: tuple[float, ...] = ()
        if self._unsure is not None:
            step = self._unsure.pose_odom_base.between(belief.pose_odom_base)
            moved = self._pose_camera_base @ step @ self._pose_base_camera
            if _is_near(self._unsure.pose_map_camera @ moved, pose_map_camera):
                shares = self._unsure.shares
        is_told = belief.pose_map_base is not None and _is_near(
            belief.pose_map_base @ self._pose_base_camera, pose_map_camera
        )
        is_asked = self._config.place_fit > 0.0 and not is_told
        share = self._views.share(pose_map_camera, unwrapped_view(image, camera)) if is_asked else math.nan
        self._unsure = _UnsurePlace(pose_map_camera, belief.pose_odom_base, (*shares, share))
        expected = self._wobble.expected(stamp_s, belief.pose_odom_base)
        n_more = self._config.confirm_pictures - 1
        if expected is not None and not is_told and not _is_near(expected @ self._pose_base_camera, pose_map_camera):
            n_more *= _DENIED
        return self._unsure.doubt(1 + n_more, self._config.place_fit)

    def _track(self, image: Grey8, camera: PixelBearings, start: Pose2 | None) -> FlowResult:
        """Main flow, where it can be gone."""
        if start is None or not self._is_main_flow(image):
            return NOTHING
        assert self._image is not None
        found = by_tracking(self._image, image, self._finding, self._landmarks, camera, self._options, start)
        self._n_tracked += 1
        self._counters["main_flow"] += 1
        self._counters["landmarks_removed"] += found.n_seen - len(found.uv)
        return found

    def _takes_detected(self, tracked: FlowResult, detected: FlowResult) -> bool:
        """Return whether to go on from what was detected; where it does not confirm what is tracked, look again.

        What is tracked and not recognised for several pictures is not believed any longer: what was detected is taken
        even where that is no place.
        """
        if tracked.fix is None or len(detected.uv) >= _ENOUGH_SHARE * len(tracked.uv):
            self._n_unconfirmed = 0
            return True
        if detected.fix is not None and _are_one(tracked.fix, detected.fix):
            self._n_unconfirmed = 0
            return False
        self._n_unconfirmed += 1
        if self._n_unconfirmed > _MOST_UNCONFIRMED:
            self._n_unconfirmed = 0
            return True
        self._n_tracked = self._config.refresh_every
        return False

    def _detect(self, image: Grey8, camera: PixelBearings, start: Pose2 | None) -> FlowResult:
        """Sub flow."""
        self._n_tracked = 0
        self._counters["sub_flow"] += 1
        return by_detection(image, self._extract, self._landmarks, camera, self._options, start)

    def _is_main_flow(self, image: Grey8) -> bool:
        """Step 5: more than T_n landmarks are left."""
        is_same_size = self._image is not None and self._image.shape == image.shape
        return self._config.use_tracking and is_same_size and len(self._finding.uv) > self._config.min_tracked

    def _expected_pose(self, belief: Belief) -> Pose2 | None:
        """Return where the camera should be: the last pose, carried along by the motion since.

        Without tracking there is none: every picture is looked at by itself.
        """
        if self._last is None or not self._config.use_tracking:
            return None
        step = self._last.pose_odom_base.between(belief.pose_odom_base)
        return self._last.pose_map_base @ step @ self._pose_base_camera

    def _answer(
        self, stamp_s: float, finding: FlowResult, fix: BearingFix, belief: Belief, is_tracked: bool
    ) -> Estimate:
        pose_map_base = fix.pose_map_base @ self._pose_camera_base
        correlation_s = None if self._last is None else self._last.correlation_s(stamp_s, pose_map_base, belief)
        self._last = _LastAnswer(stamp_s, pose_map_base, belief.pose_odom_base)
        details = {
            "landmarks": float(finding.n_seen),
            "agreeing": float(len(finding.uv)),
            "tracked": float(is_tracked),
            "error_deg": math.degrees(float(np.sqrt(np.mean(fix.errors_rad[fix.is_inlier] ** 2)))),
        }
        information = self._no_surer_than_scattered(self._about_base(fix), stamp_s, pose_map_base, belief)
        sigma_m = position_sigma(information)
        if sigma_m > self._config.max_position_sigma_m:
            why = f"the place is known to {sigma_m:.2f} m, and {self._config.max_position_sigma_m:g} m are asked"
            return Lost(stamp_s, why, details)
        return Fix(stamp_s, pose_map_base, information, details, correlation_s)

    def _no_surer_than_scattered(
        self, information: Floats, stamp_s: float, pose_map_base: Pose2, belief: Belief
    ) -> Floats:
        """Return information that promises no more than the answers of late scatter about the motion between them."""
        if math.isinf(belief.motion_age_s):
            return information
        expected = self._wobble.expected(stamp_s, belief.pose_odom_base)
        if expected is not None and not _is_near(expected, pose_map_base):
            self._wobble.clear()
        scatter = self._wobble.add(stamp_s, pose_map_base, belief.pose_odom_base)
        return information if scatter is None else widened(information, scatter)

    def _about_base(self, fix: BearingFix) -> Floats:
        """Carry the information from the camera to base, and add what the landmarks are off together."""
        lever = fix.pose_map_base @ self._pose_camera_base
        dx, dy = fix.pose_map_base.x - lever.x, fix.pose_map_base.y - lever.y
        jacobian = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])  # camera pose after base pose
        covariance = np.linalg.inv(jacobian.T @ fix.information @ jacobian)
        aside_m = math.sqrt(float(np.square(self._way - (lever.x, lever.y)).sum(axis=1).min(initial=math.inf)))
        aside_m = aside_m if math.isfinite(aside_m) else 0.0
        off_m = math.hypot(self._config.map_sigma_m, _ASIDE * aside_m)
        off_rad = math.hypot(math.radians(self._config.map_sigma_deg), _ASIDE_RAD_PER_M * aside_m)
        covariance += np.diag([off_m**2, off_m**2, off_rad**2])
        return information_from_covariance((covariance + covariance.T) / 2.0)

    def forget(self) -> None:
        """Expect nothing of the next picture: the one before it cannot be used."""
        self._image = None
        self._finding = NOTHING
        self._n_tracked = self._n_unconfirmed = 0
        self._last = None


def _are_one(a: BearingFix, b: BearingFix) -> bool:
    """Return whether two poses are one, as far as they are certain."""
    off = a.pose_map_base.array() - b.pose_map_base.array()
    off[2] = wrap_angle(off[2])
    covariance = np.linalg.inv(a.information) + np.linalg.inv(b.information)
    return float(off @ np.linalg.solve(covariance, off)) <= _ONE_POSE


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
