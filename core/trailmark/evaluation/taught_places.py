"""``taught_truth.csv`` in the folder of a replay: where the places of the taught path really were.

A map that was taught by odometry is bent: a place that it has at (10.0, 0.0) may really be at (10.2, 0.4). A localizer
that says where base is in this map is judged in this map: a true pose is carried into it at the place of the taught
path that is nearest, by what teaching believed there and what was true.
"""

from __future__ import annotations

import csv
import pathlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import DataError
from trailmark.evaluation.estimate_errors import true_poses
from trailmark.evaluation.estimates_table import EstimateTable
from trailmark.evaluation.map_frame import MapFrame
from trailmark.evaluation.number_rows import read_number_rows
from trailmark.evaluation.relative import between
from trailmark.geometry import Trajectory, wrap_angles
from trailmark.paths import OnPath, Path, TaughtPlaces

__all__ = [
    "TRUTH_FILE",
    "BentMapFrame",
    "bent_map_frame",
    "read_taught_places",
    "said_places",
    "with_unknown_error",
    "write_taught_places",
]

TRUTH_FILE = "taught_truth.csv"
_COLUMNS = ("x", "y", "theta", "true_x", "true_y", "true_theta")
# A turn of 1 rad counts as 1 m: where a path crosses itself, or comes back, the heading says which place is meant.
_M_PER_RAD = 1.0
# Places that are further than the nearest by less than this may be meant as well [m].
_AMBIGUOUS_M = 0.3
# Places farther apart are no neighbours [m].
_MOST_APART_M = 0.5
# What is said of places may be off by this, and nobody asks whether the map is bent [m].
_OFF_M = 0.05
# A map that is nowhere further off the truth is not called bent, but places are compared in it all the same [m].
_BENT_M = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class BentMapFrame(MapFrame):
    """A taught map in the frame of the truth: another rigid motion at every place of the path.

    Attributes
    ----------
    places : TaughtPlaces
        Where both are known.
    """

    places: TaughtPlaces = TaughtPlaces(np.zeros((0, 3)), np.zeros((0, 3)))

    def in_map(self, poses_truth: Floats) -> Floats:
        """Return true poses (N, 3) as seen from the map; NaN where that is not known.

        Where the path comes by twice, it is followed from one pose to the next.
        """
        from scipy.spatial import KDTree  # here: importing the metrics stays cheap

        found = np.full(poses_truth.shape, np.nan)
        rows = np.flatnonzero(np.isfinite(poses_truth).all(axis=1))
        if not len(rows):
            return found
        poses, tree = poses_truth[rows], KDTree(self.places.in_truth[:, :2])
        # A place that is nearer or about as near with its heading is within this distance.
        reach_m = self._away_m(poses, np.asarray(tree.query(poses[:, :2])[1])) + _AMBIGUOUS_M + 1e-9
        near = tree.query_ball_point(poses[:, :2], reach_m, return_sorted=True)
        found[rows] = self._carry(poses, self._followed(poses, near.tolist()))
        return found

    def _followed(self, poses: Floats, near: Sequence[Sequence[int]]) -> npt.NDArray[np.intp]:
        """Return the nearest of the places near each pose (N, 3), on the pass of the path that goes on."""
        counts = np.array([len(one) for one in near])
        row, places = np.repeat(np.arange(len(poses)), counts), np.fromiter(chain.from_iterable(near), np.intp)
        away_m = self._away_m(poses[row], places)
        least_m = np.minimum.reduceat(away_m, np.cumsum(counts) - counts)[row]
        kept = away_m <= least_m + _AMBIGUOUS_M
        row, places, away_m, least_m = row[kept], places[kept], away_m[kept], least_m[kept]
        nearest = np.flatnonzero(away_m == least_m)
        followed = places[nearest[np.unique(row[nearest], return_index=True)[1]]]
        edges = np.searchsorted(row, np.arange(len(poses) + 1))
        comes_by_twice = (np.diff(places) > 1) & (np.diff(row) == 0)
        for n in np.unique(row[1:][comes_by_twice]).tolist():
            meant = slice(edges[n], edges[n + 1])
            followed[n] = _nearest_from(int(followed[n - 1]) if n else 0, places[meant], away_m[meant])
        return followed

    def _away_m(self, poses: Floats, places: npt.NDArray[np.intp]) -> Floats:
        """Return how far poses (N, 3) are from one place each (N,), turns included [m]."""
        apart = self.places.in_truth[places] - poses
        return np.asarray(np.hypot(apart[:, 0], apart[:, 1]) + _M_PER_RAD * np.abs(wrap_angles(apart[:, 2])))

    def _carry(self, poses: Floats, places: npt.NDArray[np.intp]) -> Floats:
        """Return poses as seen from the map, by the rigid motion between a place and its neighbour there."""
        there, taught = self.places.in_truth, self.places.in_map
        others, shares = self._neighbours(poses, places)
        seen = between(_interpolate(there[places], there[others], shares), poses)
        begin = _interpolate(taught[places], taught[others], shares)
        cos, sin = np.cos(begin[:, 2]), np.sin(begin[:, 2])
        x = begin[:, 0] + cos * seen[:, 0] - sin * seen[:, 1]
        y = begin[:, 1] + sin * seen[:, 0] + cos * seen[:, 1]
        return np.column_stack([x, y, wrap_angles(begin[:, 2] + seen[:, 2])])

    def _neighbours(self, poses: Floats, places: npt.NDArray[np.intp]) -> tuple[npt.NDArray[np.intp], Floats]:
        """Return the neighbour of each place on a pose's side, (N,), and how far towards it that is, 0 to 1."""
        there = self.places.in_truth[:, :2]
        sides = [np.minimum(places + 1, len(there) - 1), np.maximum(places - 1, 0)]
        shares = []
        for others in sides:
            way = there[others] - there[places]
            squared = np.sum(way * way, axis=1)
            along = np.sum((poses[:, :2] - there[places]) * way, axis=1) / np.where(squared > 0.0, squared, 1.0)
            # nobody knows how the map is bent on a long way between places
            shares.append(np.where(squared < _MOST_APART_M**2, np.clip(along, 0.0, 1.0), 0.0))
        is_next = shares[0] >= shares[1]
        return np.where(is_next, *sides), np.where(is_next, *shares)


