"""The localizer `divs`: teaches a visual stream, and says by it where the robot is beside the taught path."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from trailmark.errors import ConfigError, SensorMismatchError
from trailmark.estimates import Belief, Estimate, Lost
from trailmark.frames import RGBD, Frame, Image
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, LocalizerMap, Session
from trailmark_divs.config import DivsConfig
from trailmark_divs.drift import DriftLaw, radians_per_column
from trailmark_divs.eye import TURNING, ImagePreprocessor
from trailmark_divs.keyframe_writer import KeyframeWriter
from trailmark_divs.layout import grey_region, make_layout
from trailmark_divs.replay import StreamMatcher
from trailmark_divs.selection import FrameSelector
from trailmark_divs.taught_layout import check_layout, layout_document
from trailmark_divs.taught_stream import TaughtStream, summarize
from trailmark_divs.warm_up import compile_kernels

__all__ = ["Divs"]

logger = logging.getLogger(__name__)

_WINDING_COLUMNS = 2.0  # what the view swings on a winding way: the stream then sees an average of different views
_GRACE_S = 5.0  # odometry starts with the robot
_SIDEWAYS = 0.5  # cosine of the camera's yaw below which it looks sideways: shifts then tell the station


class Divs(Localizer):
    """Drift from a taught path, from differential visual streams of one camera."""

    config: DivsConfig

    def __init__(self, config: DivsConfig) -> None:
        super().__init__(config)
        self._eye: ImagePreprocessor | None = None
        self._counts = {"looks": 0, "turning": 0, "lost": 0}

    def start(self, session: Session) -> None:
        """Load what was taught and compile the kernels.

        Raises
        ------
        ConfigError
            If there is no path, nothing to remember it with, or the camera looks sideways.
        StoreError
            If the path was taught without this localizer.
        """
        self._session = session
        self._depth_m = self._signed_depth()
        step = self.config.spacing_s if self.config.select == "time" else self.config.spacing_m
        self._selector = FrameSelector(self.config.select, step)
        self._eye = None
        self._memory: KeyframeWriter | None = None
        self._recording: TaughtStream | None = None
        self._replay: StreamMatcher | None = None
        self._counts = dict.fromkeys(self._counts, 0)
        self._waits_since_s: float | None = None
        compile_kernels()
        localizer_map = self._localizer_map()
        if session.mode == "teach":
            self._memory = KeyframeWriter(localizer_map, self.config.picture_spacing_m)
        elif session.path is None:
            raise ConfigError(f"{session.name}: divs needs a taught path; give the run --store, or teach one first")
        else:
            self._recording = TaughtStream.from_keyframes(localizer_map.keyframes())
            if self.config.when_blind == "pictures" and not len(self._recording.pictures):
                logger.warning(
                    "%s: the path was taught without small pictures, so 'when_blind: pictures' has none to compare:"
                    " teach it anew with that key",
                    session.name,
                )

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Process a picture if it belongs to the stream; in replay, return the drift from the path."""
        payload = frame.payload
        if self._memory is None:  # teaching asks for itself
            self._ask_for_motion(frame.stamp_s, belief)
        if not isinstance(payload, Image | RGBD) or not self._selector.is_due(frame.stamp_s, belief.travelled_m):
            return ()
        eye = self._eye or self._begin(frame, payload)
        look = eye.look(grey_region(payload, self._layout.rows), frame.stamp_s, belief)
        if look is None:
            return ()
        self._counts["looks"] += 1
        self._counts["turning"] += look.run == TURNING
        if self._memory is not None:
            self._memory.add(look, belief.pose_map_base or Pose2())
            return ()
        assert self._replay is not None
        estimate = self._replay.answer(
            look,
            eye.window(),
            belief,
            are_turns_measured=eye.are_turns_measured,
            is_winding=eye.bend_columns > _WINDING_COLUMNS,
        )
        self._counts["lost"] += isinstance(estimate, Lost)
        return (estimate,)

    def finish(self) -> None:
        """Write what is left of the teaching, and a summary of what was taught."""
        if self._memory is not None:
            self._memory.flush()
        localizer_map = self._localizer_map()
        keyframes = localizer_map.keyframes()
        if not keyframes:
            logger.warning("%s: no picture was taught", self._session.name)
            return
        summary = summarize(TaughtStream.from_keyframes(keyframes))
        localizer_map.save("summary", {name: np.array([value]) for name, value in summary.items()})
        if summary["turning_share"] > 0.5:
            logger.warning(
                "%s: turning on %.0f %% of the path, where streams are blind: raise turn_limit_deg or turn more gently",
                self._session.name,
                100.0 * summary["turning_share"],
            )

    def counters(self) -> Mapping[str, int]:
        """Return the looks taken, those in turns, and the answers that were `Lost`."""
        return dict(self._counts)

    def change_image(self) -> npt.NDArray[np.float32]:
        """Return the change image of the window so far, (rows, width) in [0, 1].

        Raises
        ------
        ConfigError
            Without `keep_change_image` in the config, or before the first picture.
        ShapeError
            If no difference has been seen since "time zero".
        """
        if self._eye is None or not self.config.keep_change_image:
            raise ConfigError("no change image: set keep_change_image, and show the localizer two pictures first")
        return self._eye.change_image()

    def _ask_for_motion(self, stamp_s: float, belief: Belief) -> None:
        """Refuse to wait for a way that no localizer measures.

        Raises
        ------
        ConfigError
            If pictures are taken by the way driven, and for a while nothing has told of any.
        """
        if self.config.select != "distance" or math.isfinite(belief.motion_age_s) or belief.travelled_m != 0.0:
            self._waits_since_s = None
            return
        if self._waits_since_s is None:
            self._waits_since_s = stamp_s
        if stamp_s - self._waits_since_s > _GRACE_S:
            raise ConfigError(
                f"{self._session.name}: divs takes its pictures by the way driven, and in {_GRACE_S:g} s no localizer"
                " has given any motion: add 'odometry' with the robot's wheel odometry, or 'constant_speed' if there is"
                " none; or take pictures by time (select: time)"
            )

    def _begin(self, frame: Frame, payload: Image | RGBD) -> ImagePreprocessor:
        """Lay out the columns for the size of the first picture, and get ready for the rest."""
        config, session = self.config, self._session
        height, width = (payload.bgr if isinstance(payload, RGBD) else payload.pixels).shape[:2]
        layout = self._layout = make_layout((width, height), config.columns, config.region, config.lens_radius)
        info = session.sensors.get(frame.sensor)
        calibration = None if info is None else info.calibration
        angle_rad = radians_per_column(calibration, config.field_of_view_deg, layout.column_px, config.columns, width)
        document = layout_document(layout, config.region, config.lens_radius, config.threshold)
        if self._memory is not None:
            self._memory.begin(document, session.name)
        elif self._recording is not None and session.path is not None:
            check_layout(self._localizer_map(), document, session.name)
            law = DriftLaw(None if config.gain == "paper" else 1.0 / angle_rad, self._depth_m)
            self._replay = StreamMatcher(config, layout, self._recording, session.path, law, angle_rad, frame.stamp_s)
        self._eye = ImagePreprocessor(config, layout, angle_rad)
        return self._eye

    def _localizer_map(self) -> LocalizerMap:
        if self._session.map is None:
            raise ConfigError(f"{self._session.name}: divs remembers a path in a store; give the run --store")
        return self._session.map

    def _signed_depth(self) -> float:
        """Return the depth that sideways drift is seen at; negative for a camera that looks back [m]."""
        info = self._session.sensors.get(self.config.camera)
        along = 1.0 if info is None else math.cos(info.pose_base_sensor.yaw)
        if abs(along) < _SIDEWAYS:
            raise SensorMismatchError(
                f"{self._session.name}: camera {self.config.camera!r} looks sideways; divs needs one that looks along"
                " the path. Its mounting is 'sensors: ... mounting: {yaw_deg: ...}'"
            )
        return self.config.depth_m / along
