"""Where the taught places really were, if a source knows it: kept in the path store, so that replays can be judged."""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import Trajectory
from trailmark.interfaces import PathStore
from trailmark.paths import TaughtPlaces

__all__ = ["TRUE_PLACES", "keep_true_places", "read_true_places"]

#: Under this owner a path store keeps the true poses; no localizer is called so.
TRUE_PLACES = "(truth)"
_NAME, _STATIONS, _POSES = "places", "station_m", "poses"
_SAME_STATION_M = 1e-6


def keep_true_places(store: PathStore, stamps: dict[float, float], truth: Trajectory) -> None:
    """Keep where base was when waypoints were laid.

    Parameters
    ----------
    store : PathStore
        Open for writing; what it has of an earlier part of the path stays.
    stamps : dict of float to float
        Stamps of the waypoints, by their stations [s].
    truth : Trajectory
        Where base really was.
    """
    from trailmark.evaluation.estimate_errors import true_poses  # a run that teaches nothing judges nothing

    stations = np.array(list(stamps))
    poses = true_poses(truth, np.array(list(stamps.values())))
    known = np.isfinite(poses).all(axis=1)
    if not known.any():
        return
    kept = store.localizer_map(TRUE_PLACES)
    before = kept.load(_NAME)
    stations, poses = stations[known], poses[known]
    if before is not None:
        stations = np.concatenate([np.asarray(before[_STATIONS]), stations])
        poses = np.concatenate([np.asarray(before[_POSES]), poses])
    kept.save(_NAME, {_STATIONS: stations, _POSES: poses})
    store.mark_finished(TRUE_PLACES)
    store.commit()


def read_true_places(store: PathStore) -> TaughtPlaces | None:
    """Return the waypoints of a path whose true poses are known, as they lie in the map now; None if there are none."""
    path = store.path()
    kept = store.localizer_map(TRUE_PLACES).load(_NAME) if TRUE_PLACES in store.owners() else None
    if path is None or kept is None:
        return None
    stations: Floats = np.array([waypoint.station_m for waypoint in path.waypoints])
    there = np.asarray(kept[_STATIONS], dtype=np.float64)
    index = np.clip(np.searchsorted(stations, there - _SAME_STATION_M), 0, len(stations) - 1)
    known = np.abs(stations[index] - there) <= _SAME_STATION_M
    poses = np.array([waypoint.pose_map_base.array() for waypoint in path.waypoints]).reshape(-1, 3)
    return TaughtPlaces(poses[index[known]], np.asarray(kept[_POSES], dtype=np.float64)[known])
