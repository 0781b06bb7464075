"""Tracked LI points: tracked from picture to picture and found again by their features, Eqs. (1) and (2)."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats, Grey8
from trailmark_omni_surf.features import Features, match, squared_distances

__all__ = ["Observations", "TrackBook", "TrackOptions", "track_points"]


_WINDOW_PX = (15, 15)
_N_LEVELS = 3
_STOP = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 15, 0.03)
_MIN_APART_PX = 4.0  # a new track begins this far from the others
_N_ENDED = 400  # ended tracks that may still be joined with a later one


def track_points(
    previous: Grey8, current: Grey8, uv: Floats, return_px: float | None = 1.0
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Track points from one picture to the next (Lucas & Kanade, on a pyramid).

    Parameters
    ----------
    previous, current : (H, W) uint8
        Grey pictures.
    uv : (N, 2) float64
        Points in the previous picture [px].
    return_px : float or None
        Tracked back, a point must arrive this close to where it came from; None: not asked [px].

    Returns
    -------
    uv : (N, 2) float64
        Points in the current picture [px].
    is_tracked : (N,) bool
        Which were found.
    """
    if len(uv) == 0:
        return uv.copy(), np.empty(0, dtype=bool)
    start = uv.astype(np.float32).reshape(-1, 1, 2)
    end, status = _klt(previous, current, start)
    is_tracked = status.ravel() == 1
    if return_px is not None:
        back, status_back = _klt(current, previous, end)
        misses = np.linalg.norm((back - start).reshape(-1, 2), axis=1)
        is_tracked &= (status_back.ravel() == 1) & (misses < return_px)
    return end.reshape(-1, 2).astype(np.float64), is_tracked


def _klt(
    previous: Grey8, current: Grey8, start: npt.NDArray[np.float32]
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint8]]:
    end, status, _ = cv2.calcOpticalFlowPyrLK(
        previous, current, start, None, winSize=_WINDOW_PX, maxLevel=_N_LEVELS, criteria=_STOP
    )  # type: ignore[call-overload]
    return end, status


