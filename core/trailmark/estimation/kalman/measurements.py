"""Absolute estimates as measurements of unit noise: a square root of their information, times what they say."""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Fix, PathOffset
from trailmark.estimation.kalman.trust import Trust, root_of
from trailmark.estimation.symmetric import Sym3
from trailmark.geometry import Pose2, wrap_angle
from trailmark.paths import OnPath, Path
from trailmark.values import quick_dataclass

__all__ = ["Measurement", "fix_measurement", "path_measurement", "pose_measurement"]


@quick_dataclass(frozen=True, slots=True, eq=False)
class Measurement:
    """A `Fix`, or with a path a `PathOffset`.

    Attributes
    ----------
    key : tuple
        Puts the measurements of one instant into an order that does not depend on their arrival.
    source : str
        The localizer.
    trust : Trust
        How its estimates are taken.
    values : (float, float, float)
        x, y, theta; or station, lateral, heading.
    root : (k, 3) float64
        One row for each measured direction: ``root^T root`` is the information.
    path : Path or None
        In whose coordinates the values are.
    replaces : bool
        Whether the belief is replaced instead of corrected.
    correlation_s : float
        Time in which the errors of the localizer's measurements last; 0 if each errs anew [s].
    said : tuple of float
        Those of the values that were measured; the others may be anything.
    shifted_s : float
        By how much earlier than the one before the localizer's clock puts it since a delay was found [s].
    """

    key: tuple[str, tuple[float, ...]]
    source: str
    trust: Trust
    values: tuple[float, float, float]
    root: Floats
    path: Path | None = None
    replaces: bool = False
    correlation_s: float = 0.0
    said: tuple[float, ...] = ()
    shifted_s: float = 0.0

    def innovation(self, x: Floats) -> tuple[Floats, Floats]:
        """Return measured less predicted, (k,), and the Jacobian of the prediction, (k, n), at a state of n numbers."""
        believed = x[:3].tolist()
        jacobian = self.root
        if self.path is not None:
            on_path = self.path.locate(Pose2(*believed), self.values[0])
            jacobian = self.root @ _path_jacobian(self.path, on_path.station_m)
            believed = on_path.station_m, on_path.lateral_m, on_path.heading_rad
        if len(x) > 3:
            jacobian = np.hstack([jacobian, np.zeros((len(jacobian), len(x) - 3))])
        a, b, turn = self.values
        return self.root.dot([a - believed[0], b - believed[1], wrap_angle(turn - believed[2])]), jacobian

    def as_start(self) -> tuple[Floats, Floats] | None:
        """Return a pose and its covariance from this alone; None if it does not say a whole pose."""
        if len(self.root) < 3:
            return None
        inverse = np.linalg.inv(self.root)
        if self.path is not None:
            station_m, lateral_m, heading_rad = self.values
            inverse = np.linalg.inv(_path_jacobian(self.path, station_m)) @ inverse
            return self.path.pose_from(OnPath(station_m, lateral_m, heading_rad)).array(), inverse @ inverse.T
        x, y, theta = self.values
        return np.array([x, y, wrap_angle(theta)]), inverse @ inverse.T


def fix_measurement(
    source: str, fix: Fix, information: Sym3, trust: Trust, correlation_s: float = 0.0, shifted_s: float = 0.0
) -> Measurement:
    """Return a fix as a measurement; `correlation_s` is how long its errors last."""
    values = fix.pose_map_base.x, fix.pose_map_base.y, fix.pose_map_base.theta
    key, root = (source, values + information), root_of(information)
    said = _measured_of(values, root)
    return Measurement(key, source, trust, values, root, correlation_s=correlation_s, said=said, shifted_s=shifted_s)


def pose_measurement(pose: Pose2, covariance: Floats) -> Measurement:
    """Return a pose that was set: it comes before all else of its instant, and replaces the belief."""
    values = pose.x, pose.y, pose.theta
    root = np.linalg.inv(np.linalg.cholesky(covariance))
    trust = Trust(None, "none", math.inf, 1.0, (0.0, 0.0), None)
    key = "", (*values, *covariance.ravel().tolist())
    return Measurement(key, "", trust, values, root, replaces=True, said=values)


def path_measurement(source: str, offset: PathOffset, information: Sym3, trust: Trust, path: Path) -> Measurement:
    """Return a path offset as a measurement."""
    values = offset.station_m, offset.lateral_m, offset.heading_rad
    key, root = (source, values + information), root_of(information)
    return Measurement(key, source, trust, values, root, path, said=_measured_of(values, root))


def _measured_of(values: tuple[float, ...], root: Floats) -> tuple[float, ...]:
    return tuple(value for value, column in zip(values, zip(*root.tolist())) if any(column))


def _path_jacobian(path: Path, station_m: float) -> Floats:
    """Return d(station, lateral, heading) / d(x, y, theta): the taught heading turns with the station."""
    rate, line = path.turn_rate_at(station_m), path.line_at(station_m)
    cos, sin = line.cos, line.sin
    return np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [-rate * cos, -rate * sin, 1.0]])