def _interpolate(poses: Floats, others: Floats, shares: Floats) -> Floats:
    """Return poses (N, 3) on the way to others, by the share of it."""
    way = others - poses
    way[:, 2] = wrap_angles(way[:, 2])
    return np.asarray(poses + shares[:, None] * way)


def _nearest_from(place: int, near: npt.NDArray[np.intp], away_m: Floats) -> int:
    """Return the nearest of some places; of several passes of the path, that of the pass that goes on from a place."""
    begins = np.flatnonzero(np.diff(near) > 1) + 1
    passes = zip(np.split(near, begins), np.split(away_m, begins), strict=True)
    goes_on, away_m = min(passes, key=lambda one: int(np.abs(one[0] - place).min()))
    return int(goes_on[away_m.argmin()])


def bent_map_frame(places: TaughtPlaces, plain: MapFrame, said: Floats, truth: Floats) -> MapFrame:
    """Return the frame of a taught map, or the plain one if what was said of places fits that better.

    That happens where the truths of teaching and replay are themselves in different frames.

    Parameters
    ----------
    places : TaughtPlaces
        Of the taught path.
    plain : MapFrame
        How the map lies in the frame of the truth if nothing is known of the teaching.
    said, truth : (N, 3) float64
        What was said of places in the map, and where base really was.
    """
    off_m = places.off_m()
    if not len(off_m):
        return plain
    note = (
        f"the taught map is {np.median(off_m):.2g} m off the ground truth, at most {off_m.max():.2g} m: places are"
        " compared in the map, as it was taught there; distances from the ground truth have its error too"
    )
    bent = BentMapFrame(note=note if off_m.max() > _BENT_M else "", places=places)
    if len(said) and _median_m(said, bent.in_map(truth)) > _median_m(said, plain.in_map(truth)):
        return plain
    return bent


def said_places(estimates: EstimateTable, truth: Trajectory, path: Path | None) -> tuple[Floats, Floats]:
    """Return where fixes and path offsets say that base is in the map, and the true poses then, (N, 3) each.

    Parameters
    ----------
    estimates : EstimateTable
        Of any localizers.
    truth : Trajectory
        Where base really was.
    path : Path or None
        The taught path; without it path offsets say no place.
    """
    told = estimates.where(np.isin(estimates.kind, ("fix", "pathoffset")) & (estimates.outcome != "refused"))
    said = told.numbers.copy()
    is_offset = told.kind == "pathoffset"
    if path is None or not len(path):
        said[is_offset] = np.nan
    else:
        for row in np.flatnonzero(is_offset & np.isfinite(said).all(axis=1)):
            said[row] = path.pose_from(OnPath(*said[row].tolist())).array()
    there = true_poses(truth, told.stamp_s)
    known = np.isfinite(there).all(axis=1) & np.isfinite(said).all(axis=1)
    return said[known], there[known]


def with_unknown_error(frame: MapFrame, said: Floats, truth: Floats) -> MapFrame:
    """Return the frame of a taught map of which nobody knows how it was taught: that it may be bent is said.

    Parameters
    ----------
    frame : MapFrame
        How the map lies in the frame of the truth.
    said, truth : (N, 3) float64
        What was said of places in the map, and where base really was.
    """
    if frame.note or not len(said) or _median_m(said, frame.in_map(truth)) <= _OFF_M:
        return frame
    return replace(
        frame,
        note=(
            "the path was taught where no ground truth was kept, so nobody knows how far the map is off it: errors and"
            " NEES of places count the map's error as the localizer's; teach it again to have them told apart"
        ),
    )


def _median_m(said: Floats, truth: Floats) -> float:
    away_m = np.linalg.norm(said[:, :2] - truth[:, :2], axis=1)
    return float(np.nanmedian(away_m)) if np.isfinite(away_m).any() else np.inf


def write_taught_places(places: TaughtPlaces, file: pathlib.Path) -> None:
    """Write places, one a line.

    Raises
    ------
    DataError
        If the file cannot be written.
    """
    rows = np.hstack([places.in_map, places.in_truth]).tolist()
    try:
        with open(file, "w", encoding="utf-8", newline="") as target:
            csv.writer(target).writerows([_COLUMNS, *rows])
    except OSError as error:
        raise DataError(f"cannot write {file}: {error.strerror or error}") from error


def read_taught_places(file: pathlib.Path) -> TaughtPlaces:
    """Read what `write_taught_places` wrote.

    Raises
    ------
    DataError
        If it cannot be read or is no such table.
    """
    rows = np.array(read_number_rows(file, _COLUMNS, "a table of taught places"), dtype=np.float64).reshape(-1, 6)
    return TaughtPlaces(rows[:, :3], rows[:, 3:])
