"""What a playback did: from its run folder, the teaching's, and what was registered."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trailmark import paths
from trailmark.arrays import Bools, Floats, Int64s
from trailmark.evaluation import read_run
from trailmark.evaluation.lateral import offsets_from_path
from trailmark.geometry import Pose2, Trajectory
from trailmark.paths import Keyframe, Waypoint
from trailmark_papers.kit import collisions_of, keyframes_of
from trailmark_papers.nagai2015.runs import PIXEL_M

__all__ = ["Playback", "Searches", "read_playback", "relative"]

#: A stamp is written with so many digits that this is nothing [s].
_STAMP_S = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Searches:
    """The absolute searches of a run in order, N each.

    Attributes
    ----------
    stamps_s, arrived_s : (N,) float64
        Of the picture that was searched, and when the answer was applied [s].
    places : (N,) int64
        The registration that was searched for.
    is_found : (N,) bool
        False: rejected.
    detected_m : (N,) float64
        How far from where it was expected it was found, Fig. 13; NaN when rejected [m].
    poses : (N, 3) float64
        Where it says that the vehicle is, in the map of the taught path; NaN when rejected [m, m, rad].
    """

    stamps_s: Floats
    arrived_s: Floats
    places: Int64s
    is_found: Bools
    detected_m: Floats
    poses: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Playback:
    """A playback beside the truth.

    Attributes
    ----------
    status, reason : str
        How it ended.
    registrations : sequence of Keyframe
        What was registered while teaching.
    searches : Searches
        Of the playback.
    travelled_m : (N,) float64
        True way driven until each search [m].
    directions : (N,) int64
        1: along the taught sense, -1: against it.
    fix_errors, corrected_errors : (N, 3) float64
        What is wrong with the pose that a search gives, and with the vehicle's belief just after it was applied,
        however late: x and y relative to where the patch was truly registered, and heading. Errors of teaching remain
        in both, as the paper says. NaN when rejected [m, m, rad].
    offsets : (M, 3) float64
        Station, offset to the side and from the heading of the taught way at every picture: of the true vehicle from
        where it truly was taught [m, m, rad].
    taught, fused, relative_only : Trajectory
        As estimated while teaching; in playback with corrections, and without.
    end_miss_m : float
        True distance from where it ended to the end of the path at which it should be [m].
    n_touched : int
        How often it touched something.
    """

    status: str
    reason: str
    registrations: Sequence[Keyframe]
    searches: Searches
    travelled_m: Floats
    directions: Int64s
    fix_errors: Floats
    corrected_errors: Floats
    offsets: Floats
    taught: Trajectory
    fused: Trajectory
    relative_only: Trajectory
    end_miss_m: float
    n_touched: int

    def at_searches(self) -> Floats:
        """Return the rows of `offsets` at the searches, (N, 3): Figs. 12 and 17."""
        frames = np.searchsorted(self.fused.stamps_s, self.searches.stamps_s - _STAMP_S)
        return self.offsets[np.minimum(frames, len(self.offsets) - 1)]

    def detected_m(self) -> Floats:
        """Return the detected errors of the searches that were believed [m]."""
        return self.searches.detected_m[self.searches.is_found]

    def corrected_m(self) -> Floats:
        """Return the true position errors after the corrections [m]."""
        return _lengths(self.corrected_errors)

    def false_m(self) -> Floats:
        """Return the true position errors of what the searches said [m]."""
        return _lengths(self.fix_errors)

    def intervals_m(self) -> Floats:
        """Return the way between one correction and the next, Fig. 18 [m]."""
        return np.diff(self.travelled_m[self.searches.is_found])

    def offsets_m(self, direction: int) -> Floats:
        """Return the offsets to the side, without their signs, at the searches driven forward (1) or back (-1) [m]."""
        return np.asarray(np.abs(self.at_searches()[self.directions == direction, 1]))

    def rejected_percent(self) -> float:
        """Return the share of the searches that were rejected."""
        return 100.0 * float(np.mean(~self.searches.is_found)) if len(self.searches.is_found) else math.nan


def read_playback(taught_folder: Path, folder: Path, store: Path) -> Playback:
    """Read a playback, and compare it with the truth of both runs."""
    teaching, run = read_run(taught_folder), read_run(folder)
    assert teaching.truth is not None
    assert run.truth is not None
    registrations = keyframes_of(store, "floor_map")
    searches = _read_searches(folder)
    stamps = np.array([keyframe.stamp_s for keyframe in registrations])
    believed = np.array([keyframe.pose_map_base.array() for keyframe in registrations])
    true = teaching.truth.at(stamps).poses
    fused = run.trajectories["fused"]
    offsets = offsets_from_path(run.truth, _path(true))
    return Playback(
        status=str(run.run["status"]),
        reason=str(run.run["reason"]),
        registrations=registrations,
        searches=searches,
        travelled_m=np.interp(searches.stamps_s, run.truth.stamps_s, run.truth.travelled_m()),
        directions=_directions(offsets[:, 0], np.searchsorted(run.truth.stamps_s, searches.stamps_s - _STAMP_S)),
        fix_errors=_errors(
            searches.poses, _at(run.truth, searches.stamps_s), believed[searches.places], true[searches.places]
        ),
        corrected_errors=_corrected_errors(searches, fused, run.truth, believed, true),
        offsets=offsets,
        taught=teaching.trajectories["fused"],
        fused=fused,
        relative_only=run.trajectories["floor"],
        end_miss_m=_end_miss_m(run.truth, true),
        n_touched=collisions_of(run.run["counters"]),
    )


def relative(poses: Floats, others: Floats) -> Floats:
    """Return others as seen from poses, (N, 3) each: ``pose.inverse() @ other`` row by row."""
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    dx, dy = (others - poses)[:, :2].T
    turns = (others[:, 2] - poses[:, 2] + math.pi) % (2.0 * math.pi) - math.pi
    return np.stack([cos * dx + sin * dy, cos * dy - sin * dx, turns], axis=1)


def _errors(said: Floats, truth: Floats, believed: Floats, true: Floats) -> Floats:
    """Return how wrong poses are, relative to places that were believed there and truly here, (N, 3)."""
    errors = relative(believed, said) - relative(true, truth)
    errors[:, 2] = (errors[:, 2] + math.pi) % (2.0 * math.pi) - math.pi
    return errors


def _corrected_errors(
    searches: Searches, fused: Trajectory, truth: Trajectory, believed: Floats, true: Floats
) -> Floats:
    """Return what is wrong with the belief at the first picture at which an answer was there."""
    arrived = np.searchsorted(fused.stamps_s, searches.arrived_s - _STAMP_S)
    usable = searches.is_found & (arrived < len(fused))  # the last answer may come after the last picture
    errors = np.full((len(arrived), 3), np.nan)
    places, frames = searches.places[usable], arrived[usable]
    errors[usable] = _errors(fused.poses[frames], _at(truth, fused.stamps_s[frames]), believed[places], true[places])
    return errors


def _read_searches(folder: Path, source: str = "floor_map") -> Searches:
    with (folder / "estimates.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["source"] == source]
    details = [json.loads(row["details"]) for row in rows]
    rows, details = [list(part) for part in zip(*((r, d) for r, d in zip(rows, details) if "place" in d))] or ([], [])
    is_found = np.array([row["kind"] == "fix" and row["status"] == "accepted" for row in rows], dtype=np.bool_)
    shifts = np.array([item.get("shift_px", math.nan) for item in details], dtype=np.float64)
    poses = [[float(row[key] or "nan") for key in ("x", "y", "theta")] for row in rows]
    return Searches(
        np.array([float(row["stamp_s"]) for row in rows]),
        np.array([float(row["arrived_s"]) for row in rows]),
        np.array([int(item["place"]) for item in details], dtype=np.int64),
        is_found,
        np.where(is_found, shifts * PIXEL_M, np.nan),
        np.where(is_found[:, None], np.array(poses).reshape(-1, 3), np.nan),
    )


def _path(poses: Floats) -> paths.Path:
    """Return the path through poses, (N, 3)."""
    stations = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    return paths.Path(Waypoint(i, float(s), Pose2.from_array(row)) for i, (s, row) in enumerate(zip(stations, poses)))


def _at(trajectory: Trajectory, stamps_s: Floats) -> Floats:
    """Return the poses at stamps that may repeat, (N, 3)."""
    unique, places = np.unique(stamps_s, return_inverse=True)
    inside = np.clip(unique, trajectory.stamps_s[0], trajectory.stamps_s[-1])  # digits of the files
    return trajectory.at(inside).poses[places]


def _directions(stations_m: Floats, frames: Int64s) -> Int64s:
    """Return which way it was driving at some frames: 1 towards growing stations, -1 back."""
    span = 5
    after = stations_m[np.minimum(frames + span, len(stations_m) - 1)]
    return np.where(after >= stations_m[np.maximum(frames - span, 0)], 1, -1)


def _end_miss_m(truth: Trajectory, true: Floats) -> float:
    """Return how far from an end of the taught way, the nearer one, it came to stand."""
    return float(np.hypot(*(true[[0, -1], :2] - truth.positions[-1]).T).min())


def _lengths(errors: Floats) -> Floats:
    found = errors[np.isfinite(errors[:, 0])]
    return np.hypot(found[:, 0], found[:, 1])
