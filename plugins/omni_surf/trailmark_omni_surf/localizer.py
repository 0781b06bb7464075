"""The localizer ``omni_surf``: remembers tracked LI points while taught, localizes by their landmarks afterwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from trailmark.errors import ConfigError, SensorMismatchError, ShapeError
from trailmark.estimates import Belief, Estimate, Lost
from trailmark.frames import Frame, Image, Omni
from trailmark.interfaces import Localizer, LocalizerMap, Session
from trailmark_omni_surf.bearing_localizer import BearingLocalizer
from trailmark_omni_surf.centre import CentreFinder
from trailmark_omni_surf.config import OmniSurfConfig
from trailmark_omni_surf.features import create_features, grey_of
from trailmark_omni_surf.landmark_map import LandmarkMap
from trailmark_omni_surf.map_builder import LANDMARKS, MapBuilder
from trailmark_omni_surf.panorama import PanoramaFinder
from trailmark_omni_surf.taught_views import TaughtViews
from trailmark_omni_surf.warm_up import warm_up

__all__ = ["OmniSurf"]

_NO_FLOWS = {"main_flow": 0, "sub_flow": 0, "landmarks_removed": 0}


class OmniSurf(Localizer):
    """Bearings to taught landmarks give the pose, without a start pose and without a calibrated mirror.

    In teach a `MapBuilder` gets the pictures, otherwise a `BearingLocalizer` does.
    """

    config: OmniSurfConfig

    def start(self, session: Session) -> None:
        """Load the landmarks and compile the kernels.

        Raises
        ------
        ConfigError
            If the camera's calibration is of another model, or the features differ from the taught ones.
        """
        config, sensor = self.config, session.sensors[self.config.camera]
        if not isinstance(sensor.calibration, Omni | None):
            raise SensorMismatchError(
                f"omni_surf takes an omnidirectional camera, but {sensor.name!r} is calibrated as "
                f"{type(sensor.calibration).__name__}; give it the keys of Omni: turns, forward_deg, or none"
            )
        self._is_teaching = session.mode == "teach"
        self._centre = (
            PanoramaFinder.of(sensor.calibration)
            if config.unwrapped
            else CentreFinder.of(sensor.calibration or Omni(), config)
        )
        pose_base_camera = sensor.pose_base_sensor.planar()
        extract = create_features(config.features, config.n_features, config.quality)
        warm_up(extract)
        self._map_builder = MapBuilder(config, session.map, extract=extract, pose_base_camera=pose_base_camera)
        self._bearing_localizer: BearingLocalizer | None = None
        landmarks = None if self._is_teaching else _load_landmarks(session.map, config.descriptor_name)
        if landmarks is not None and len(landmarks):
            keyframes = session.map.keyframes() if session.map is not None else ()
            views = TaughtViews.of(keyframes if config.place_fit > 0 else ())
            way = np.array([keyframe.pose_map_base.array()[:2] for keyframe in keyframes]).reshape(-1, 2)
            self._bearing_localizer = BearingLocalizer(
                config, landmarks, views, way, extract=extract, pose_base_camera=pose_base_camera
            )

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Remember tracked points in teach; otherwise return a `Fix`, or `Lost` with the reason."""
        if not isinstance(frame.payload, Image):
            kind = type(frame.payload).__name__
            raise ShapeError(f"omni_surf takes pictures, but sensor {frame.sensor!r} gave {kind}")
        image = grey_of(frame.payload)
        problem = self._centre.look(image)
        if problem:
            if self._bearing_localizer is not None:
                self._bearing_localizer.forget()
            return [Lost(frame.stamp_s, problem)]
        if self._is_teaching:
            self._map_builder.add(frame.stamp_s, image, self._centre.camera, belief)
            return ()
        if self._bearing_localizer is None:
            return [Lost(frame.stamp_s, "no landmarks: nothing was taught here, or nothing could be measured")]
        return [self._bearing_localizer.locate(frame.stamp_s, image, self._centre.camera, belief)]

    def finish(self) -> None:
        """Measure the remembered points, select the landmarks among them and save them."""
        self._map_builder.finish()

    def counters(self) -> Mapping[str, int]:
        """Return how often each flow ran, how many landmarks the tracking error removed, and tracks found again."""
        flows = self._bearing_localizer.counters() if self._bearing_localizer is not None else _NO_FLOWS
        return {**flows, "tracks_rejoined": self._map_builder.n_rejoined}


def _load_landmarks(localizer_map: LocalizerMap | None, features: str) -> LandmarkMap | None:
    """Return the taught landmarks, None where there are none."""
    saved = localizer_map.load(LANDMARKS) if localizer_map is not None else None
    if saved is None:
        return None
    landmarks = LandmarkMap.from_arrays(saved)
    if landmarks.feature_name != features:
        raise ConfigError(
            f"the place was taught with features: {landmarks.feature_name}, but the config says "
            f"{features}; use the same, or teach it again"
        )
    return landmarks
