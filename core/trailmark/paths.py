"""Taught paths: waypoints along the way, and the keyframes that localizers remember beside it."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple, overload

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import ShapeError
from trailmark.frames.payloads import read_only
from trailmark.geometry import Pose2, wrap_angle, wrap_angles

__all__ = ["Keyframe", "OnPath", "Path", "PathLine", "TaughtPlaces", "Waypoint"]


@dataclass(frozen=True, slots=True, init=False)
class Waypoint:
    """One pose of a taught path.

    Attributes
    ----------
    index : int
        0, 1, 2, ... in the order of teaching.
    station_m : float
        Way driven from the start of the path [m].
    pose_map_base : Pose2
        Base in the map when it was laid.
    """

    index: int
    station_m: float
    pose_map_base: Pose2

    def __init__(self, index: int, station_m: float, pose_map_base: Pose2) -> None:  # many in a path: by hand
        _set_index(self, index)
        _set_station(self, station_m)
        _set_pose(self, pose_map_base)


_set_index, _set_station, _set_pose = (vars(Waypoint)[name].__set__ for name in ("index", "station_m", "pose_map_base"))


@dataclass(frozen=True, slots=True, eq=False)
class Keyframe:
    """What one localizer remembers of one place. It belongs to the localizer, not to a waypoint.

    Attributes
    ----------
    station_m : float
        Way driven from the start of the path [m].
    stamp_s : float
        When it was taken [s].
    pose_map_base : Pose2
        Base in the map, as believed when it was taken.
    arrays : mapping of str to ndarray
        What is remembered; shapes and dtypes are the localizer's own.
    """

    station_m: float
    stamp_s: float
    pose_map_base: Pose2
    arrays: Mapping[str, npt.NDArray[Any]]

    def __post_init__(self) -> None:
        views = {name: read_only(np.asarray(array)) for name, array in self.arrays.items()}
        object.__setattr__(self, "arrays", MappingProxyType(views))


@dataclass(frozen=True, slots=True)
class OnPath:
    """A pose in path coordinates.

    Attributes
    ----------
    station_m : float
        Way along the path [m].
    lateral_m : float
        Offset to the left, seen in the direction of growing station [m].
    heading_rad : float
        Turn from the taught heading, counter-clockwise, in [-pi, pi) [rad].
    """

    station_m: float
    lateral_m: float
    heading_rad: float


class PathLine(NamedTuple):
    """Where a line of a path leads.

    Attributes
    ----------
    tangent_rad : float
        Its direction in the map [rad].
    cos, sin : float
        Of that.
    turn_rate_radpm : float
        How fast the taught heading turns with the station [rad/m].
    """

    tangent_rad: float
    cos: float
    sin: float
    turn_rate_radpm: float

    @classmethod
    def of(cls, tangent_rad: float, turn_rate_radpm: float) -> PathLine:
        """Return the line of a direction."""
        return cls(tangent_rad, math.cos(tangent_rad), math.sin(tangent_rad), turn_rate_radpm)


class Path:
    """An ordered sequence of waypoints, joined by straight lines.

    Path coordinates: the station grows along the lines, lateral is to the left of the line, and the heading
    is relative to the taught one, which turns evenly between two waypoints.

    Parameters
    ----------
    waypoints : iterable of Waypoint
        In order, stations strictly increasing; at least one.

    Raises
    ------
    ShapeError
        If there is no waypoint or the stations do not increase.
    """

    __slots__ = ("_grid", "_lines", "_polyline", "_poses", "_stations", "_turns", "_waypoints")

    def __init__(self, waypoints: Iterable[Waypoint]) -> None:
        taught = tuple(waypoints)
        poses = [waypoint.pose_map_base for waypoint in taught]
        rows = np.array([(pose.x, pose.y, pose.theta) for pose in poses], dtype=np.float64).reshape(-1, 3)
        self._lay_out(np.array([waypoint.station_m for waypoint in taught], dtype=np.float64), rows)
        self._waypoints: tuple[Waypoint, ...] | None = taught

    @classmethod
    def from_arrays(cls, stations_m: Floats, poses_map_base: Floats) -> Path:
        """Return the path of waypoints 0, 1, 2, ...; each is made when it is asked for.

        Parameters
        ----------
        stations_m : (N,) float64
            Way driven from the start of the path [m].
        poses_map_base : (N, 3) float64
            Base in the map: x, y, heading [m, m, rad].

        Raises
        ------
        ShapeError
            If the arrays have other shapes, there is no waypoint, a number is not finite or the stations do not
            increase.
        """
        stations, poses = np.array(stations_m, dtype=np.float64), np.array(poses_map_base, dtype=np.float64)
        if stations.ndim != 1 or poses.shape != (len(stations), 3):
            raise ShapeError(f"a path has shapes (N,) and (N, 3), not {stations.shape} and {poses.shape}")
        if not (np.isfinite(stations).all() and np.isfinite(poses).all()):
            raise ShapeError("a path is not finite")
        path = cls.__new__(cls)
        outside = (poses[:, 2] < -math.pi) | (poses[:, 2] >= math.pi)
        poses[outside, 2] = wrap_angles(poses[outside, 2])
        path._lay_out(stations, poses)
        path._waypoints = None
        return path

    def _lay_out(self, stations_m: Floats, poses: Floats) -> None:
        from trailmark.geometry.polyline import Polyline  # most runs have no path

        if not len(stations_m):
            raise ShapeError("a path needs at least one waypoint")
        self._stations, self._poses = stations_m, poses
        # The same as plain floats: a controller's question costs 1 us with them, and 5 us with arrays.
        self._grid: list[float] = stations_m.tolist()
        self._turns: list[float] = np.unwrap(poses[:, 2]).tolist()
        self._polyline = Polyline(poses[:, :2])
        self._lines: dict[int, PathLine] = {}  # as they were asked for
        if np.any(np.diff(stations_m) <= 0):
            first = int(np.flatnonzero(np.diff(stations_m) <= 0)[0])
            raise ShapeError(f"stations must increase, but waypoint {first + 1} does not lie after waypoint {first}")

    def __len__(self) -> int:
        return len(self._grid)

    @overload
    def __getitem__(self, index: int) -> Waypoint: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Waypoint, ...]: ...
    def __getitem__(self, index: int | slice) -> Waypoint | tuple[Waypoint, ...]:
        if self._waypoints is not None or isinstance(index, slice):
            return self.waypoints[index]
        number = range(len(self))[index]
        return Waypoint(number, self._grid[number], Pose2(*self._poses[number].tolist()))

    @property
    def waypoints(self) -> tuple[Waypoint, ...]:
        """All waypoints, in order."""
        if self._waypoints is None:
            self._waypoints = tuple(self[index] for index in range(len(self)))
        return self._waypoints

    @property
    def length_m(self) -> float:
        """Way from the first waypoint to the last [m]."""
        return float(self._stations[-1] - self._stations[0])

    @property
    def stations(self) -> npt.NDArray[np.float64]:
        """Station of every waypoint, (N,) [m]."""
        return self._stations

    @property
    def positions(self) -> npt.NDArray[np.float64]:
        """Position of every waypoint in the map, (N, 2) [m]."""
        return self._poses[:, :2]

    def pose_at(self, station_m: float) -> Pose2:
        """Return the taught pose at a station; beyond an end, the pose of that end."""
        if len(self) == 1:
            return self[0].pose_map_base
        index, fraction = self._segment_of(station_m)
        (start_x, start_y), (stop_x, stop_y) = self._polyline.ends(index)
        fraction = min(1.0, max(0.0, fraction))
        return Pose2(
            start_x + fraction * (stop_x - start_x),
            start_y + fraction * (stop_y - start_y),
            self._turns[index] + fraction * (self._turns[index + 1] - self._turns[index]),
        )

    def tangent_at(self, station_m: float) -> float:
        """Return the direction of the line at a station, in the map [rad]."""
        return self.line_at(station_m).tangent_rad

    def line_at(self, station_m: float) -> PathLine:
        """Return the line at a station; beyond an end, the line of that end."""
        grid = self._grid
        return self._line(min(max(bisect_right(grid, station_m) - 1, 0), len(grid) - 2))

    def turn_rate_at(self, station_m: float) -> float:
        """Return how fast the taught heading turns with the station; 0 beyond the ends [rad/m]."""
        if not self._grid[0] <= station_m <= self._grid[-1]:
            return 0.0
        return self.line_at(station_m).turn_rate_radpm

    def pose_from(self, on_path: OnPath) -> Pose2:
        """Return the pose in the map of a pose in path coordinates."""
        taught = self.pose_at(on_path.station_m)
        tangent = self.tangent_at(on_path.station_m)
        return Pose2(
            taught.x - math.sin(tangent) * on_path.lateral_m,
            taught.y + math.cos(tangent) * on_path.lateral_m,
            taught.theta + on_path.heading_rad,
        )

    def locate(self, pose_map_base: Pose2, near_station_m: float | None = None, window_m: float = 1.0) -> OnPath:
        """Return a pose in path coordinates: the nearest point of the lines.

        Parameters
        ----------
        pose_map_base : Pose2
            Pose in the map.
        near_station_m : float, optional
            Where the robot was just now. A path that crosses itself is then searched only within `window_m`
            of it, unless the pose has left that part of the path by more than `window_m`.
        """
        station_m, lateral_m, miss_m = self._nearest(pose_map_base, near_station_m, window_m)
        if near_station_m is not None and miss_m > window_m:
            station_m, lateral_m, _ = self._nearest(pose_map_base, None, window_m)
        heading_rad = wrap_angle(pose_map_base.theta - self._taught_heading(station_m))
        return OnPath(station_m, lateral_m, heading_rad)

    def _taught_heading(self, station_m: float) -> float:
        """Return the heading of `pose_at`."""
        if len(self._grid) == 1:
            return self[0].pose_map_base.theta
        index, fraction = self._segment_of(station_m)
        begin = self._turns[index]
        return wrap_angle(begin + min(1.0, max(0.0, fraction)) * (self._turns[index + 1] - begin))

    def _segment_of(self, station_m: float) -> tuple[int, float]:
        grid = self._grid
        index = min(max(bisect_right(grid, station_m) - 1, 0), len(grid) - 2)
        start = grid[index]
        return index, (station_m - start) / (grid[index + 1] - start)

    def _line(self, index: int) -> PathLine:
        """Return where the line from a waypoint to the next leads."""
        line = self._lines.get(index)
        if line is None:
            line = self._lines[index] = self._new_line(index)
        return line

    def _new_line(self, index: int) -> PathLine:
        if len(self) == 1:
            return PathLine.of(self[0].pose_map_base.theta, 0.0)
        (start_x, start_y), (stop_x, stop_y) = self._polyline.ends(index)
        dx, dy = stop_x - start_x, stop_y - start_y
        rate_radpm = (self._turns[index + 1] - self._turns[index]) / (self._grid[index + 1] - self._grid[index])
        if dx == 0.0 and dy == 0.0:  # turned on the spot: the heading is all there is
            return PathLine.of(wrap_angle(self._turns[index]), rate_radpm)
        return PathLine.of(math.atan2(dy, dx), rate_radpm)

    def _nearest(self, pose: Pose2, near_station_m: float | None, window_m: float) -> tuple[float, float, float]:
        """Return station, lateral offset and distance of the nearest point of the lines."""
        if len(self) == 1:
            seen = self[0].pose_map_base.between(pose)
            return self._grid[0], seen.y, math.hypot(seen.x, seen.y)
        grid = self._grid
        if near_station_m is None:
            index, fraction = self._polyline.nearest(pose.x, pose.y)
        else:
            end = len(grid) - 1
            first = min(max(bisect_left(grid, near_station_m - window_m) - 1, 0), end - 1)
            last = min(max(bisect_left(grid, near_station_m + window_m) + 1, first + 1), end)
            guess = min(max(bisect_right(grid, near_station_m) - 1, first), last - 1)
            index, fraction = self._polyline.nearest_among(pose.x, pose.y, first, last, guess)
        miss_m, from_x, from_y = self._polyline.miss(index, fraction, pose.x, pose.y)
        station_m = grid[index] + fraction * (grid[index + 1] - grid[index])
        line = self._line(index)
        return station_m, line.cos * from_y - line.sin * from_x, miss_m


@dataclass(frozen=True, slots=True, eq=False)
class TaughtPlaces:
    """Places of a taught path whose truth is known.

    Attributes
    ----------
    in_map, in_truth : (N, 3) float64
        As they were taught, and where base really was then, in the frame of the truth [m, m, rad].
    """

    in_map: Floats
    in_truth: Floats

    def off_m(self) -> Floats:
        """Return how far the map is off the truth at each place, (N,) [m]."""
        return np.asarray(np.linalg.norm(self.in_map[:, :2] - self.in_truth[:, :2], axis=1))
