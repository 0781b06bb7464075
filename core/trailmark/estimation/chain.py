"""Odometry: one motion after the other, without a jump."""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import replace

from trailmark.estimates import Motion
from trailmark.estimation.information import says_something
from trailmark.estimation.overlaps import LONG_OVERLAP, unevenness
from trailmark.estimation.symmetric import (
    ZERO,
    Sym3,
    add,
    congruence,
    diagonal,
    inverse,
    scaled,
    subtract,
)
from trailmark.estimation.unmeasured import NOWHERE, Sym2, plus, projected, speed_variance, turned, unmeasured_in
from trailmark.geometry import Pose2, Twist2
from trailmark.values import quick_dataclass

__all__ = ["MotionChain", "OdomState", "carry", "interpolate"]

# Stamps this close are one instant: they went through decimals on their way.
_SAME_INSTANT_S = 1e-6
# A motion measures what it knows better than a velocity that keeps its direction for so long [s].
_LASTS_S = 1.0
# No run is silent for so long: an instant later than that is of another clock [s].
_TIME_JUMP_S = 60.0


@quick_dataclass(frozen=True, slots=True, eq=False)
class OdomState:
    """Where motion alone has carried base.

    Attributes
    ----------
    stamp_s : float
        The instant it is about [s].
    pose_odom_base : Pose2
        Base where motion has carried it from the start.
    travelled_m : float
        Length of the way [m].
    spread : Sym3
        Covariance of the accumulated error, as a small motion (x, y, theta) of all space about the origin of odom:
        in these coordinates the errors of successive motions just add up, and those between two stamps are a
        difference.
    twist : Twist2
        Velocity in base axes.
    motion_age_s : float
        Time since the last measured motion; ``inf`` before the first [s].
    unmeasured_m : Sym2
        How far drift may have carried base where motions did not measure, by direction in odom, added up from the
        start: an unknown speed lasts, so these are standard deviations that add up [m].
    open_s : float
        How long, in a row, motions have left a direction of the way open [s].
    is_rest : bool
        Whether the way from the state before is the rest of a motion that began earlier: `twist` is that of all of it.
    """

    stamp_s: float
    pose_odom_base: Pose2 = Pose2()
    travelled_m: float = 0.0
    spread: Sym3 = ZERO
    twist: Twist2 = Twist2()
    motion_age_s: float = math.inf
    unmeasured_m: Sym2 = NOWHERE
    open_s: float = 0.0
    is_rest: bool = False


