"""Where motion alone has carried base, from what any number of localizers say, in whatever order it comes.

Motions of several localizers are cut at each other's ends and weighed by their information, as `kalman` does
(`trailmark.estimation.kalman.motions`, `weighing`); the steps are added up once, and the motion between any two stamps
with its covariance is a difference. This is preintegration: absolute estimates do not change it.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from dataclasses import replace

from trailmark.estimation.chain import OdomState, carry, interpolate
from trailmark.estimation.kalman.gaps import drift_of
from trailmark.estimation.kalman.motions import Motions, StatedMotion
from trailmark.estimation.kalman.weighing import StepSelection, fuse_steps, replace_impossible_jump, select_steps
from trailmark.estimation.smoother_config import SmootherConfig
from trailmark.estimation.symmetric import Sym3, add, congruence, scaled, subtract
from trailmark.estimation.unmeasured import EVERYWHERE, plus, speed_variance, squared_by_direction
from trailmark.geometry import Pose2, Twist2

__all__ = ["MotionLine", "relative_motion"]

_SAME_INSTANT_S = 1e-9
_AT_REST = Twist2()


class MotionLine:
    """Odometry of a window of time; a motion that comes late changes it from its beginning on.

    In a gap the last twist is held for ``coast_s``, from there on base is taken to stand. The variance of the way is
    ``drift^2 gap^2``, because an unknown speed lasts; after ``coast_s`` that of the last speed, if it was faster.

    Parameters
    ----------
    config : SmootherConfig
        Of the estimator.
    """

    def __init__(self, config: SmootherConfig) -> None:
        self._coast_s = config.coast_s
        self._is_independent = config.motions == "independent"
        self._gate = None if config.gate == "off" else config.gate
        self._drift = drift_of(config)
        self._motions = Motions(self._drift)
        self._stamps: list[float] = []
        self._states: list[OdomState] = []
        self._left_out: dict[float, tuple[str, ...]] = {}
        self._is_whole = True

    @property
    def end_s(self) -> float:
        """Stamp until which motion is known; ``-inf`` before the first [s]."""
        return self._stamps[-1] if self._stamps else -math.inf

    @property
    def motions(self) -> Motions:
        """What was told."""
        return self._motions

    def begin(self, stamp_s: float) -> None:
        """Let base drift from a stamp on if nothing is known of it yet: whoever is heard of first may be on the way."""
        if not self._stamps:
            self._append(OdomState(stamp_s))

    def add(self, source: str, motion: StatedMotion) -> float | None:
        """Take a motion and return the stamp since which odometry has changed [s].

        That is before the motion begins, where the line had no state at its beginning. None if this localizer has told
        of the same interval already.
        """
        if not self._motions.add(source, motion):
            return None
        end_s = max(self.end_s, motion.stamp_s)
        if not self._stamps or (self._is_whole and motion.since_s < self._stamps[0]):
            self._stamps, self._states = [motion.since_s], [OdomState(motion.since_s)]
        n_kept = max(1, bisect_right(self._stamps, motion.since_s))
        del self._stamps[n_kept:], self._states[n_kept:]
        begin_s = self._stamps[-1]
        for cut_s in [*self._motions.cuts(begin_s, end_s), end_s]:
            self._extend(cut_s)
        return begin_s

    def leaves_out(self, source: str, stamp_s: float) -> bool:
        """Return whether a localizer's motion that ends at a stamp contradicted the others."""
        return source in self._left_out.get(stamp_s, ())

    def at(self, stamp_s: float) -> OdomState:
        """Return odometry at a stamp: interpolated, or carried on with the last twist.

        Before `begin` and the first motion base stands at the origin. Stamps older than what is kept get the oldest
        state that is.
        """
        index = bisect_left(self._stamps, stamp_s)
        if index == len(self._stamps):
            return self._coasted(self._states[-1], stamp_s)[-1] if index else OdomState(stamp_s)
        end = self._states[index]
        if end.stamp_s == stamp_s:
            return end
        if index == 0:
            return OdomState(stamp_s) if self._is_whole else end
        return interpolate(self._states[index - 1], end, stamp_s)

    def forget(self, horizon_s: float) -> None:
        """Drop what lies before a stamp, but for the state that is needed to interpolate there."""
        n_old = bisect_left(self._stamps, horizon_s) - 1
        if n_old > 0:
            self._is_whole = False
            del self._stamps[:n_old], self._states[:n_old]
            self._motions.forget(self._stamps[0])
            self._left_out = {at: names for at, names in self._left_out.items() if at >= self._stamps[0]}

    def _extend(self, stamp_s: float) -> None:
        last = self._states[-1]
        dt_s = stamp_s - last.stamp_s
        if dt_s < _SAME_INSTANT_S:
            return
        steps = self._motions.steps(last.stamp_s, stamp_s)
        if not steps:
            for state in self._coasted(last, stamp_s):
                self._append(state)
            return
        selection = StepSelection(steps)
        if len(steps) > 1:
            drift = scaled(self._drift, dt_s * dt_s)
            selection = select_steps(steps, dt_s, last.twist, drift, lambda _: self._gate)
        elif self._gate is not None and len(self._stamps) > 1 and last.motion_age_s == 0.0:
            selection = replace_impossible_jump(steps, dt_s, last.twist)
        if selection.left_out:
            self._left_out[stamp_s] = selection.left_out
        else:
            self._left_out.pop(stamp_s, None)
        drift = scaled(self._drift, dt_s * self._coast_s)
        step, _ = fuse_steps([one for _, one in selection.steps], dt_s, last.twist, drift, self._is_independent)
        assert step.covariance is not None
        self._append(carry(last, stamp_s, Pose2(step.x, step.y, step.turn), step.twist, step.covariance))

    def _append(self, state: OdomState) -> None:
        self._stamps.append(state.stamp_s)
        self._states.append(state)

    def _coasted(self, last: OdomState, stamp_s: float) -> list[OdomState]:
        """Return the state at a stamp that nothing measured, after that at which the last twist is given up, if any."""
        left_s = self._coast_s - last.motion_age_s
        if not 0.0 < left_s < stamp_s - last.stamp_s:
            return [self._coast(last, stamp_s)]
        given_up = self._coast(last, last.stamp_s + left_s)
        return [given_up, self._coast(given_up, stamp_s)]

    def _coast(self, last: OdomState, stamp_s: float) -> OdomState:
        begin_s = last.motion_age_s if math.isfinite(last.motion_age_s) else 0.0
        end_s = begin_s + stamp_s - last.stamp_s
        held_s = min(end_s, self._coast_s) - min(begin_s, self._coast_s)
        noise = scaled(self._drift, self._unmeasured(end_s) - self._unmeasured(begin_s))
        twist = last.twist if held_s > 0.0 else _AT_REST
        after = carry(last, stamp_s, last.twist.after(held_s), twist, noise, end_s)
        if end_s <= self._coast_s:
            return after
        speed_mps = math.hypot(last.twist.forward_mps, last.twist.left_mps)
        way_m = math.sqrt(speed_variance(self._drift, speed_mps)) * (stamp_s - last.stamp_s - held_s)
        return replace(after, unmeasured_m=plus(last.unmeasured_m, EVERYWHERE, way_m))

    def _unmeasured(self, gap_s: float) -> float:
        """Return the variance of the way in a gap, for a unit drift [s^2]."""
        coast_s = self._coast_s
        return gap_s * gap_s if gap_s < coast_s else coast_s * (2.0 * gap_s - coast_s)


def relative_motion(first: OdomState, second: OdomState) -> tuple[Pose2, Sym3]:
    """Return the pose at a later state as seen from an earlier one, and the covariance of its x, y and theta."""
    before, after = first.pose_odom_base, second.pose_odom_base
    cos, sin = math.cos(before.theta), -math.sin(before.theta)
    x, y = after.x, after.y
    spread = subtract(second.spread, first.spread)
    if second.unmeasured_m is not first.unmeasured_m:
        spread = add(spread, squared_by_direction(plus(second.unmeasured_m, first.unmeasured_m, -1.0)))
    return before.between(after), congruence(spread, cos, sin, -cos * y - sin * x, cos * x - sin * y)
