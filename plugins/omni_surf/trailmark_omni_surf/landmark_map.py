"""The landmarks of a taught place: made from remembered observations, matched with features of a picture."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import StoreError
from trailmark.geometry import Pose2
from trailmark.paths import Keyframe
from trailmark_omni_surf.features import Features
from trailmark_omni_surf.landmarks import landmark_features, measure_landmark
from trailmark_omni_surf.matching_kernels import nearest_groups
from trailmark_omni_surf.pixel_bearings import PixelBearings
from trailmark_omni_surf.tracking import Observations

__all__ = ["Candidates", "LandmarkMap", "keyframe_arrays", "measured_candidates"]


_MIN_OBSERVATIONS = 3
_MAX_EXEMPLARS = 6  # descriptors kept of one landmark
_NEW_EXEMPLAR = 0.2  # a descriptor this far from all kept ones is kept too, between unit vectors


def keyframe_arrays(seen: Observations, camera: PixelBearings, pose_base_camera: Pose2) -> dict[str, npt.NDArray[Any]]:
    """Return what a keyframe remembers: which tracks were seen, under which bearing, how they looked."""
    return {
        "ids": seen.ids,
        "bearings": camera.bearings(seen.uv),
        "distances_px": camera.distances(seen.uv),
        "life": seen.life,
        "descriptors": seen.descriptors,
        "sign": seen.sign,
        "pose_base_camera": pose_base_camera.array(),
    }


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Tracked LI points that could be measured.

    Attributes
    ----------
    ids : (N,) int64
        Their tracks.
    positions : (N, 2) float64
        Measured, Eq. (3) [m].
    covariances : (N, 2, 2) float64
        Of the positions [m^2].
    features : (N, 6) float64
        The six of `landmark_features`.
    life : (N,) int64
        How many pictures each lasted.
    exemplars : sequence of (E, D) float32
        How each looks, one to six descriptors.
    sign : (N,) int8
        Sign of the Laplacian.
    """

    ids: npt.NDArray[np.int64]
    positions: Floats
    covariances: Floats
    features: Floats
    life: npt.NDArray[np.int64]
    exemplars: Sequence[npt.NDArray[np.float32]]
    sign: npt.NDArray[np.int8]