class MotionChain:
    """The motions of a window of time, each beginning where the last one ended.

    A gap is bridged with the last twist. A motion that overlaps the chain goes on from where the chain has its
    beginning, so that no time counts twice. The chain only grows at its end.

    Parameters
    ----------
    drift : Twist2 or None
        Standard deviation of the velocity while nothing measures it [m/s, m/s, rad/s]. None: nobody asks how uncertain
        the way is, and its covariance stays zero.

    Attributes
    ----------
    end_s : float
        Stamp until which motion is known; ``-inf`` before the first [s].
    n_gaps, n_overlaps : int
        Gaps that were bridged, and motions that were cut because they overlap.
    n_long_overlaps : int
        Of these, those by more than inexact stamps make.
    overlapped_s : float
        End of the last of them; ``-inf`` if there is none [s].
    """

    def __init__(self, drift: Twist2 | None) -> None:
        self._drift = ZERO if drift is None else diagonal(drift.forward_mps**2, drift.left_mps**2, drift.yaw_radps**2)
        self._stamps: list[float] = []
        self._states: list[OdomState] = []  # motion_age_s is 0, or at the end of a bridge its length
        self._is_whole = True
        self._begun_s, self._heard_s = math.inf, -math.inf
        self.end_s = -math.inf
        self.n_gaps = 0
        self.n_overlaps = self.n_long_overlaps = 0
        self.overlapped_s = -math.inf

    def hear_of(self, stamp_s: float) -> None:
        """Take note of an instant of the run: where base began is known at the first, and for a second more."""
        if stamp_s - self._heard_s > _TIME_JUMP_S:  # the first, or of another clock
            self._begun_s = stamp_s
        self._heard_s = max(self._heard_s, stamp_s)

    def append(self, motion: Motion, information: Sym3) -> bool:
        """Add a motion with its checked information; False if it ends before the chain does."""
        since_s, stamp_s, end_s = motion.since_s, motion.stamp_s, self.end_s
        if stamp_s <= end_s + _SAME_INSTANT_S:
            return False
        dt_s, step = stamp_s - since_s, motion.pose_since_now
        forward_m, left_m, turn_rad = step.log()
        twist = Twist2(forward_m / dt_s, left_m / dt_s, turn_rad / dt_s)
        covariance, open_ways = ZERO, NOWHERE
        if self._drift is not ZERO:
            covariance, open_ways = self._covariance(information, dt_s)
        is_overlapping = since_s < end_s - _SAME_INSTANT_S
        if not self._stamps:
            self._stamps.append(since_s)
            self._states.append(replace(self._stood_until(since_s), twist=twist, motion_age_s=0.0))
        elif since_s > end_s + _SAME_INSTANT_S:
            self.n_gaps += 1
            bridge = self._coast(since_s)
            self._stamps.append(since_s)
            self._states.append(bridge)
        elif is_overlapping:
            self.n_overlaps += 1
            if end_s - since_s > LONG_OVERLAP * dt_s:
                self.n_long_overlaps += 1
                self.overlapped_s = stamp_s
            step, covariance = self._rest_of(motion, twist, covariance)
        before = self._states[-1]
        after = carry(before, stamp_s, step, twist, covariance)
        if is_overlapping:
            after = replace(after, is_rest=True)
        if open_ways is not NOWHERE:
            after = self._with_open_ways(after, before, open_ways)
        self._stamps.append(stamp_s)
        self._states.append(after)
        self.end_s = stamp_s
        return True

    def at(self, stamp_s: float) -> OdomState:
        """Return the state at a stamp: interpolated, or carried on with the last twist.

        Before the first motion base stands at the origin. Stamps older than what is kept get the oldest state that is.
        """
        index = bisect_left(self._stamps, stamp_s)
        if index == len(self._stamps):
            return self._coast(stamp_s) if index else self._stood_until(stamp_s)
        end = self._states[index]
        if end.stamp_s == stamp_s:
            return end
        if index == 0:
            return self._stood_until(stamp_s) if self._is_whole else end
        return interpolate(self._states[index - 1], end, stamp_s)

    def _stood_until(self, stamp_s: float) -> OdomState:
        """Return the state before the first motion: at the origin, where it may have driven on unseen."""
        driven_s = stamp_s - (self._begun_s + _LASTS_S)
        if self._drift is ZERO or driven_s <= 0.0:
            return OdomState(stamp_s)
        return OdomState(stamp_s, spread=scaled(self._drift, driven_s * driven_s))

    def forget(self, horizon_s: float) -> None:
        """Drop the states before `horizon_s`, but for the one that is needed to interpolate there."""
        n_old = bisect_left(self._stamps, horizon_s) - 1
        if n_old > 0:
            self._is_whole = False
            del self._stamps[:n_old], self._states[:n_old]

    def _rest_of(self, motion: Motion, twist: Twist2, covariance: Sym3) -> tuple[Pose2, Sym3]:
        """Return what a motion adds to the chain that reaches beyond its beginning, and its covariance.

        Base is at its end where the motion has it, as seen from where the chain has its beginning.
        """
        since_s, last = motion.since_s, self._states[-1]
        remaining_s = motion.stamp_s - last.stamp_s
        covariance = scaled(covariance, remaining_s / (motion.stamp_s - since_s)) if covariance is not ZERO else ZERO
        if since_s < self._stamps[0]:  # that is forgotten: the motion is taken as even
            return twist.after(remaining_s), covariance
        end = last.pose_odom_base.between(self.at(since_s).pose_odom_base @ motion.pose_since_now)
        index = bisect_left(self._stamps, since_s - _SAME_INSTANT_S)
        if covariance is ZERO or self._stamps[index] <= since_s + _SAME_INSTANT_S:
            return end, covariance
        cut, began_s = self._states[index], self._stamps[index - 1]
        lengths_s = since_s - began_s, cut.stamp_s - since_s
        return end, add(covariance, unevenness(*lengths_s, twist=cut.twist, next_twist=twist, drift=self._drift))

    def _covariance(self, information: Sym3, dt_s: float) -> tuple[Sym3, Sym2]:
        """Return the covariance of a motion, and the directions of base in which it measured no way.

        A direction that was not measured drifts as in a gap.
        """
        covariance = inverse(information)
        drift = scaled(self._drift, dt_s * dt_s)
        if covariance is not None and says_something(covariance, drift):
            return covariance, NOWHERE
        slow = scaled(self._drift, dt_s * _LASTS_S)
        open_ways = unmeasured_in(_with_floor(information, slow), slow)
        return _without_ways(_with_floor(information, drift), open_ways), open_ways

    def _with_open_ways(self, after: OdomState, before: OdomState, open_ways: Sym2) -> OdomState:
        dt_s = after.stamp_s - before.stamp_s
        way_m = math.sqrt(self._drift[0]) * dt_s
        unmeasured_m = plus(before.unmeasured_m, turned(open_ways, before.pose_odom_base.theta), way_m)
        return replace(after, unmeasured_m=unmeasured_m, open_s=before.open_s + dt_s)

    def _coast(self, stamp_s: float) -> OdomState:
        last = self._states[-1]
        dt_s = stamp_s - last.stamp_s
        drift = ZERO if self._drift is ZERO else scaled(self._drift, dt_s * dt_s)
        if drift is not ZERO and dt_s > _LASTS_S:  # it may have stopped, or driven in a circle
            speed_mps = math.hypot(last.twist.forward_mps, last.twist.left_mps)
            more_m2 = (speed_variance(self._drift, speed_mps) - self._drift[0]) * (dt_s - _LASTS_S) ** 2
            drift = add(drift, diagonal(more_m2, more_m2, 0.0))
        return carry(last, stamp_s, last.twist.after(dt_s), last.twist, drift, motion_age_s=dt_s)


