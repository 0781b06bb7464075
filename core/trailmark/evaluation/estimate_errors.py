"""The error of every single estimate against the truth, in the three numbers that it states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats
from trailmark.evaluation.association import poses_at, usual_interval_s
from trailmark.evaluation.estimates_table import EstimateTable
from trailmark.evaluation.map_frame import ONE_FRAME, MapFrame
from trailmark.evaluation.relative import between
from trailmark.geometry import Pose2, Trajectory, wrap_angles
from trailmark.paths import Path

__all__ = ["EstimateErrors", "estimate_errors", "true_poses"]

_TRUTH_INTERVALS = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class EstimateErrors:
    """What was stated, minus what was true; NaN where the truth is not known.

    Attributes
    ----------
    estimates : EstimateTable
        The N that were judged: all that stated something, `Lost` and refused ones left out.
    errors : (N, 3) float64
        Of x, y, theta, or of station, lateral, heading [m, m, rad].
    information : (N, 3, 3) float64
        As stated; of fixes with the uncertainty of the map's frame on top.
    """

    estimates: EstimateTable
    errors: Floats
    information: Floats


def true_poses(truth: Trajectory, stamps_s: Floats) -> Floats:
    """Return true poses (N, 3) at stamps in any order, NaN where there is none near enough."""
    return poses_at(truth, stamps_s, _TRUTH_INTERVALS * usual_interval_s(truth.stamps_s))


def estimate_errors(
    estimates: EstimateTable, truth: Trajectory, map_frame: MapFrame = ONE_FRAME, path: Path | None = None
) -> EstimateErrors:
    """Return the errors of one localizer's estimates, each kind in its own coordinates, in the order of the table.

    Parameters
    ----------
    estimates : EstimateTable
        Its rows.
    truth : Trajectory
        Where base was, in its own frame.
    map_frame : MapFrame
        How the map lies in that frame.
    path : Path, optional
        The taught path, in the map; without it the errors of path offsets are not known.
    """
    told = estimates.where((estimates.outcome != "refused") & (estimates.kind != "lost"))
    errors, information = np.full(told.numbers.shape, np.nan), told.information.copy()
    is_motion, is_fix, is_offset = (told.kind == kind for kind in ("motion", "fix", "pathoffset"))
    since, now = (true_poses(truth, stamps[is_motion]) for stamps in (told.since_s, told.stamp_s))
    errors[is_motion] = told.numbers[is_motion] - between(since, now)
    in_map = map_frame.in_map(true_poses(truth, told.stamp_s))
    errors[is_fix] = told.numbers[is_fix] - in_map[is_fix]
    information[is_fix] = map_frame.weaken(information[is_fix], told.numbers[is_fix, :2])
    if path is not None and len(path):
        errors[is_offset] = told.numbers[is_offset] - _on_path(path, in_map[is_offset], told.numbers[is_offset, 0])
    errors[:, 2] = wrap_angles(errors[:, 2])
    return EstimateErrors(told, errors, information)


def _on_path(path: Path, poses_map: Floats, near_m: Floats) -> Floats:
    """Return (station, lateral, heading) of poses, each looked for near the station that was stated, (N, 3)."""
    offsets = np.full(poses_map.shape, np.nan)
    for row in np.flatnonzero(np.isfinite(poses_map).all(axis=1) & np.isfinite(near_m)):
        found = path.locate(Pose2.from_array(poses_map[row]), near_station_m=float(near_m[row]))
        offsets[row] = found.station_m, found.lateral_m, found.heading_rad
    return offsets
