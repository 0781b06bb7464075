"""Builds the map while the place is taught: tracked points at keyframes, and landmarks selected among them."""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Bools, Grey8
from trailmark.estimates import Belief
from trailmark.geometry import Pose2
from trailmark.interfaces import LocalizerMap
from trailmark.paths import Keyframe
from trailmark_omni_surf.config import OmniSurfConfig
from trailmark_omni_surf.features import FeatureExtractor
from trailmark_omni_surf.landmark_map import Candidates, LandmarkMap, keyframe_arrays, measured_candidates
from trailmark_omni_surf.pixel_bearings import PixelBearings
from trailmark_omni_surf.selection import SelectionModel, shipped_model
from trailmark_omni_surf.spacing import KeyframeSpacing
from trailmark_omni_surf.taught_views import VIEW, unwrapped_view
from trailmark_omni_surf.tracking import TrackBook, TrackOptions

__all__ = ["LANDMARKS", "MapBuilder"]

#: Name of the landmarks in the localizer map.
LANDMARKS = "landmarks"


class MapBuilder:
    """Tracks points from picture to picture, remembers them at keyframes, and selects landmarks when teaching ends.

    Parameters
    ----------
    config : OmniSurfConfig
        The localizer's options.
    localizer_map : LocalizerMap or None
        Where keyframes and landmarks are kept; None: nowhere.
    extract : FeatureExtractor
        Finds the features of a picture.
    pose_base_camera : Pose2
        Mounting of the camera.
    """

    def __init__(
        self,
        config: OmniSurfConfig,
        localizer_map: LocalizerMap | None,
        *,
        extract: FeatureExtractor,
        pose_base_camera: Pose2,
    ) -> None:
        self._config = config
        self._localizer_map = localizer_map
        self._extract = extract
        self._pose_base_camera = pose_base_camera
        gate = config.descriptor_gate
        self._book = TrackBook(TrackOptions(gate, config.position_gate_px, rejoin_gate=0.75 * gate))
        self._spacing = KeyframeSpacing(config.keyframe_m, math.radians(config.keyframe_deg))

    @property
    def n_rejoined(self) -> int:
        """Tracks that were lost and found again."""
        return self._book.n_rejoined

    def add(self, stamp_s: float, image: Grey8, camera: PixelBearings, belief: Belief) -> None:
        """Carry all tracks into the picture; at a new place, remember what was found again."""
        features = self._extract(image)
        seen = self._book.update(image, features.select(camera.is_inside(features.uv)))
        pose, travelled_m = belief.pose_map_base, belief.travelled_m
        if pose is None or self._localizer_map is None or not self._spacing.is_new_place(travelled_m, pose):
            return
        self._spacing.add(travelled_m, pose)
        arrays = keyframe_arrays(seen, camera, self._pose_base_camera) | {VIEW: unwrapped_view(image, camera)}
        self._localizer_map.add(Keyframe(travelled_m, stamp_s, pose, arrays))

    def finish(self) -> None:
        """Measure the remembered points, select the landmarks among them and save them."""
        keyframes = self._localizer_map.keyframes() if self._localizer_map is not None else ()
        if self._localizer_map is None or not keyframes:
            return
        candidates = measured_candidates(keyframes, self._config.n_longest)
        chosen = self._select_candidates(candidates)
        landmarks = LandmarkMap.of(candidates, chosen, self._config.descriptor_name)
        self._localizer_map.save(LANDMARKS, landmarks.to_arrays())
        self._localizer_map.save(
            "candidates",
            {"features": candidates.features, "measured": candidates.positions, "is_chosen": chosen.astype(np.uint8)},
        )

    def _select_candidates(self, candidates: Candidates) -> Bools:
        """Return which candidates become landmarks."""
        config = self._config
        if config.selection == "all" or not len(candidates.ids):
            return np.ones(len(candidates.ids), dtype=bool)
        if config.selection == "covariance":
            sigma = np.sqrt(np.linalg.eigvalsh(candidates.covariances)[:, -1])
            return np.asarray(2.0 * sigma < config.label_distance_m)
        model = SelectionModel.load(config.model) if config.model is not None else shipped_model()
        return np.asarray(model.probability(candidates.features) >= 0.5)
