"""Wheel odometry as a localizer."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trailmark.estimates import Belief, Estimate, Lost, Motion, information_along, information_from_covariance
from trailmark.frames import Frame, Odometry
from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import Localizer, Session
from trailmark_baselines.config import OdometryConfig
from trailmark_baselines.reading_gaps import Components, ReadingGaps
from trailmark_baselines.spread import Spread, random_walk, step_covariance

__all__ = ["OdometryLocalizer"]

logger = logging.getLogger(__name__)

_NOTHING = Components(0.0, 0.0, 0.0)

# Two readings that come at once, late, may show this of a turn in no time.
_LEAST_JUMP_RAD = math.radians(15.0)
# Odometry that was started anew tells this, to rounding [m, rad].
_ZERO = 1e-3
# What was missing stands in the health for so long [s].
_TOLD_S = 30.0


class OdometryLocalizer(Localizer):
    """Turns odometry since the start into motion since the last frame, with a covariance for slip.

    Odometry that gives a distance only is taken as a straight step along x. That it turned is then not measured but
    assumed: within ``unmeasured_turn_deg``, or, with None, nothing is said but the distance.

    Across a gap a step counts where it is one that the robot would have driven, and is as uncertain as it differs from
    going on as before. Another one that it could have driven covers both, as the pose may miss the way: who else
    measures it is the estimator's to know. The rest is `Lost`.
    """

    config: OdometryConfig
    uses_belief = False

    def __init__(self, config: OdometryConfig) -> None:
        super().__init__(config)
        self._begin("odometry")

    def start(self, session: Session) -> None:
        """Forget the last frame."""
        self._begin(session.name)

    def _begin(self, name: str) -> None:
        self._name = name
        self._last: tuple[float, Odometry] | None = None
        self._settled: Twist2 | None = None
        self._gaps = ReadingGaps(self.config.max_gap_s)
        self._missing, self._missing_s = "", -math.inf

    def health(self) -> str:
        """Return what is missing of the way since a while ago."""
        return self._missing

    def observe(self, frame: Frame, belief: Belief) -> Sequence[Estimate]:
        """Return the motion since the last frame; the first one is only where it begins."""
        now, stamp_s = frame.payload, frame.stamp_s
        if not isinstance(now, Odometry):
            return ()
        last, self._last = self._last, (stamp_s, now)
        if self._missing and stamp_s - self._missing_s > _TOLD_S:
            self._missing = ""
        if last is None:
            return ()
        since_s, before = last
        dt_s = stamp_s - since_s
        reads_velocity = self.config.reads == "velocity"
        step = _step_of_mean_velocity(before, now, dt_s) if reads_velocity else _step(before, now)
        if step is None:
            missing = "gives no velocity" if reads_velocity else "changed between pose and distance"
            return (self._lost(stamp_s, f"the odometry {missing}"),)
        arc, is_gap, is_long = Components(*step.log()), self._gaps.is_gap(dt_s), dt_s > self.config.max_gap_s
        self._gaps.note_interval(dt_s)
        if jump := self._jump(step, dt_s) or self._restart(step, now, dt_s):
            return (self._lost(stamp_s, jump),)
        doubt = self._doubt(arc, now, dt_s) if is_gap or (is_long and reads_velocity) else ""
        if doubt:
            reason = self._told_missing(stamp_s, f"no reading for {dt_s:.1f} s, {doubt}")
            if reads_velocity or _is_at_zero(now) or not self._gaps.may_be_driven(arc, now.twist, dt_s):
                return (self._lost(stamp_s, reason),)
            late, unseen = _NOTHING, self._gaps.variances_of_doubt(arc, now.twist, dt_s)
            self._begin_anew()
        else:
            late = self._variances_of_lag(arc, dt_s)
            unseen = self._gaps.variances(arc, dt_s, before.twist, late) if is_gap or is_long else _NOTHING
            self._gaps.note_step(arc, dt_s)
        if now.pose_start_base is None and not reads_velocity:
            motion = self._straight((since_s, stamp_s), step.x, late, unseen)
        else:
            motion = self._motion_from_velocity((since_s, stamp_s), step, arc, late, unseen)
        return (replace(motion, is_guess=True) if doubt else motion,)

    def _lost(self, stamp_s: float, reason: str) -> Lost:
        """Return that the way since the last reading is not known; the next one begins anew."""
        self._begin_anew()
        return Lost(stamp_s, reason)

    def _begin_anew(self) -> None:
        """Forget how the robot drove: it may drive in another way now."""
        self._settled = None
        self._gaps.forget_speed()

    def _told_missing(self, stamp_s: float, reason: str) -> str:
        """Return why the way of a gap may be missing, after it was warned of."""
        if not self._missing:  # once, where each time is as long
            logger.warning(
                "%s: %s: what was driven in it may be missing, unless another localizer tells it", self._name, reason
            )
        self._missing, self._missing_s = f"{reason}: that way may be missing", stamp_s
        return reason

    def _doubt(self, arc: Components, now: Odometry, dt_s: float) -> str:
        """Return in words why a step may miss the way of a gap; empty: it holds it."""
        if self.config.reads == "velocity" and dt_s > self.config.max_gap_s:
            return "and velocities do not say what was driven in it"
        return self._gaps.why_doubtful(arc, now.twist, dt_s)

    def _jump(self, step: Pose2, dt_s: float) -> str:
        """Return in words how a step is none that a robot can make; empty: it can."""
        way_m, turn_rad = math.hypot(step.x, step.y), abs(step.theta)
        if way_m > self.config.max_speed_mps * dt_s:
            return f"a jump of {way_m:.3g} m in {dt_s:.3g} s: restarted?"
        if turn_rad > max(_LEAST_JUMP_RAD, math.radians(self.config.max_turn_dps) * dt_s):
            return f"a turn of {math.degrees(turn_rad):.3g} deg in {dt_s:.3g} s: restarted, or degrees for radians?"
        return ""

    def _restart(self, step: Pose2, now: Odometry, dt_s: float) -> str:
        """Return in words how odometry begins at zero again, from farther away than this robot drives; empty: not."""
        way_m = math.hypot(step.x, step.y)
        if _is_at_zero(now) and self._gaps.is_impossible(way_m, dt_s):
            return f"from {way_m:.3g} m away to zero in {dt_s:.3g} s: restarted"
        return ""

    def _motion_from_velocity(
        self, span_s: tuple[float, float], step: Pose2, arc: Components, late: Components, unseen: Components
    ) -> Motion:
        config, dt_s = self.config, span_s[1] - span_s[0]
        driven_m = math.hypot(arc.along, arc.across)  # the arc, not the chord
        rest_m2 = random_walk((config.rest_sigma, dt_s), (config.slip_sigma, step.theta))
        turn_deg2 = random_walk(
            (config.turn_sigma_deg, driven_m), (config.turning_sigma_deg, step.theta), (config.rest_sigma_deg, dt_s)
        )
        spread = Spread(
            random_walk((config.distance_sigma, driven_m)) + rest_m2 + late.along,
            random_walk((config.lateral_sigma, driven_m)) + rest_m2 + late.across,
            turn_deg2 * math.radians(1.0) ** 2 + late.turn,
        )
        covariance = step_covariance(step.x, step.y, spread)
        if unseen is not _NOTHING:
            covariance = covariance + np.diag(unseen)
        return Motion(*span_s, step, information_from_covariance(covariance))

    def _variances_of_lag(self, arc: Components, dt_s: float) -> Components:
        """Return the variances along, across and of the turn of a body that is behind its readings, or ahead.

        The body is taken to reach the speed that is told as a first-order lag does. After a jump by v all steps err to
        one side, by v times `lag_s` in all; the variances of independent steps add up to half the square of that.
        """
        lag_s, per_s = self.config.lag_s, 1.0 / max(dt_s, 1e-9)
        told = Twist2(arc[0] * per_s, arc[1] * per_s, arc[2] * per_s)
        if lag_s == 0.0 or self._settled is None or dt_s > self.config.max_gap_s:
            self._settled = told if dt_s <= self.config.max_gap_s else None
            return _NOTHING
        body, followed = self._settled, 1.0 - math.exp(-dt_s / lag_s)
        ahead = told.forward_mps - body.forward_mps, told.left_mps - body.left_mps, told.yaw_radps - body.yaw_radps
        self._settled = Twist2(
            body.forward_mps + followed * ahead[0],
            body.left_mps + followed * ahead[1],
            body.yaw_radps + followed * ahead[2],
        )
        squared_s2 = lag_s * min(dt_s, lag_s)
        return Components(*(squared_s2 * part**2 for part in ahead))

    def _straight(self, span_s: tuple[float, float], distance_m: float, late: Components, unseen: Components) -> Motion:
        config, dt_s, step = self.config, span_s[1] - span_s[0], Pose2(distance_m)
        rest_m2 = random_walk((config.rest_sigma, dt_s))
        along_m2 = random_walk((config.distance_sigma, distance_m)) + rest_m2 + late.along
        if config.unmeasured_turn_deg is None:
            sigma_m = math.sqrt(along_m2 + unseen.along)
            return Motion(*span_s, step, information_along((1.0, 0.0, 0.0), sigma_m))
        turn_deg2 = random_walk((config.unmeasured_turn_deg, distance_m), (config.rest_sigma_deg, dt_s))
        across_m2 = random_walk((config.lateral_sigma, distance_m)) + rest_m2
        spread = Spread(along_m2, across_m2, turn_deg2 * math.radians(1.0) ** 2)
        covariance = step_covariance(distance_m, 0.0, spread) + np.diag(unseen)
        return Motion(*span_s, step, information_from_covariance(covariance))


def _is_at_zero(now: Odometry) -> bool:
    pose = now.pose_start_base
    if pose is None:
        return now.distance_m is not None and abs(now.distance_m) < _ZERO
    return max(abs(pose.x), abs(pose.y), abs(pose.theta)) < _ZERO


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
