"""Wheel odometry as a localizer."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from trailmark.estimates import Belief, Estimate, Lost, Motion, information_along, information_from_covariance
from trailmark.frames import Frame, Odometry
from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import Localizer, Session
from trailmark_baselines.config import OdometryConfig
from trailmark_baselines.spread import Spread, random_walk, step_covariance

__all__ = ["OdometryLocalizer"]

# Of a robot that nobody watched: as the estimators take it.
_UNSEEN_MPS, _UNSEEN_DEG_PER_S = 0.5, 30.0

# Two readings that come at once, late, may show this of a turn in no time.
_LEAST_JUMP_RAD = math.radians(15.0)


class OdometryLocalizer(Localizer):
    """Turns odometry since the start into motion since the last frame, with a covariance for slip.

    Odometry that gives a distance only is taken as a straight step along x. That it turned is then not measured but
    assumed: within ``unmeasured_turn_deg``, or, with None, nothing is said but the distance.
    """

    config: OdometryConfig
    uses_belief = False

    def __init__(self, config: OdometryConfig) -> None:
        super().__init__(config)
        self._last: tuple[float, Odometry] | None = None
        self._settled: Twist2 | None = None

    def start(self, session: Session) -> None:
        """Forget the last frame."""
        self._last = self._settled = None

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return the motion since the last frame; the first one is only where it begins."""
        now = frame.payload
        if not isinstance(now, Odometry):
            return ()
        last, self._last = self._last, (frame.stamp_s, now)
        if last is None:
            return ()
        since_s, before = last
        dt_s = frame.stamp_s - since_s
        reads_velocity = self.config.reads == "velocity"
        step = _step_of_mean_velocity(before, now, dt_s) if reads_velocity else _step(before, now)
        if step is None:
            self._settled = None
            missing = "gives no velocity" if reads_velocity else "changed between pose and distance"
            return (Lost(frame.stamp_s, f"the odometry {missing}"),)
        if jump := self._jump(step, dt_s):
            self._settled = None
            return (Lost(frame.stamp_s, jump),)
        if now.pose_start_base is None and not reads_velocity:
            return (self._straight(since_s, frame.stamp_s, step.x),)
        return (self._motion_from_velocity(since_s, frame.stamp_s, step),)

    def _jump(self, step: Pose2, dt_s: float) -> str:
        """Return in words how a step is none that a robot can make; empty: it can."""
        way_m, turn_rad = math.hypot(step.x, step.y), abs(step.theta)
        if way_m > self.config.max_speed_mps * dt_s:
            return f"a jump of {way_m:.3g} m in {dt_s:.3g} s: restarted?"
        if turn_rad > max(_LEAST_JUMP_RAD, math.radians(self.config.max_turn_dps) * dt_s):
            return f"a turn of {math.degrees(turn_rad):.3g} deg in {dt_s:.3g} s: restarted, or degrees for radians?"
        return ""

    def _motion_from_velocity(self, since_s: float, stamp_s: float, step: Pose2) -> Motion:
        config, dt_s = self.config, stamp_s - since_s
        arc = step.log()
        forward_m, left_m, _ = arc
        driven_m = math.hypot(forward_m, left_m)  # the arc, not the chord
        late = self._variances_of_lag(arc, dt_s)
        rest_m2 = random_walk((config.rest_sigma, dt_s), (config.slip_sigma, step.theta))
        turn_deg2 = random_walk(
            (config.turn_sigma_deg, driven_m), (config.turning_sigma_deg, step.theta), (config.rest_sigma_deg, dt_s)
        )
        spread = Spread(
            random_walk((config.distance_sigma, driven_m)) + rest_m2 + late[0],
            random_walk((config.lateral_sigma, driven_m)) + rest_m2 + late[1],
            turn_deg2 * math.radians(1.0) ** 2 + late[2],
        )
        covariance = step_covariance(step.x, step.y, spread) + self._unseen(dt_s)
        return Motion(since_s, stamp_s, step, information_from_covariance(covariance))

    def _variances_of_lag(self, arc: tuple[float, float, float], dt_s: float) -> tuple[float, float, float]:
        """Return the variances along, across and of the turn of a body that is behind its readings, or ahead.

        The body is taken to reach the speed that is told as a first-order lag does. After a jump by v all steps err to
        one side, by v times `lag_s` in all; the variances of independent steps add up to half the square of that.
        """
        lag_s, per_s = self.config.lag_s, 1.0 / max(dt_s, 1e-9)
        told = Twist2(arc[0] * per_s, arc[1] * per_s, arc[2] * per_s)
        if lag_s == 0.0 or self._settled is None or dt_s > self.config.max_gap_s:
            self._settled = told if dt_s <= self.config.max_gap_s else None
            return 0.0, 0.0, 0.0
        body, followed = self._settled, 1.0 - math.exp(-dt_s / lag_s)
        ahead = told.forward_mps - body.forward_mps, told.left_mps - body.left_mps, told.yaw_radps - body.yaw_radps
        self._settled = Twist2(
            body.forward_mps + followed * ahead[0],
            body.left_mps + followed * ahead[1],
            body.yaw_radps + followed * ahead[2],
        )
        squared_s2 = lag_s * min(dt_s, lag_s)
        return squared_s2 * ahead[0] ** 2, squared_s2 * ahead[1] ** 2, squared_s2 * ahead[2] ** 2

    def _unseen(self, dt_s: float) -> npt.NDArray[np.float64] | float:
        """Return the covariance of what may have happened between two readings: zero, or that of a gap."""
        if dt_s <= self.config.max_gap_s:
            return 0.0
        position_m, turn_rad = _UNSEEN_MPS * dt_s, min(math.radians(_UNSEEN_DEG_PER_S) * dt_s, math.pi)
        return np.diag([position_m**2, position_m**2, turn_rad**2])

    def _straight(self, since_s: float, stamp_s: float, distance_m: float) -> Motion:
        config, dt_s, step = self.config, stamp_s - since_s, Pose2(distance_m)
        late_m2, _, _ = self._variances_of_lag((distance_m, 0.0, 0.0), dt_s)
        rest_m2 = random_walk((config.rest_sigma, dt_s))
        along_m2 = random_walk((config.distance_sigma, distance_m)) + rest_m2 + late_m2
        if config.unmeasured_turn_deg is None:
            along_m2 += float(np.asarray(self._unseen(dt_s)).flat[0])
            return Motion(since_s, stamp_s, step, information_along((1.0, 0.0, 0.0), math.sqrt(along_m2)))
        turn_deg2 = random_walk((config.unmeasured_turn_deg, distance_m), (config.rest_sigma_deg, dt_s))
        across_m2 = random_walk((config.lateral_sigma, distance_m)) + rest_m2
        spread = Spread(along_m2, across_m2, turn_deg2 * math.radians(1.0) ** 2)
        covariance = step_covariance(distance_m, 0.0, spread) + self._unseen(dt_s)
        return Motion(since_s, stamp_s, step, information_from_covariance(covariance))


def _step(before: Odometry, now: Odometry) -> Pose2 | None:
    """Return base now as seen from base before; None where the two frames have nothing in common."""
    if before.pose_start_base is not None and now.pose_start_base is not None:
        return before.pose_start_base.between(now.pose_start_base)
    if before.distance_m is not None and now.distance_m is not None:
        return Pose2(now.distance_m - before.distance_m)
    return None


def _step_of_mean_velocity(before: Odometry, now: Odometry, dt_s: float) -> Pose2 | None:
    """Return the step at the mean of two velocities; None where a frame has none."""
    if before.twist is None or now.twist is None:
        return None
    half_s = dt_s / 2.0
    return Pose2.exp(
        half_s * (before.twist.forward_mps + now.twist.forward_mps),
        half_s * (before.twist.left_mps + now.twist.left_mps),
        half_s * (before.twist.yaw_radps + now.twist.yaw_radps),
    )