def measured_candidates(keyframes: Sequence[Keyframe], n_longest: int) -> Candidates:
    """Measure the tracks of the keyframes.

    Of those seen in a keyframe, the `n_longest` longest-lived count; what counts in one keyframe is a candidate.

    Parameters
    ----------
    keyframes : sequence of Keyframe
        With the arrays of `keyframe_arrays`.
    n_longest : int
        K of the paper.

    Raises
    ------
    StoreError
        If a keyframe lacks an array.
    """
    try:
        seen, chosen = _gather(keyframes), _longest(keyframes, n_longest)
    except KeyError as error:
        raise StoreError(f"a keyframe of the omnidirectional camera has no array {error}: teach again") from error
    rows = []
    for track_id in sorted(chosen):
        sightings = seen[track_id]
        if len(sightings) < _MIN_OBSERVATIONS:
            continue
        poses = np.array([sighting.pose for sighting in sightings])
        bearings = np.array([sighting.bearing for sighting in sightings])
        measurement = measure_landmark(poses, bearings)
        if measurement is None:
            continue
        distances = np.array([sighting.distance_px for sighting in sightings])
        features = landmark_features(poses, bearings, distances, measurement)
        inliers = [sighting.descriptor for sighting, fits in zip(sightings, measurement.is_inlier) if fits]
        rows.append((track_id, measurement, features, chosen[track_id], _exemplars(inliers), sightings[0].sign))
    return Candidates(
        np.array([row[0] for row in rows], dtype=np.int64),
        np.array([row[1].position for row in rows]).reshape(-1, 2),
        np.array([row[1].covariance for row in rows]).reshape(-1, 2, 2),
        np.array([row[2] for row in rows]).reshape(-1, 6),
        np.array([row[3] for row in rows], dtype=np.int64),
        [row[4] for row in rows],
        np.array([row[5] for row in rows], dtype=np.int8),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _PointSighting:
    pose: Floats
    bearing: float
    distance_px: float
    descriptor: npt.NDArray[np.float32]
    sign: int


def _gather(keyframes: Sequence[Keyframe]) -> dict[int, list[_PointSighting]]:
    """Return all sightings of every track, with the pose of the camera."""
    seen: dict[int, list[_PointSighting]] = defaultdict(list)
    for keyframe in keyframes:
        arrays = keyframe.arrays
        pose = (keyframe.pose_map_base @ Pose2.from_array(arrays["pose_base_camera"])).array()
        columns = (arrays["ids"], arrays["bearings"], arrays["distances_px"], arrays["descriptors"], arrays["sign"])
        for track_id, bearing, distance_px, descriptor, sign in zip(*columns):
            seen[int(track_id)].append(_PointSighting(pose, float(bearing), float(distance_px), descriptor, int(sign)))
    return seen


def _longest(keyframes: Sequence[Keyframe], n_longest: int) -> dict[int, int]:
    """Return the life of every track that is among the longest-lived of some keyframe."""
    life: dict[int, int] = {}
    for keyframe in keyframes:
        for track_id, pictures in zip(keyframe.arrays["ids"], keyframe.arrays["life"]):
            life[int(track_id)] = max(life.get(int(track_id), 0), int(pictures))
    chosen: dict[int, int] = {}
    for keyframe in keyframes:
        ids = sorted((int(track_id) for track_id in keyframe.arrays["ids"]), key=lambda k: (-life[k], k))
        chosen |= {track_id: life[track_id] for track_id in ids[:n_longest]}
    return chosen


def _exemplars(descriptors: Sequence[npt.NDArray[np.float32]]) -> npt.NDArray[np.float32]:
    """Return a few descriptors that stand for all: each next one is the farthest from those before."""
    stack = np.array(descriptors, dtype=np.float32)
    kept = [len(stack) // 2]
    while len(kept) < min(_MAX_EXEMPLARS, len(stack)):
        nearest = np.maximum(2.0 - 2.0 * (stack @ stack[kept].T).max(axis=1), 0.0)
        farthest = int(nearest.argmax())
        if math.sqrt(float(nearest[farthest])) < _NEW_EXEMPLAR:
            break
        kept.append(farthest)
    return stack[kept]


@dataclass(frozen=True, slots=True, eq=False)
class LandmarkMap:
    """Landmarks of a place.

    Attributes
    ----------
    positions : (L, 2) float64
        In the map [m].
    covariances : (L, 2, 2) float64
        Of the positions [m^2].
    exemplars : (M, D) float32
        Descriptors of all landmarks, those of one landmark in a row.
    exemplar_sign : (M,) int8
        Sign of the Laplacian of each.
    first : (L,) intp
        Index of each landmark's first exemplar.
    feature_name : str
        What kind of features they are.
    exemplar_columns : (D, M) float32
        The descriptors once more, as columns: matching runs along memory.
    """

    positions: Floats
    covariances: Floats
    exemplars: npt.NDArray[np.float32]
    exemplar_sign: npt.NDArray[np.int8]
    first: npt.NDArray[np.intp]
    feature_name: str
    exemplar_columns: npt.NDArray[np.float32] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "exemplar_columns", np.ascontiguousarray(self.exemplars.T))

    @classmethod
    def of(cls, candidates: Candidates, is_chosen: npt.NDArray[np.bool_], feature_name: str) -> LandmarkMap:
        """Return the map of the chosen candidates."""
        chosen = np.flatnonzero(is_chosen)
        exemplars = [candidates.exemplars[int(k)] for k in chosen]
        counts = np.array([len(stack) for stack in exemplars], dtype=np.intp)
        return cls(
            candidates.positions[chosen],
            candidates.covariances[chosen],
            np.concatenate(exemplars) if exemplars else np.empty((0, 1), np.float32),
            np.repeat(candidates.sign[chosen], counts),
            np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.intp) if len(counts) else counts,
            feature_name,
        )

    def __len__(self) -> int:
        return len(self.positions)

    def match(
        self, features: Features, max_distance: float, ratio: float
    ) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        """Return pairs (feature_idx, landmark_idx) that look alike: each other's nearest, within T_F of Eq. (1)."""
        nothing = np.empty(0, dtype=np.intp)
        if not len(self) or not len(features) or features.descriptors.shape[1] != self.exemplars.shape[1]:
            return nothing, nothing
        nearest, squared, second, nearest_feature = nearest_groups(
            features.descriptors, features.sign, self.exemplar_columns, self.exemplar_sign, self.first
        )
        is_mutual = nearest_feature[nearest] == np.arange(len(features))
        is_match = is_mutual & (squared <= max_distance**2) & (squared <= ratio**2 * second)
        feature_idx = np.flatnonzero(is_match)
        return feature_idx, nearest[feature_idx]

    def to_arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return all of it as arrays for a localizer map."""
        return {
            "positions": self.positions,
            "covariances": self.covariances,
            "exemplars": self.exemplars,
            "exemplar_sign": self.exemplar_sign,
            "first": self.first.astype(np.int64),
            "feature_name": np.frombuffer(self.feature_name.encode(), dtype=np.uint8),
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> LandmarkMap:
        """Read what `to_arrays` gave.

        Raises
        ------
        StoreError
            If an array is missing.
        """
        try:
            return cls(
                np.asarray(arrays["positions"], dtype=np.float64),
                np.asarray(arrays["covariances"], dtype=np.float64),
                np.asarray(arrays["exemplars"], dtype=np.float32),
                np.asarray(arrays["exemplar_sign"], dtype=np.int8),
                np.asarray(arrays["first"], dtype=np.intp),
                arrays["feature_name"].tobytes().decode(),
            )
        except KeyError as error:
            raise StoreError(f"the landmark map in the store has no array {error}: teach the place again") from error
