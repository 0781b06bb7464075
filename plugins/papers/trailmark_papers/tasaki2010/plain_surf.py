"""SURF alone in its plainest reading: every match counts, least squares over all of them, nothing is removed."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from trailmark.estimates import Belief, Estimate, Fix, Lost
from trailmark.frames import Frame, Image, Omni
from trailmark.geometry import Pose2
from trailmark.interfaces import Localizer, Session
from trailmark_omni_surf.bearing_kernels import closed_form, refine
from trailmark_omni_surf.centre import CentreFinder
from trailmark_omni_surf.config import OmniSurfConfig
from trailmark_omni_surf.features import create_features, grey_of
from trailmark_omni_surf.landmark_map import LandmarkMap

__all__ = ["PlainSurf"]

_MIN_LANDMARKS = 4  # "more than 3"


class PlainSurf(Localizer):
    """Not registered: there is no reason to use it but to compare.

    The paper does not say how its simple method treats wrong matches; the tracking-error criterion, which removes them,
    is told of the developed method alone.
    """

    config: OmniSurfConfig

    def start(self, session: Session) -> None:
        """Take the map."""
        config, sensor = self.config, session.sensors[self.config.camera]
        calibration = sensor.calibration if isinstance(sensor.calibration, Omni) else Omni()
        assert session.map is not None
        saved = session.map.load("landmarks")
        assert saved is not None
        self._landmarks = LandmarkMap.from_arrays(saved)
        self._centre = CentreFinder.of(calibration, config)
        self._extract = create_features(config.features, config.n_features, config.quality)
        self._pose_camera_base = sensor.pose_base_sensor.planar().inverse()

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Detect, match, and solve for the pose of all matches."""
        assert isinstance(frame.payload, Image)
        image = grey_of(frame.payload)
        problem = self._centre.look(image)
        if problem:
            return [Lost(frame.stamp_s, problem)]
        features = self._extract(image)
        feature_idx, landmark_idx = self._landmarks.match(features, self.config.descriptor_gate, self.config.ratio)
        if len(feature_idx) < _MIN_LANDMARKS:
            return [Lost(frame.stamp_s, f"{len(feature_idx)} landmarks recognised")]
        positions = np.ascontiguousarray(self._landmarks.positions[landmark_idx])
        bearings = self._centre.camera.bearings(features.uv[feature_idx])
        alike = np.ones(len(bearings))
        pose = closed_form(positions, bearings, alike)
        if not np.isfinite(pose).all():
            return [Lost(frame.stamp_s, "the bearings tell no place")]
        pose_map_camera = Pose2.from_array(refine(positions, bearings, alike, pose, math.inf, 20))
        return [Fix(frame.stamp_s, pose_map_camera @ self._pose_camera_base, np.eye(3), {"tracked": 0.0})]
