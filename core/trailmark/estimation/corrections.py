"""What an absolute estimate does to the pose at its own stamp."""

from __future__ import annotations

import math

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Fix, PathOffset
from trailmark.estimation.information import Measured
from trailmark.estimation.on_path import covariance_on_path
from trailmark.estimation.symmetric import ZERO, Sym3, add, congruence, sheared
from trailmark.geometry import Pose2, wrap_angle
from trailmark.paths import OnPath, Path
from trailmark.values import quick_dataclass

__all__ = ["Correction", "FixCorrection", "PathCorrection", "correction_by"]

Believed = tuple[Pose2, Sym3]

_UNIT = np.eye(3)


@quick_dataclass(frozen=True, slots=True, eq=False)
class FixCorrection:
    """A fix replaces the directions of the pose that it measured; the others keep the belief.

    Attributes
    ----------
    fix : Fix
        The absolute pose.
    measured : Measured
        Which directions its information covers.
    """

    fix: Fix
    measured: Measured

    def apply(self, believed: Believed | None) -> Believed | None:
        """Return pose and covariance after the fix; None while the pose is still unknown."""
        gain = self.measured.gain
        if gain is None:
            return self.fix.pose_map_base, self.measured.covariance
        if believed is None:
            return None
        pose, covariance = believed
        measured = self.fix.pose_map_base
        dx, dy, turn = _gain_of(gain, measured.x - pose.x, measured.y - pose.y, wrap_angle(measured.theta - pose.theta))
        return Pose2(pose.x + dx, pose.y + dy, pose.theta + turn), _narrow(covariance, self.measured, gain)


@quick_dataclass(frozen=True, slots=True, eq=False)
class PathCorrection:
    """A path offset replaces the path coordinates that it measured.

    Attributes
    ----------
    offset : PathOffset
        The fix in coordinates of the path.
    measured : Measured
        Which of its coordinates its information covers.
    path : Path
        The taught path.
    """

    offset: PathOffset
    measured: Measured
    path: Path

    def apply(self, believed: Believed | None) -> Believed | None:
        """Return pose and covariance after the offset; None while the pose is still unknown."""
        offset, gain = self.offset, self.measured.gain
        if gain is None:
            on_path = OnPath(offset.station_m, offset.lateral_m, offset.heading_rad)
            return self.path.pose_from(on_path), _covariance_in_map(
                self.measured.covariance, self.path, on_path.station_m
            )
        if believed is None:
            return None
        pose, covariance = believed
        before = self.path.locate(pose, offset.station_m)  # measured or not, it says which branch of a crossing
        ds, dl, turn = _gain_of(
            gain,
            offset.station_m - before.station_m,
            offset.lateral_m - before.lateral_m,
            wrap_angle(offset.heading_rad - before.heading_rad),
        )
        after = OnPath(before.station_m + ds, before.lateral_m + dl, before.heading_rad + turn)
        narrowed = _narrow(covariance_on_path(covariance, self.path, before.station_m), self.measured, gain)
        return self._shift_along_path(pose, before, after), _covariance_in_map(narrowed, self.path, after.station_m)

    def _shift_along_path(self, pose: Pose2, before: OnPath, after: OnPath) -> Pose2:
        """Return the pose moved as its path coordinates do.

        What path coordinates cannot say (how far it lies beyond an end) moves along.
        """
        placed, moved = self.path.pose_from(before), self.path.pose_from(after)
        bend = self.path.tangent_at(after.station_m) - self.path.tangent_at(before.station_m)
        cos, sin = math.cos(bend), math.sin(bend)
        dx, dy = pose.x - placed.x, pose.y - placed.y
        turn = wrap_angle(pose.theta - placed.theta)
        return Pose2(moved.x + cos * dx - sin * dy, moved.y + sin * dx + cos * dy, moved.theta + turn)


Correction = FixCorrection | PathCorrection


def correction_by(estimate: Fix | PathOffset, measured: Measured, path: Path | None) -> Correction | str:
    """Return what an absolute estimate does to the pose, or why it can do nothing."""
    if isinstance(estimate, Fix):
        return FixCorrection(estimate, measured)
    if path is None:
        return "a path offset needs a path, and this run has none"
    if not math.isfinite(estimate.station_m + estimate.lateral_m + estimate.heading_rad):
        return "the path offset is not finite"
    return PathCorrection(estimate, measured, path)


def _covariance_in_map(covariance: Sym3, path: Path, station_m: float) -> Sym3:
    tangent = path.tangent_at(station_m)
    along = sheared(covariance, path.turn_rate_at(station_m))
    return congruence(along, math.cos(tangent), math.sin(tangent), 0.0, 0.0)


def _gain_of(gain: Floats, *innovation: float) -> tuple[float, float, float]:
    a, b, c = (gain @ innovation).tolist()
    return a, b, c


def _narrow(covariance: Sym3, measured: Measured, gain: Floats) -> Sym3:
    """Return ``(1 - gain) covariance (1 - gain)^T`` and what was measured; plain floats, see `symmetric`."""
    if covariance is ZERO:
        return measured.covariance
    xx, xy, xt, yy, yt, tt = covariance
    (a, b, c), (d, e, f), (g, h, i) = (_UNIT - gain).tolist()
    x = a * xx + b * xy + c * xt, a * xy + b * yy + c * yt, a * xt + b * yt + c * tt
    y = d * xx + e * xy + f * xt, d * xy + e * yy + f * yt, d * xt + e * yt + f * tt
    t = g * xx + h * xy + i * xt, g * xy + h * yy + i * yt, g * xt + h * yt + i * tt
    kept = (
        a * x[0] + b * x[1] + c * x[2],
        d * x[0] + e * x[1] + f * x[2],
        g * x[0] + h * x[1] + i * x[2],
        d * y[0] + e * y[1] + f * y[2],
        g * y[0] + h * y[1] + i * y[2],
        g * t[0] + h * t[1] + i * t[2],
    )
    return add(kept, measured.covariance)
