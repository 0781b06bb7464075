"""What the peers of a downward camera share: key frames, and motions between pictures from them."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import ShapeError
from trailmark.estimates import Belief, Estimate, Lost, Motion, information_from_covariance
from trailmark.frames import Frame
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, Session
from trailmark_baselines.ground.camera import DownwardCamera, Grey, ground_camera
from trailmark_baselines.ground.config import GroundPeerConfig

__all__ = ["GroundPeer", "KeyframeMatch", "Unaligned"]

View = TypeVar("View")

#: Share of an alignment's covariance that a motion has at least.
_LEAST_SHARE = 1e-3

#: Variance of the drift per key frame over that of one alignment, measured with KLT on procedural floors: what is
#: wrong with a corner is partly wrong in all pictures, and with its neighbours.
_GROWTH = 4.0
#: What a key frame errs by however many pairs there are: the bias of finding fractions of a pixel [px].
_BIAS_PX = 0.03


@dataclass(frozen=True, slots=True, eq=False)
class KeyframeMatch:
    """A picture against a key frame.

    Attributes
    ----------
    pose_key_now : Pose2
        The camera now as seen from the key frame.
    covariance : (3, 3) float64
        Of x, y, theta [m, m, rad].
    is_thin : bool
        So little of the key frame is left that it should be replaced.
    details : mapping of str to float
        For those who look closer.
    """

    pose_key_now: Pose2
    covariance: Floats
    is_thin: bool = False
    details: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Unaligned:
    """Why a picture does not fit to a key frame.

    Attributes
    ----------
    reason : str
        In a few words, for `Lost`.
    details : mapping of str to float
        The numbers that decided, by name.
    """

    reason: str
    details: Mapping[str, float] = field(default_factory=dict)


@dataclass(slots=True)
class _KeyframeTrack(Generic[View]):
    key: View
    last: View  # the picture before, the next key frame should this one fail
    pose_key_last: Pose2
    last_s: float
    step: Pose2 = field(default_factory=Pose2)
    step_s: float = 0.0
    n_failed: int = 0


class GroundPeer(Localizer, Generic[View]):
    """Motion from picture to picture; the error is that of key frames, not of pictures."""

    config: GroundPeerConfig

    def start(self, session: Session) -> None:
        """Check the camera.

        Raises
        ------
        ConfigError
            If it has no scale, or is not there.
        """
        self.camera: DownwardCamera = ground_camera(session, self.config.camera)
        self._track: _KeyframeTrack[View] | None = None
        self._shape: tuple[int, ...] | None = None
        self._counts = {"lost": 0, "key_frames": 0}

    def counters(self) -> Mapping[str, int]:
        """Return how often it was lost, and the key frames taken."""
        return dict(self._counts)

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return the motion since the picture before, or `Lost`.

        Raises
        ------
        ShapeError
            If the pictures change their size.
        """
        if frame.sensor != self.camera.name:
            return ()
        image = self.camera.grey(frame)
        self._shape = self._shape or image.shape
        if image.shape != self._shape:
            raise ShapeError(f"sensor {frame.sensor!r} gave pictures of {self._shape}, and now one of {image.shape}")
        view = self.view(image)
        if self._track is None:
            self._begin(view, Pose2(), frame.stamp_s)
            return ()
        track = self._track
        found = self._align(track, view, frame.stamp_s)
        if isinstance(found, Unaligned):
            return (self._begin_anew(track, view, frame.stamp_s, found),)
        return (self._motion_of(track, view, image, frame.stamp_s, found),)

    @abstractmethod
    def view(self, image: Grey) -> View:
        """Return what is kept of a picture."""

    @abstractmethod
    def align(self, key: View, now: View, expected: Pose2) -> KeyframeMatch | Unaligned:
        """Return the camera now as seen from the key frame.

        Parameters
        ----------
        expected : Pose2
            Where it should be if it moves on as before.
        """

    def _begin(self, view: View, step: Pose2, stamp_s: float) -> None:
        self._track = _KeyframeTrack(view, view, Pose2(), stamp_s, step)
        self._counts["key_frames"] += 1

    def _align(self, track: _KeyframeTrack[View], view: View, stamp_s: float) -> KeyframeMatch | Unaligned:
        """Align with the key frame; should it fail, with the last picture, which then is the key frame."""
        pace = (stamp_s - track.last_s) / track.step_s if track.step_s > 0.0 else 1.0
        step = Pose2.exp(*(pace * part for part in track.step.log()))
        found = self.align(track.key, view, track.pose_key_last @ step)
        if isinstance(found, KeyframeMatch) or track.last is track.key:
            return found
        again = self.align(track.last, view, step)
        if isinstance(again, Unaligned):
            return found
        track.key, track.pose_key_last = track.last, Pose2()
        self._counts["key_frames"] += 1
        return again

    def _begin_anew(self, track: _KeyframeTrack[View], view: View, stamp_s: float, why: Unaligned) -> Lost:
        self._counts["lost"] += 1
        track.n_failed += 1
        if track.n_failed > self.config.patience_frames:
            self._begin(view, Pose2(), stamp_s)
        return Lost(stamp_s, why.reason, why.details)

    def _motion_of(
        self, track: _KeyframeTrack[View], view: View, image: Grey, stamp_s: float, found: KeyframeMatch
    ) -> Motion:
        before, step = track.pose_key_last, track.pose_key_last.between(found.pose_key_now)
        travelled = self._share_of_key_frame(found.pose_key_now, image.shape)
        share = min(1.0, max(_LEAST_SHARE, self._share_of_key_frame(step, image.shape)))
        bias_m = _BIAS_PX * max(self.camera.plane.metres_per_pixel)
        covariance = share * (_GROWTH * found.covariance + np.diag([bias_m**2, bias_m**2, 0.0]))
        motion = self._motion(before, step, covariance, (track.last_s, stamp_s), found.details)
        track.step, track.step_s = step, stamp_s - track.last_s
        track.last, track.pose_key_last, track.last_s, track.n_failed = view, found.pose_key_now, stamp_s, 0
        if travelled >= 1.0 or found.is_thin:
            track.key, track.pose_key_last = view, Pose2()
            self._counts["key_frames"] += 1
        return motion

    def _share_of_key_frame(self, pose: Pose2, shape: tuple[int, ...]) -> float:
        """Return how much of a key frame's life a motion takes; 1 is all of it."""
        limit_m = self.config.key_shift * min(shape[:2]) * max(self.camera.plane.metres_per_pixel)
        turned = abs(pose.theta) / math.radians(self.config.key_turn_deg)
        return max(turned, math.hypot(pose.x, pose.y) / limit_m) if limit_m > 0.0 else 1.0

    def _motion(
        self, pose_key_before: Pose2, step: Pose2, covariance: Floats, stamps: tuple[float, float],
        details: Mapping[str, float],
    ) -> Motion:  # fmt: skip
        """Return the motion of base from that of the camera.

        What a key frame errs by is shared by all motions of its life; each takes the share that it drives of it.
        """
        mounting = self.camera.mounting
        base = mounting @ step @ mounting.inverse()
        turn = mounting.theta - pose_key_before.theta  # the covariance has the axes of the key frame
        cos, sin = math.cos(turn), math.sin(turn)
        cos_b, sin_b = math.cos(base.theta), math.sin(base.theta)
        # base moves by R_m t_camera + m - R(theta) m
        J = np.array(
            [
                [cos, -sin, sin_b * mounting.x + cos_b * mounting.y],
                [sin, cos, -cos_b * mounting.x + sin_b * mounting.y],
                [0.0, 0.0, 1.0],
            ]
        )
        spread = J @ covariance @ J.T
        information = information_from_covariance((spread + spread.T) / 2.0)
        return Motion(stamps[0], stamps[1], base, information, details)
