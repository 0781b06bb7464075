"""The landmarks that are remembered: where they stand, how they look, and whether they have been moved."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats, Indices
from trailmark.errors import StoreError
from trailmark.geometry import wrap_angles
from trailmark_kinect_landmarks.landmarks import SeenLandmarks
from trailmark_kinect_landmarks.systematic import TravelledWay

__all__ = ["Anchor", "LandmarkMemory", "MemoryLimits"]

_MEMORY = 25  # sightings that count
_TRIAL_PICTURES = 30
_RARELY = 64  # so many failed trials are gathered before rows are moved together
_STORED = ("points", "cov", "anchor_cov", "anchor", "kind", "size_m", "histogram", "vicinity", "n_seen")
_STORED_LATER = ("anchor",)  # maps of earlier versions are without


@dataclass(frozen=True, slots=True)
class MemoryLimits:
    """When a landmark is trusted.

    Attributes
    ----------
    trial : int
        Sightings in agreement with the others before it may vote on the pose; one each `LEARNS_EVERY_S` at most.
    moved_after : int
        Sightings in a row against the others after which it is set aside as moved; likewise.
    most : int
        Landmarks that are remembered at the same time, those of a taught place not counted.
    """

    trial: int = 3
    moved_after: int = 5
    most: int = 2000


@dataclass(frozen=True, slots=True, eq=False)
class Anchor:
    """The pose from which landmarks are remembered.

    Attributes
    ----------
    T_map_base : (4, 4) float64
        The pose.
    covariance : (3, 3) float64
        Of its x, y and heading [m, m, rad].
    drift : TravelledWay
        What systematic errors had grown on until there.
    """

    T_map_base: Floats
    covariance: Floats
    drift: TravelledWay = TravelledWay()

    def numbers(self) -> Floats:
        """Return x, y, heading, way and turn, (5,)."""
        T = self.T_map_base
        heading_rad = math.atan2(T[1, 0], T[0, 0])
        return np.array([T[0, 3], T[1, 3], heading_rad, self.drift.way_m, self.drift.turn_rad])


def _rows(*shape: int) -> Any:
    return field(default_factory=lambda: np.empty((0, *shape)))


@dataclass(slots=True, eq=False)
class LandmarkMemory:
    """All landmarks, a row each; a row's number is the landmark's identity until `forget` says otherwise.

    Attributes
    ----------
    points : (N, 3) float64
        In map axes [m].
    cov : (N, 3, 3) float64
        Of the point, as measured from the pose at which it was remembered, in map axes [m^2].
    anchor_cov : (N, 3, 3) float64
        Of that pose's (x, y, heading): shared by all that was remembered there.
    anchor : (N, 5) float64
        That pose's x, y and heading, and the way and turn on which systematic errors had grown until there; NaN in
        maps that were taught before this was kept [m, m, rad, m, rad].
    kind, size_m, histogram, vicinity
        As in `SeenLandmarks`.
    n_seen : (N,) int
        Sightings in agreement.
    n_against : (N,) int
        Sightings in a row against the others.
    is_moved : (N,) bool
        Set aside.
    last_seen : (N,) int
        Number of the picture of the last sighting in agreement.
    is_taught : (N,) bool
        From a store: never forgotten.
    """

    limits: MemoryLimits = field(default_factory=MemoryLimits)
    points: Floats = _rows(3)
    cov: Floats = _rows(3, 3)
    anchor_cov: Floats = _rows(3, 3)
    anchor: Floats = _rows(5)
    kind: npt.NDArray[np.int8] = field(default_factory=lambda: np.empty(0, np.int8))
    size_m: Floats = _rows()
    histogram: npt.NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 0), np.float32))
    vicinity: npt.NDArray[np.float32] = field(default_factory=lambda: np.empty((0, 0), np.float32))
    n_seen: npt.NDArray[np.intp] = field(default_factory=lambda: np.empty(0, np.intp))
    n_against: npt.NDArray[np.intp] = field(default_factory=lambda: np.empty(0, np.intp))
    is_moved: npt.NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, np.bool_))
    last_seen: npt.NDArray[np.intp] = field(default_factory=lambda: np.empty(0, np.intp))
    is_taught: npt.NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, np.bool_))
    _picture: int = 0

    def __len__(self) -> int:
        return len(self.points)

    def votes(self, rows: Indices) -> npt.NDArray[np.bool_]:
        """Return which landmarks may vote on the pose: on trial no longer, and not moved."""
        return np.asarray((self.n_seen[rows] >= self.limits.trial) & ~self.is_moved[rows])

    def add(self, seen: SeenLandmarks, anchor: Anchor, is_trusted: bool) -> Indices:
        """Remember what is seen from a pose; returns the new rows. `is_trusted` spares them the trial."""
        n, first = len(seen), len(self)
        R_map_base, t_map_base = anchor.T_map_base[:3, :3], anchor.T_map_base[:3, 3]
        points = seen.points_base @ R_map_base.T + t_map_base
        self._append(
            {
                "points": points,
                "cov": R_map_base @ seen.cov_base @ R_map_base.T,
                "anchor_cov": np.tile(anchor.covariance, (n, 1, 1)),
                "anchor": np.tile(anchor.numbers(), (n, 1)),
                "kind": seen.kind,
                "size_m": seen.size_m,
                "histogram": seen.histogram,
                "vicinity": seen.vicinity,
                "n_seen": np.full(n, self.limits.trial if is_trusted else 1, np.intp),
            }
        )
        return np.arange(first, first + n)

    def drift(self, rows: Indices, T_map_base: Floats, depth_m: float) -> TravelledWay:
        """Return what systematic errors have grown on, for a pose that is taken from some landmarks.

        To the way at which each was remembered comes the way from there: who returns to where it began has drifted no
        farther than there.
        """
        anchors = self.anchor[rows]
        anchors = anchors[np.isfinite(anchors).all(axis=1)]
        if not len(anchors):
            return TravelledWay(depth_m=depth_m)
        way_m = anchors[:, 3] + np.hypot(T_map_base[0, 3] - anchors[:, 0], T_map_base[1, 3] - anchors[:, 1])
        heading_rad = math.atan2(T_map_base[1, 0], T_map_base[0, 0])
        turn_rad = anchors[:, 4] + np.abs(wrap_angles(heading_rad - anchors[:, 2]))
        return TravelledWay(float(way_m.mean()), float(turn_rad.mean()), depth_m)

    def clear(self) -> None:
        """Forget all."""
        for name in (*_STORED, "n_against", "is_moved", "last_seen", "is_taught"):
            setattr(self, name, getattr(self, name)[:0])

    def agree(self, rows: Indices, points_map: Floats, cov_map: Floats) -> None:
        """Take sightings that agree with the pose: refine the points, end trials, forgive.

        A Kalman update each, with a fading memory: never more certain than `_MEMORY` sightings.
        """
        prior = self.cov[rows] * (1.0 + 1.0 / _MEMORY)
        gain = prior @ np.linalg.inv(prior + cov_map)
        self.points[rows] += np.einsum("nij,nj->ni", gain, points_map - self.points[rows])
        posterior = prior - gain @ prior
        self.cov[rows] = (posterior + posterior.transpose(0, 2, 1)) / 2.0
        self.n_seen[rows] += 1
        self.n_against[rows] = 0
        self.last_seen[rows] = self._picture

    def disagree(self, rows: Indices) -> None:
        """Take sightings against the pose, Eqs. (1)-(2): what keeps moving against the others is set aside."""
        self.n_against[rows] += 1
        self.is_moved[rows] |= self.n_against[rows] >= self.limits.moved_after

    def forget(self, in_sight: Indices) -> Indices | None:
        """Begin a new picture, and remove landmarks of too little use.

        A trial ends where it was not passed within `_TRIAL_PICTURES`. Beyond `MemoryLimits.most` go first the landmarks
        that moved, then those on trial, then those seen least often (more than `_MEMORY` times counts no more), of
        these the ones not seen for longest. A tenth more than needed goes, so that this is rare.

        Parameters
        ----------
        in_sight : (K,) int
            Rows that stay.

        Returns
        -------
        (N,) int or None
            New number of each row, -1 for the forgotten; None when all stay.
        """
        self._picture += 1
        stays = self.is_taught.copy()
        stays[in_sight] = True
        on_trial = (self.n_seen < self.limits.trial) & ~stays
        gone = on_trial & (self._picture - self.last_seen > _TRIAL_PICTURES)
        n_own = int((~self.is_taught).sum())
        n_too_many = n_own - int(gone.sum()) - self.limits.most
        if n_too_many > 0:
            worth = np.lexsort(
                (self.last_seen, np.minimum(self.n_seen, _MEMORY), ~on_trial, ~self.is_moved)
            )  # least first
            worth = worth[~(stays | gone)[worth]]
            gone[worth[: n_too_many + self.limits.most // 10]] = True
        elif gone.sum() < _RARELY and n_own <= self.limits.most:
            return None
        kept = np.flatnonzero(~gone)
        for name in (*_STORED, "n_against", "is_moved", "last_seen", "is_taught"):
            setattr(self, name, getattr(self, name)[kept])
        numbers = np.full(len(gone), -1, np.intp)
        numbers[kept] = np.arange(len(kept))
        return numbers

    def arrays(self, rows: Indices | None = None) -> dict[str, npt.NDArray[Any]]:
        """Return the arrays of some landmarks, or of all, that a store keeps."""
        which = slice(None) if rows is None else rows
        return {name: np.asarray(getattr(self, name)[which]) for name in _STORED}

    def load(self, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        """Add landmarks from a store.

        Raises
        ------
        StoreError
            If arrays are missing or do not belong together.
        """
        missing = [name for name in _STORED if name not in arrays and name not in _STORED_LATER]
        found = {name: np.asarray(arrays[name]) for name in _STORED if name in arrays}
        if missing or len({len(array) for array in found.values()}) != 1:
            what = f"lack {', '.join(missing)}" if missing else "differ in length"
            raise StoreError(f"the landmarks in the store {what}: teach the place again")
        found.setdefault("anchor", np.full((len(found["points"]), 5), np.nan))
        self._append(found)
        self.is_taught[len(self) - len(arrays["points"]) :] = True

    def _append(self, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
        n, is_empty = len(arrays["points"]), len(self) == 0
        for name in _STORED:
            known, new = getattr(self, name), arrays[name]
            setattr(self, name, np.array(new) if is_empty else np.concatenate([known, new]))
        self.n_against = np.concatenate([self.n_against, np.zeros(n, np.intp)])
        self.is_moved = np.concatenate([self.is_moved, np.zeros(n, np.bool_)])
        self.last_seen = np.concatenate([self.last_seen, np.full(n, self._picture, np.intp)])
        self.is_taught = np.concatenate([self.is_taught, np.zeros(n, np.bool_)])
