"""Routes through a world, and how to draw them: pieces of line and arc, or points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import ConfigError
from trailmark.geometry import Pose2, wrap_angle
from trailmark.paths import Path, Waypoint

__all__ = ["Route", "arc", "line", "trace"]

_STEP_M = 0.01
#: Lengths of the waves in which a hand weaves, and over which they begin and end [m].
_SWAY_M = (1.1, 1.9, 3.1)
_SWAY_FADES_M = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """A way through a world and the speed to drive it with.

    Attributes
    ----------
    path : Path
        Poses along the way, dense enough (about 10 mm) that straight lines between them do.
    speed_mps : float
        Speed to drive with [m/s].
    summary : str
        What it is, in a few words.
    """

    path: Path
    speed_mps: float
    summary: str = ""

    @classmethod
    def from_poses(cls, poses: npt.ArrayLike, speed_mps: float, summary: str = "") -> Route:
        """Return the route of poses (N, 3) as x, y, theta [m, m, rad]; no two neighbours in one place."""
        rows = np.asarray(poses, dtype=np.float64)
        steps = np.hypot(*np.diff(rows[:, :2], axis=0).T)
        stations = np.concatenate([[0.0], np.cumsum(steps)])
        waypoints = [Waypoint(i, float(s), Pose2.from_array(row)) for i, (s, row) in enumerate(zip(stations, rows))]
        return cls(Path(waypoints), speed_mps, summary)

    @classmethod
    def through(cls, points: npt.ArrayLike, speed_mps: float, summary: str = "") -> Route:
        """Return the smooth route through points (N, 2) [m], heading along it."""
        from scipy.interpolate import PchipInterpolator  # here: most worlds draw no such route

        xy = np.asarray(points, dtype=np.float64)
        chord = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))])
        dense = np.linspace(0.0, chord[-1], max(2, round(chord[-1] / _STEP_M) + 1))
        x, y = (PchipInterpolator(chord, column)(dense) for column in xy.T)
        return cls.from_poses(np.stack([x, y, np.arctan2(np.gradient(y), np.gradient(x))], axis=1), speed_mps, summary)

    @property
    def length_m(self) -> float:
        """Length of the way [m]."""
        return self.path.length_m

    @property
    def start(self) -> Pose2:
        """Where it begins."""
        return self.path[0].pose_map_base

    def pose_at(self, station_m: float) -> Pose2:
        """Return the pose on the way, `station_m` from its beginning."""
        return self.path.pose_at(station_m)

    def curvature_at(self, station_m: float) -> float:
        """Return how fast the heading turns along the way [rad/m]."""
        before, after = station_m - 2 * _STEP_M, station_m + 2 * _STEP_M
        return wrap_angle(self.pose_at(after).theta - self.pose_at(before).theta) / (4 * _STEP_M)

    def at_speed(self, speed_mps: float) -> Route:
        """Return the same way at another speed."""
        return replace(self, speed_mps=speed_mps)

    def swaying(self, sway_m: float, rng: np.random.Generator) -> Route:
        """Return the way as a hand steers it, weaving about this one; it begins and ends where this one does.

        Parameters
        ----------
        sway_m : float
            Offset to the side, root mean square [m].
        rng : numpy.random.Generator
            Draws where the waves begin.
        """
        stations = self.path.stations
        phases = rng.uniform(0.0, 2.0 * math.pi, len(_SWAY_M))
        waves = [np.sin(2.0 * math.pi * stations / length + phase) for length, phase in zip(_SWAY_M, phases)]
        share = np.clip(np.minimum(stations, stations[-1] - stations) / _SWAY_FADES_M, 0.0, 1.0)
        left_m = sway_m * math.sqrt(2.0 / len(_SWAY_M)) * np.sum(waves, axis=0) * share**2 * (3.0 - 2.0 * share)
        turns = np.arctan(np.gradient(left_m, stations))
        turns[[0, -1]] = 0.0  # they fade out; one-sided differences do not quite
        places = [self.path[k].pose_map_base for k in range(len(self.path))]
        poses = [place @ Pose2(0.0, float(y), float(t)) for place, y, t in zip(places, left_m, turns, strict=True)]
        return Route.from_poses([pose.array() for pose in poses], self.speed_mps, self.summary)


def line(length_m: float) -> tuple[float, float]:
    """Return a straight piece for `trace`."""
    return length_m, 0.0


def arc(radius_m: float, angle_deg: float) -> tuple[float, float]:
    """Return a piece of a circle for `trace`; to the left for a positive angle."""
    return radius_m * math.radians(abs(angle_deg)), math.copysign(1.0 / radius_m, angle_deg)


def trace(start: Pose2, pieces: Sequence[tuple[float, float]], blend_m: float = 0.3) -> Floats:
    """Return the poses of a way made of pieces of constant curvature.

    Where pieces meet, the curvature changes over `blend_m` and not at once, as far as a steering wheel is turned
    on the way; length and turn of the whole stay as they are when the first and last pieces are long enough.

    Parameters
    ----------
    start : Pose2
        Where it begins.
    pieces : sequence of (length_m, curvature)
        From `line` and `arc` [m, rad/m].
    blend_m : float
        Length over which the curvature changes [m].

    Returns
    -------
    (N, 3) float64
        x, y, theta every 10 mm [m, m, rad].
    """
    total_m = sum(length for length, _ in pieces)
    if not total_m > 0.0:
        raise ConfigError(f"a route needs a length, not {total_m} m")
    n_steps = round(total_m / _STEP_M)
    step_m = total_m / n_steps
    lengths, curvatures = np.array(pieces, dtype=np.float64).T
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    turns = np.concatenate([[0.0], np.cumsum(lengths * curvatures)])
    curvature = np.diff(np.interp(np.arange(n_steps + 1) * step_m, ends, turns)) / step_m
    n_blend = max(1, round(blend_m / step_m)) | 1
    padded = np.pad(curvature, n_blend // 2, mode="edge")
    curvature = np.convolve(padded, np.full(n_blend, 1.0 / n_blend), mode="valid")
    poses = [start]
    for kappa in curvature:
        poses.append(poses[-1] @ Pose2.exp(step_m, 0.0, float(kappa) * step_m))
    return np.array([pose.array() for pose in poses])
