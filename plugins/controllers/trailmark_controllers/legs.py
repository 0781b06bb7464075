"""Legs: stretches of a taught path that are driven without turning back, smoothed, with the speed that they allow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import Pose2, wrap_angle
from trailmark.paths import Path, Waypoint
from trailmark_controllers.tracking_config import TrackingConfig

__all__ = ["Leg", "Stretch", "legs_of", "place_on_legs", "stretches_of"]

#: Distance of the points of a smoothed stretch [m].
_GRID_M = 0.02
#: A taught turn sharper than this radius is one on the spot: there the path is cut [m].
_SPOT_RADIUS_M = 0.125
_SPOT_RAD = math.radians(10.0)
#: Over this way the direction of a path is read where it may turn back [m].
_TURN_BACK_M = 0.05
#: Weight of the heading in the choice of the place where a robot stands [m/rad], and what counts as equally near [m].
_HEADING_M = 0.3
_EQUALLY_NEAR_M = 0.15


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """A smoothed stretch of a taught path.

    Attributes
    ----------
    path : Path
        Its poses, 2 cm apart; stations are those of the taught path.
    bends_per_m : (N,) float64
        How the taught heading turns with the station [rad/m].
    """

    path: Path
    bends_per_m: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """A stretch and the sense in which it is driven.

    Attributes
    ----------
    stretch : Stretch
        Where.
    direction : {1, -1}
        1 along the taught sense.
    limits_mps : (N,) float64
        Speed that bends, and braking for them, allow at each point [m/s].
    """

    stretch: Stretch
    direction: int
    limits_mps: Floats

    @property
    def path(self) -> Path:
        """The poses."""
        return self.stretch.path

    @property
    def first_station_m(self) -> float:
        """Where it begins [m]."""
        return float(self.path.stations[0 if self.direction > 0 else -1])

    def rest_m(self, station_m: float) -> float:
        """Return the way left to its end [m]."""
        return float(self.path.stations[-1 if self.direction > 0 else 0] - station_m) * self.direction

    def bend_at(self, station_m: float) -> float:
        """Return the taught turn per way driven [rad/m]."""
        return self.direction * float(np.interp(station_m, self.path.stations, self.stretch.bends_per_m))

    def limit_at(self, station_m: float) -> float:
        """Return the speed that the bends from here on allow [m/s]."""
        return float(np.interp(station_m, self.path.stations, self.limits_mps))


def stretches_of(path: Path, smooth_m: float) -> list[Stretch]:
    """Return a taught path cut where it turns on the spot or turns back, each stretch smoothed.

    Parameters
    ----------
    path : Path
        The taught path.
    smooth_m : float
        Half the stretch that each place is read from [m].
    """
    return [_smooth_stretch(path, first, last, smooth_m) for first, last in _cuts(path)]


def legs_of(stretches: Sequence[Stretch], config: TrackingConfig, *, is_reverse: bool) -> list[Leg]:
    """Return the legs of all trips that are asked for, in their order."""
    along = [Leg(stretch, 1, _limits(stretch, config, 1)) for stretch in stretches]
    back = [Leg(stretch, -1, _limits(stretch, config, -1)) for stretch in reversed(stretches)]
    there, home = (back, along) if is_reverse else (along, back)
    return [leg for trip in range(round(2 * config.repeat)) for leg in (home if trip % 2 else there)]


def place_on_legs(legs: Sequence[Leg], pose_map_base: Pose2) -> tuple[int, float]:
    """Return the leg on which a robot stands and the station there: of places equally near, the first to be driven.

    A path may pass one place several times, and end where it begins.
    """
    scores = []
    for leg in legs:
        away = leg.path.positions - (pose_map_base.x, pose_map_base.y)
        headings = np.array([waypoint.pose_map_base.theta for waypoint in leg.path.waypoints])
        turns = np.abs(np.angle(np.exp(1j * (headings - pose_map_base.theta))))
        scores.append(np.hypot(away[:, 0], away[:, 1]) + _HEADING_M * turns)
    limit = min(float(score.min()) for score in scores) + _EQUALLY_NEAR_M
    for number, (leg, score) in enumerate(zip(legs, scores, strict=True)):
        near = np.flatnonzero(score <= limit)
        if len(near):
            first = float(leg.path.stations[near[0 if leg.direction > 0 else -1]])
            return number, leg.path.locate(pose_map_base, first, window_m=2.0 * _EQUALLY_NEAR_M).station_m
    raise AssertionError("unreachable: the least score is within the limit")


def _cuts(path: Path) -> list[tuple[int, int]]:
    """Return the first and last waypoint of every stretch."""
    last = len(path) - 1
    ends: list[tuple[int, int]] = []
    first = 0
    for i in range(last):
        step_m = float(path.stations[i + 1] - path.stations[i])
        turn_rad = abs(wrap_angle(path[i + 1].pose_map_base.theta - path[i].pose_map_base.theta))
        if turn_rad > max(_SPOT_RAD, step_m / _SPOT_RADIUS_M):
            ends.append((first, i))
            first = i + 1
        elif i > first and _turns_back(path, i):
            ends.append((first, i))
            first = i
    ends.append((first, last))
    long_enough = [(a, b) for a, b in ends if b > a]
    return long_enough or [(0, last)]


def _turns_back(path: Path, i: int) -> bool:
    """Return whether the way out of a waypoint leads back along the way in."""
    stations = path.stations
    before = max(0, int(np.searchsorted(stations, stations[i] - _TURN_BACK_M, side="right")) - 1)
    after = min(len(path) - 1, int(np.searchsorted(stations, stations[i] + _TURN_BACK_M)))
    way_in, way_out = path.positions[i] - path.positions[before], path.positions[after] - path.positions[i]
    lengths = float(np.linalg.norm(way_in)), float(np.linalg.norm(way_out))
    return min(lengths) > 0.0 and float(way_in @ way_out) < -0.5 * lengths[0] * lengths[1]


def _smooth_stretch(path: Path, first: int, last: int, smooth_m: float) -> Stretch:
    """Return a stretch as parabolas through the waypoints around each of its points."""
    stations = path.stations[first : last + 1]
    headings = np.unwrap([path[i].pose_map_base.theta for i in range(first, last + 1)])
    values = np.column_stack([path.positions[first : last + 1], headings])
    if len(stations) < 3:
        rates = np.diff(headings) / np.diff(stations) if len(stations) > 1 else np.zeros(1)
        return Stretch(Path(path.waypoints[first : last + 1]), np.resize(rates, len(stations)))
    n = max(2, round((stations[-1] - stations[0]) / _GRID_M) + 1)
    grid = np.linspace(stations[0], stations[-1], n)
    poses, bends = np.empty((n, 3)), np.empty(n)
    for k, station_m in enumerate(grid):
        low, high = _window(stations, station_m, smooth_m)
        away = stations[low:high] - station_m
        fit = np.linalg.lstsq(np.vander(away, 3, increasing=True), values[low:high], rcond=None)[0]
        poses[k], bends[k] = fit[0], fit[1, 2]
    waypoints = [Waypoint(k, float(s), Pose2.from_array(pose)) for k, (s, pose) in enumerate(zip(grid, poses))]
    return Stretch(Path(waypoints), bends)


def _window(stations: Floats, station_m: float, half_m: float) -> tuple[int, int]:
    """Return the range of waypoints around a station; at an end it is as wide, and to one side."""
    centre_m = min(max(station_m, stations[0] + half_m), max(stations[-1] - half_m, stations[0] + half_m))
    low = int(np.searchsorted(stations, centre_m - half_m - 1e-9))
    high = int(np.searchsorted(stations, centre_m + half_m + 1e-9))
    while high - low < min(4, len(stations)):  # waypoints far apart
        low, high = max(0, low - 1), min(len(stations), high + 1)
    return low, high


def _limits(stretch: Stretch, config: TrackingConfig, direction: int) -> Floats:
    """Return the speed at each point that bends allow, and braking for those ahead."""
    bends = np.maximum(np.abs(stretch.bends_per_m), 1e-9)
    limits = np.minimum(math.radians(config.yaw_limit_dps) / bends, np.sqrt(config.lateral_mps2 / bends))
    limits = np.minimum(limits, config.speed_mps)[::direction]
    steps = np.abs(np.diff(stretch.path.stations[::direction]))
    for k in range(len(limits) - 2, -1, -1):
        limits[k] = min(limits[k], math.sqrt(limits[k + 1] ** 2 + 2.0 * config.accel_mps2 * steps[k]))
    return np.ascontiguousarray(limits[::direction])