@dataclass(frozen=True, slots=True)
class TrackOptions:
    """When a track goes on.

    Attributes
    ----------
    descriptor_gate : float
        T_F of Eq. (1), between unit vectors.
    position_gate_px : float
        T_x of Eq. (2) [px].
    rejoin_gate : float
        T_F when an ended track is joined with a new point: no position helps there, so it is narrower.
    max_tracks : int
        Tracks at a time.
    max_misses : int
        Pictures in a row without re-detection that a track survives.
    min_life : int
        Shorter tracks are not kept for rejoining.
    """

    descriptor_gate: float = 0.4
    position_gate_px: float = 1.5
    rejoin_gate: float = 0.3
    max_tracks: int = 80
    max_misses: int = 3
    min_life: int = 4


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Tracks that were found again in one picture.

    Attributes
    ----------
    ids : (N,) int64
        Identity of each.
    uv : (N, 2) float64
        Position of the feature [px].
    life : (N,) int64
        In how many pictures it satisfied Eqs. (1) and (2).
    descriptors : (N, D) float32
        As seen now.
    sign : (N,) int8
        Sign of the Laplacian.
    """

    ids: npt.NDArray[np.int64]
    uv: Floats
    life: npt.NDArray[np.int64]
    descriptors: npt.NDArray[np.float32]
    sign: npt.NDArray[np.int8]


@dataclass(slots=True)
class _LandmarkTrack:
    id: int
    uv: Floats
    reference: npt.NDArray[np.float32]  # F at time 0
    sign: int
    life: int = 1
    misses: int = 0


@dataclass(slots=True)
class TrackBook:
    """All tracks of a mapping drive. Call `update` with every picture.

    Parameters
    ----------
    options : TrackOptions
        When a track goes on.
    """

    options: TrackOptions = field(default_factory=TrackOptions)
    _tracks: list[_LandmarkTrack] = field(default_factory=list)
    _ended: list[_LandmarkTrack] = field(default_factory=list)
    _previous: Grey8 | None = None
    _n_ids: int = 0
    n_rejoined: int = 0

    def update(self, image: Grey8, features: Features) -> Observations:
        """Carry all tracks into the picture and return those that were found again."""
        self._carry(image)
        pairs = self._confirm(features)
        pairs += self._begin(features, {feature for _, feature in pairs})
        self._previous = image
        chosen = np.array([feature for _, feature in pairs], dtype=np.intp)
        return Observations(
            np.array([track.id for track, _ in pairs], dtype=np.int64),
            features.uv[chosen],
            np.array([track.life for track, _ in pairs], dtype=np.int64),
            features.descriptors[chosen],
            features.sign[chosen],
        )

    def _carry(self, image: Grey8) -> None:
        if self._previous is None or self._previous.shape != image.shape:
            return
        uv = np.array([track.uv for track in self._tracks]).reshape(-1, 2)
        moved, is_tracked = track_points(self._previous, image, uv)
        kept: list[_LandmarkTrack] = []
        for track, position, found in zip(self._tracks, moved, is_tracked):
            if found:
                track.uv = position
                kept.append(track)
            else:
                self._end(track)
        self._tracks = kept

    def _confirm(self, features: Features) -> list[tuple[_LandmarkTrack, int]]:
        """Pair tracks with features that agree in place and descriptor; end those missed too often."""
        pairs: list[tuple[_LandmarkTrack, int]] = []
        kept: list[_LandmarkTrack] = []
        cost = self._costs(features)
        taken: set[int] = set()
        for k, track in enumerate(self._tracks):
            feature = int(cost[k].argmin()) if len(features) else -1
            if feature >= 0 and np.isfinite(cost[k, feature]) and feature not in taken:
                taken.add(feature)
                track.life, track.misses = track.life + 1, 0
                # Differs from the paper: tracking goes on from the feature, so that its drift does not add up.
                track.uv = features.uv[feature]
                pairs.append((track, feature))
            else:
                track.misses += 1
            if track.misses > self.options.max_misses:
                self._end(track)
            else:
                kept.append(track)
        self._tracks = kept
        return pairs

    def _costs(self, features: Features) -> npt.NDArray[np.float64]:
        """Return descriptor distances squared, (tracks, features); infinite where Eq. (1) or (2) is broken."""
        if not self._tracks or not len(features):
            return np.full((len(self._tracks), len(features)), np.inf)
        reference = np.array([track.reference for track in self._tracks])
        sign = np.array([track.sign for track in self._tracks], dtype=np.int8)
        squared = squared_distances(reference, sign, features.descriptors, features.sign)
        uv = np.array([track.uv for track in self._tracks])
        apart = np.linalg.norm(uv[:, None] - features.uv[None], axis=2)
        squared[(apart >= self.options.position_gate_px) | (squared >= self.options.descriptor_gate**2)] = np.inf
        return squared

    def _begin(self, features: Features, taken: set[int]) -> list[tuple[_LandmarkTrack, int]]:
        """Begin tracks at free features, the strongest first; join them with ended ones where they look alike."""
        occupied = np.array([track.uv for track in self._tracks]).reshape(-1, 2)
        is_free = np.ones(len(features), dtype=bool)
        is_free[list(taken)] = False
        if len(occupied):
            apart = np.linalg.norm(features.uv[:, None] - occupied[None], axis=2)
            is_free &= (apart >= _MIN_APART_PX).all(axis=1)
        free = np.flatnonzero(is_free)[: max(0, self.options.max_tracks - len(self._tracks))].tolist()
        joined = self._rejoin(features, np.array(free, dtype=np.intp))
        pairs: list[tuple[_LandmarkTrack, int]] = []
        for k in free:
            track = joined.get(k)
            if track is None:
                track = _LandmarkTrack(
                    self._n_ids, features.uv[k], features.descriptors[k].copy(), int(features.sign[k])
                )
                self._n_ids += 1
            pairs.append((track, k))
        self._tracks += [track for track, _ in pairs]
        return pairs

    def _rejoin(self, features: Features, free: npt.NDArray[np.intp]) -> dict[int, _LandmarkTrack]:
        if not self._ended or not len(free):
            return {}
        reference = np.array([track.reference for track in self._ended])
        sign = np.array([track.sign for track in self._ended], dtype=np.int8)
        i, j, _ = match(features.descriptors[free], features.sign[free], reference, sign, self.options.rejoin_gate, 0.7)
        joined: dict[int, _LandmarkTrack] = {}
        for feature, ended in zip(free[i], j):
            track = self._ended[int(ended)]
            track.uv, track.misses, track.life = features.uv[int(feature)], 0, track.life + 1
            joined[int(feature)] = track
        self.n_rejoined += len(joined)
        back = {track.id for track in joined.values()}
        self._ended = [track for track in self._ended if track.id not in back]
        return joined

    def _end(self, track: _LandmarkTrack) -> None:
        if track.life >= self.options.min_life:
            self._ended = [*self._ended[-(_N_ENDED - 1) :], track]
