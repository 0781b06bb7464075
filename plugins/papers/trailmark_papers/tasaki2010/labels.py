"""Labels of landmark candidates: true places are where their bearings, from the true poses, meet the walls."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from trailmark.arrays import Bools, Floats
from trailmark.geometry import Pose2
from trailmark.paths import Keyframe
from trailmark_omni_surf.landmark_map import Candidates
from trailmark_omni_surf.laser.scan_map import ScanMap

__all__ = ["first_hit", "labelled_candidates"]

_STEP_M, _REACH_M = 0.03, 15.0
_HIT_M = 0.07  # map points lie 0.1 m apart


def labelled_candidates(
    keyframes: Sequence[Keyframe],
    truth: Mapping[float, Pose2],
    walls: ScanMap,
    candidates: Candidates,
    label_distance_m: float = 0.6,
) -> tuple[Floats, Bools]:
    """Return the six features and the label of every candidate whose true place is known.

    The true place is the middle (median) of where the rays of its sightings first meet a wall of the laser's map: a
    person would measure it so. What hangs from the ceiling or lies on the floor gets the place behind it, and counts as
    bad when that is farther than T_d from what was measured.

    Parameters
    ----------
    keyframes : sequence of Keyframe
        Of the camera.
    truth : mapping
        True pose of base by the stamp of the keyframe.
    walls : ScanMap
        Made of scans at true poses.
    candidates : Candidates
        What was measured of the keyframes.
    label_distance_m : float
        T_d [m].
    """
    hits: dict[int, list[Floats]] = {int(track_id): [] for track_id in candidates.ids}
    for keyframe in keyframes:
        camera = truth[keyframe.stamp_s] @ Pose2.from_array(keyframe.arrays["pose_base_camera"])
        for track_id, bearing in zip(keyframe.arrays["ids"].tolist(), keyframe.arrays["bearings"].tolist()):
            if track_id in hits:
                hit = first_hit(walls, camera, bearing)
                if hit is not None:
                    hits[track_id].append(hit)
    is_known = np.array([len(hits[int(track_id)]) >= 3 for track_id in candidates.ids])
    true = np.array([np.median(hits[int(track_id)], axis=0) for track_id in candidates.ids[is_known]]).reshape(-1, 2)
    missed_m = np.hypot(*(candidates.positions[is_known] - true).T)
    return candidates.features[is_known], missed_m < label_distance_m


def first_hit(walls: ScanMap, camera: Pose2, bearing_rad: float) -> Floats | None:
    """Return where a ray first comes to a wall, (2,) [m], or None."""
    direction = np.array([np.cos(camera.theta + bearing_rad), np.sin(camera.theta + bearing_rad)])
    points = (camera.x, camera.y) + np.arange(0.2, _REACH_M, _STEP_M)[:, None] * direction
    cells = np.floor((points - walls.origin) / walls.cell_m).astype(int)
    height, width = walls.distance_m.shape
    inside = (cells >= 0).all(axis=1) & (cells[:, 0] < width) & (cells[:, 1] < height)
    cells, points = cells[inside], points[inside]
    near = np.flatnonzero(walls.distance_m[cells[:, 1], cells[:, 0]] < _HIT_M)
    return np.asarray(points[near[0]]) if len(near) else None
