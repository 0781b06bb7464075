"""Motion from a downward camera."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from trailmark.estimates import Belief, Estimate, Lost, Motion
from trailmark.frames import Frame, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, Session
from trailmark.isolation.compiling import compile_together
from trailmark_ground_vo.config import GroundVOConfig
from trailmark_ground_vo.guarding import GroundTracker
from trailmark_ground_vo.motion import ImageMotion, ground_information, pose_prev_now
from trailmark_ground_vo.picture import PictureReader, camera_of, ground_plane
from trailmark_ground_vo.systematic import CameraErrors, motion_systematic
from trailmark_ground_vo.tracker import TrackedMotion, TrackingFailure
from trailmark_ground_vo.uncertainty import with_scatter

__all__ = ["GroundVO"]


class GroundVO(Localizer):
    """Estimates the robot's motion from picture to picture of the ground (Nagai & Watanabe 2015, Sec. II-A).

    Answers a `Motion` for every picture but the first, or `Lost` when a picture does not fit to the ones before. A
    short loss is bridged: the next motion begins where the last one ended. After a long one it leaves a gap.
    """

    config: GroundVOConfig

    def __init__(self, config: GroundVOConfig) -> None:
        super().__init__(config)
        self._sensor: SensorInfo
        self._reader: PictureReader
        self._tracker: GroundTracker | None = None
        self._counts = {"lost": 0, "flat_fields": 0}

    def start(self, session: Session) -> None:
        """Check the camera's calibration and compile the kernels.

        Raises
        ------
        ConfigError
            If the camera has no scale, or its pictures are too small.
        """
        self._sensor = camera_of(session, self.config.camera)
        self._reader = PictureReader(self._sensor)
        self._scale = ground_plane(self._sensor).metres_per_pixel
        self._mounting = self._sensor.pose_base_sensor.planar()
        self._mounting_inverse = self._mounting.inverse()
        self._tracker, self._counts = None, {"lost": 0, "flat_fields": 0}
        self._told_s = -math.inf
        self._warm_up(self._sensor.size or _USUAL_SIZE)

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Compare the picture with the one before.

        Raises
        ------
        ShapeError
            If size or kind of the pictures change.
        """
        if frame.sensor != self._sensor.name:
            return ()
        image = self._reader.read(frame)
        if self._tracker is None:
            self._width_px = image.shape[1]
            self._tracker = self._new_tracker((image.shape[1], image.shape[0]))
        step = self._tracker.step(image, frame.stamp_s, self._expect_motion(belief))
        if step is None:
            return ()
        if isinstance(step, TrackingFailure):
            self._counts["lost"] += 1
            return (Lost(frame.stamp_s, step.reason, step.details),)
        self._told_s = frame.stamp_s
        flat_field = self._tracker.new_flat_field()
        if flat_field is not None:
            self._counts["flat_fields"] += 1
            self._reader.learn(flat_field)
            self._tracker.refresh(self._reader.read(frame))
        return (self._motion(step, frame.stamp_s),)

    def counters(self) -> Mapping[str, int]:
        """Return how often the track was lost, and how often the flat field was learned anew."""
        return dict(self._counts)

    def _new_tracker(self, size: tuple[int, int]) -> GroundTracker:
        config, has_flat_field = self.config, self._reader.has_flat_field
        if config.learn_flat_field is None:
            config = config.model_copy(update={"learn_flat_field": not has_flat_field})
        if config.smooth_search is None and has_flat_field:
            config = config.model_copy(update={"smooth_search": True})
        return GroundTracker(config, size, self._scale[1] / self._scale[0])

    def _expect_motion(self, belief: Belief) -> ImageMotion | None:
        """Return how the content moves according to others, since the picture that the next is compared with.

        None where only this localizer tells, or there is no such picture yet.
        """
        since_s = None if self._tracker is None else self._tracker.since_s
        others_s = belief.stamp_s - belief.motion_age_s
        if belief.motion_age_s > _FRESH_S or others_s <= self._told_s + _SAME_S or self._told_s == -math.inf:
            return None
        if since_s is None:
            return None
        elapsed_s, twist = belief.stamp_s - since_s, belief.twist
        base = Pose2.exp(*(elapsed_s * part for part in (twist.forward_mps, twist.left_mps, twist.yaw_radps)))
        content = (self._mounting_inverse @ base @ self._mounting).inverse()
        return ImageMotion(content.x / self._scale[0], -content.y / self._scale[1], content.theta)

    def _warm_up(self, size: tuple[int, int]) -> None:
        compile_together("trailmark_ground_vo.first_kernels.FIRST_KERNELS")
        self._reader.warm_up()
        self._new_tracker(size).warm_up()

    def _motion(self, step: TrackedMotion, stamp_s: float) -> Motion:
        camera = pose_prev_now(step.motion, self._scale)
        errors = CameraErrors(self._width_px, self._scale, math.radians(self.config.tilt_deg), self._reader.unevenness)
        lasting = motion_systematic(step.motion, stamp_s - step.since_s, errors)
        widened = with_scatter(step.information, lasting)
        information = ground_information(widened, camera, self._scale, self._mounting)
        pose = self._mounting @ camera @ self._mounting_inverse
        return Motion(step.since_s, stamp_s, pose, information, step.details)


#: A belief without a motion for so long says nothing about this picture; stamps nearer than this are one [s].
_FRESH_S, _SAME_S = 0.25, 1e-6

#: Size of the paper's camera, to compile for when the source does not tell.
_USUAL_SIZE = (512, 480)