def _with_floor(information: Sym3, drift: Sym3) -> Sym3:
    floor = inverse(drift)
    return (floor and inverse(add(information, floor))) or drift


def _without_ways(covariance: Sym3, ways: Sym2) -> Sym3:
    """Return a covariance without some directions: their error is counted as one that lasts."""
    if ways is NOWHERE:
        return covariance
    xx, xy, xt, yy, yt, tt = covariance
    a, b, c = 1.0 - ways[0], -ways[1], 1.0 - ways[2]
    kept_xx, kept_xy, kept_yy = projected((xx, xy, yy), (a, b, c))
    return kept_xx, kept_xy, a * xt + b * yt, kept_yy, b * xt + c * yt, tt


def carry(
    before: OdomState, stamp_s: float, step: Pose2, twist: Twist2, covariance: Sym3, motion_age_s: float = 0.0
) -> OdomState:
    """Return the state after a motion whose x, y, theta have this covariance (first order)."""
    start, spread = before.pose_odom_base, before.spread
    cos, sin = math.cos(start.theta), math.sin(start.theta)
    x, y = start.x + cos * step.x - sin * step.y, start.y + sin * step.x + cos * step.y
    if covariance is not ZERO:
        spread = add(spread, congruence(covariance, cos, sin, y, -x))
    dt_s = stamp_s - before.stamp_s
    return OdomState(
        stamp_s,
        Pose2(x, y, start.theta + step.theta),
        before.travelled_m + math.hypot(twist.forward_mps, twist.left_mps) * dt_s,
        spread,
        twist,
        motion_age_s,
        before.unmeasured_m,
        before.open_s if motion_age_s else 0.0,
    )


def interpolate(start: OdomState, end: OdomState, stamp_s: float) -> OdomState:
    """Return the state at a stamp between two, by the twist with which the second was reached."""
    dt_s = stamp_s - start.stamp_s
    fraction = dt_s / (end.stamp_s - start.stamp_s)
    spread = add(start.spread, scaled(subtract(end.spread, start.spread), fraction))
    unmeasured_m = end.unmeasured_m
    if unmeasured_m is not start.unmeasured_m:
        unmeasured_m = plus(start.unmeasured_m, plus(unmeasured_m, start.unmeasured_m, -1.0), fraction)
    step = end.twist.after(dt_s)
    if end.is_rest:
        step = Pose2.exp(*(fraction * part for part in start.pose_odom_base.between(end.pose_odom_base).log()))
    return OdomState(
        stamp_s,
        start.pose_odom_base @ step,
        start.travelled_m + fraction * (end.travelled_m - start.travelled_m),
        spread,
        end.twist,
        dt_s if end.motion_age_s else 0.0,
        unmeasured_m,
        end.open_s,
    )
