"""Dead reckoning: integrate motion, and let absolute estimates correct the pose at their own stamp.

With a fix of all three numbers this is Eq. (5) of Nagai & Watanabe: a search that began at ``P_search`` and ended
while the robot was at ``P_found`` gives ``P_corrected = P_search + dT + Rot(dtheta) (P_found - P_search)``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from trailmark.arrays import Floats
from trailmark.estimates import (
    ALL_HEALTHY,
    Applied,
    Belief,
    Estimate,
    Fix,
    Motion,
    PathOffset,
    information_from_covariance,
    information_from_sigmas,
)
from trailmark.estimation.chain import MotionChain, OdomState
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.estimation.history import History
from trailmark.estimation.information import checked_covariance, checked_information, measured_directions
from trailmark.estimation.on_path import offset_on_path
from trailmark.estimation.overlaps import OVERLAPS, TOLD_S
from trailmark.estimation.symmetric import (
    ZERO,
    Sym3,
    add,
    congruence,
    diagonal,
    frozen_matrix,
    subtract,
)
from trailmark.estimation.unmeasured import (
    NOWHERE,
    Sym2,
    describe,
    directions_above,
    longest,
    plus,
    squared_by_direction,
    turned,
)
from trailmark.geometry import Pose2, Twist2
from trailmark.interfaces import Estimator, Session
from trailmark.values import quick_dataclass

if TYPE_CHECKING:
    from trailmark.estimation.corrections import Correction
    from trailmark.paths import Path

__all__ = ["DeadReckoning"]

_ACCEPTED = Applied("accepted")
# A way that motion has not measured for longer is told in the health [s].
_TOLD_AFTER_S = 2.0


@quick_dataclass(frozen=True, slots=True, eq=False)
class _PoseAnchor:
    """The pose after the last correction, and what odometry said there: later motion is carried on from here."""

    odom: OdomState
    pose_map_base: Pose2 | None
    excess: Sym3 = ZERO  # covariance in odom's coordinates, less the spread of odometry until here
    is_measured: bool = False
    unmeasured_m: Sym2 = NOWHERE  # of the error at this anchor, what lasts: by direction in odom

    def unmeasured_at(self, odom: OdomState) -> Sym2:
        """Return how far drift may have carried base unseen, by direction in odom [m]."""
        since_m = plus(odom.unmeasured_m, self.odom.unmeasured_m, -1.0)
        return plus(self.unmeasured_m, since_m, 1.0)

    def pose_alone_at(self, odom: OdomState) -> Pose2 | None:
        """Return the pose where odometry says something else; None while it is unknown."""
        if self.pose_map_base is None:
            return None
        return self.pose_map_base.moved_as(self.odom.pose_odom_base, odom.pose_odom_base)

    def pose_at(self, odom: OdomState) -> tuple[Pose2, Sym3] | None:
        """Return pose and covariance where odometry says something else; None while the pose is unknown."""
        if self.pose_map_base is None:
            return None
        turn = self.pose_map_base.theta - self.odom.pose_odom_base.theta
        cos, sin = math.cos(turn), math.sin(turn)
        x, y = odom.pose_odom_base.x, odom.pose_odom_base.y
        spread = add(self.excess, odom.spread)
        if odom.unmeasured_m is not NOWHERE:
            spread = add(spread, squared_by_direction(self.unmeasured_at(odom)))
        covariance = congruence(spread, cos, sin, -cos * y - sin * x, cos * x - sin * y)
        return self.pose_map_base.moved_as(self.odom.pose_odom_base, odom.pose_odom_base), covariance


class DeadReckoning(Estimator):
    """Integrates the motion of one localizer; absolute estimates replace what they measured.

    Gaps are bridged with the last twist, overlaps counted once. Nothing is weighed against anything: for that there
    are filters. An absolute estimate that comes late corrects the pose at its own stamp and everything after it;
    the result does not depend on the order in which such estimates arrive.

    Parameters
    ----------
    config : DeadReckoningConfig
        Its options.
    poses_alone : bool
        Whether poses are all that will be asked for: a covariance then says nothing, and costs nothing.
    """

    takes_one_motion = True

    def __init__(self, config: DeadReckoningConfig, *, poses_alone: bool = False) -> None:
        super().__init__(config)
        self._config = config
        self._poses_alone = poses_alone

    def start(self, session: Session) -> None:
        """Forget everything; begin at the session's start pose, or nowhere."""
        config = self._config
        drift_mps, drift_radps = config.drift_sigma_mps, math.radians(config.drift_sigma_deg_per_s)
        self._path = session.path
        self._station_m: float | None = None
        self._chain = MotionChain(None if self._poses_alone else Twist2(drift_mps, drift_mps, drift_radps))
        self._corrections: History[Correction, _PoseAnchor] = History(
            config.history_s, self._step, self._start_anchor(session.start_pose)
        )
        self._belief: Belief | None = None
        self._source = ""

    def counters(self) -> Mapping[str, int]:
        """Return how many gaps were bridged and overlaps cut."""
        counts = {"gaps": self._chain.n_gaps, "overlaps": self._chain.n_overlaps}
        return counts | ({f"overlaps.{self._source}": n} if (n := self._chain.n_long_overlaps) else {})

    def apply(self, source: str, estimate: Estimate) -> Applied:
        """Integrate a `Motion`, or correct the pose at the stamp of a `Fix` or `PathOffset`."""
        if not math.isfinite(estimate.stamp_s):
            return Applied("refused", f"the stamp is not finite: {estimate.stamp_s}")
        self._belief = None
        if self._chain.end_s == -math.inf:
            self._chain.hear_of(estimate.stamp_s)
        if isinstance(estimate, Motion):
            self._source = source
            return self._apply_motion(estimate)
        if isinstance(estimate, Fix | PathOffset):
            return self._apply_absolute(estimate)
        self._corrections.advance(estimate.stamp_s)
        return Applied("unused", f"lost: {estimate.reason}")

    def belief(self, stamp_s: float | None = None) -> Belief:
        """Return the belief at a stamp: interpolated in the history, or carried on with the last twist.

        A stamp older than the history gets the oldest belief that is kept, with its own stamp.
        """
        if stamp_s is None:
            stamp_s = self._corrections.newest_s if math.isfinite(self._corrections.newest_s) else 0.0
        elif self._chain.end_s == -math.inf:
            self._chain.hear_of(stamp_s)
        if self._belief is None or self._belief.stamp_s != stamp_s:
            self._belief = self._make_belief(self._chain.at(stamp_s))
        return self._belief

    def poses_at(self, stamp_s: float) -> tuple[float, Pose2 | None, Pose2]:
        """Return what `belief` says of stamp and poses, and nothing else, which is much less work.

        Returns
        -------
        float
            The stamp: `stamp_s`, or that of the oldest state that is kept [s].
        Pose2 or None
            Base in the map; None while unknown.
        Pose2
            Base in odom.
        """
        odom = self._chain.at(stamp_s)
        pose = self._corrections.state_at(odom.stamp_s).pose_alone_at(odom)
        return odom.stamp_s, pose, odom.pose_odom_base

    def set_pose(
        self,
        pose_map_base: Pose2,
        covariance: Floats | None = None,
        stamp_s: float | None = None,
    ) -> Applied:
        """Replace the pose at an instant: a fix of all three numbers."""
        if covariance is None:
            sigma_rad = math.radians(self._config.start_sigma_deg)
            information = information_from_sigmas(self._config.start_sigma_m, self._config.start_sigma_m, sigma_rad)
        else:
            checked = checked_covariance(covariance)
            if isinstance(checked, str):
                return Applied("refused", checked)
            information = information_from_covariance(checked)
        if stamp_s is None:
            stamp_s = self.belief().stamp_s
        return self.apply("set_pose", Fix(stamp_s, pose_map_base, information))

    def _start_anchor(self, start_pose: Pose2 | None) -> _PoseAnchor:
        odom = OdomState(-math.inf)
        if start_pose is None:
            return _PoseAnchor(odom, None)
        variance_m2 = self._config.start_sigma_m**2
        variance_rad2 = math.radians(self._config.start_sigma_deg) ** 2
        return _anchor_at(odom, start_pose, diagonal(variance_m2, variance_m2, variance_rad2), is_measured=False)

    def _apply_motion(self, motion: Motion) -> Applied:
        information = checked_information(motion.information)
        if isinstance(information, str):
            return Applied("refused", information)
        changed_s = self._chain.end_s
        if not self._chain.append(motion, information):
            return self._refuse_known(motion)
        self._corrections.advance(motion.stamp_s)
        self._chain.forget(self._corrections.horizon_s)
        if self._corrections.last_stamp_s > changed_s:  # it was carried on with the last twist: now it is known
            self._corrections.replay(changed_s)
        return _ACCEPTED

    def _refuse_known(self, motion: Motion) -> Applied:
        if motion.stamp_s < self._corrections.horizon_s:
            return self._late(motion)
        return Applied("refused", f"motion is already known until {self._chain.end_s:.6f} s")

    def _apply_absolute(self, estimate: Fix | PathOffset) -> Applied:
        information = checked_information(estimate.information)
        if isinstance(information, str):
            return Applied("refused", information)
        from trailmark.estimation.corrections import correction_by  # motion alone needs none

        correction = correction_by(estimate, measured_directions(information), self._path)
        if isinstance(correction, str):
            return Applied("refused", correction)
        if not correction.measured.rank:
            return Applied("refused", "it has no information")
        anchor = self._corrections.insert(estimate.stamp_s, correction)
        if anchor is None:
            return self._late(estimate)
        self._chain.forget(self._corrections.horizon_s)
        if anchor.pose_map_base is None:
            return Applied("unused", f"the pose is unknown, and this says {correction.measured.rank} of its 3 numbers")
        return _ACCEPTED

    def _late(self, estimate: Motion | Fix | PathOffset) -> Applied:
        age_s = self._corrections.newest_s - estimate.stamp_s
        return Applied("late", f"{age_s:.3f} s old, the history reaches back {self._config.history_s:g} s")

    def _step(self, anchor: _PoseAnchor, stamp_s: float, correction: Correction) -> _PoseAnchor:
        """Return the anchor after a correction: the step of the history."""
        odom = self._chain.at(stamp_s)
        if self._poses_alone:  # no pose depends on what is skipped here
            pose = anchor.pose_alone_at(odom)
            corrected = correction.apply(None if pose is None else (pose, ZERO))
            return anchor if corrected is None else _PoseAnchor(odom, corrected[0], is_measured=True)
        corrected = correction.apply(anchor.pose_at(odom))
        if corrected is None:
            return anchor
        return _anchor_after(anchor, odom, *corrected)

    def _make_belief(self, odom: OdomState) -> Belief:
        anchor = self._corrections.state_at(odom.stamp_s)
        pose, covariance, on_path = None, None, None
        placed = anchor.pose_at(odom)
        if placed is not None:
            pose, covariance = placed[0], frozen_matrix(placed[1])
            on_path = None if self._path is None else self._on_path(odom.stamp_s, self._path, *placed)
        return Belief(
            stamp_s=odom.stamp_s,
            pose_map_base=pose,
            covariance=covariance,
            pose_odom_base=odom.pose_odom_base,
            twist=odom.twist,
            travelled_m=odom.travelled_m,
            on_path=on_path,
            fix_age_m=odom.travelled_m - anchor.odom.travelled_m if anchor.is_measured else math.inf,
            motion_age_s=odom.motion_age_s,
            health=self._health(anchor, odom),
        )

    def _health(self, anchor: _PoseAnchor, odom: OdomState) -> Mapping[str, str]:
        """Return what is wrong with the motion: nothing measures the way in some direction, or it overlaps."""
        is_overlapping = odom.stamp_s - self._chain.overlapped_s <= TOLD_S
        overlaps = {self._source: OVERLAPS} if is_overlapping else ALL_HEALTHY
        if odom.open_s <= _TOLD_AFTER_S:
            return overlaps
        unmeasured_m = anchor.unmeasured_at(odom)
        open_s = min(odom.open_s, longest(unmeasured_m) / self._config.drift_sigma_mps)
        if open_s <= _TOLD_AFTER_S:
            return overlaps
        return {self._source: describe(unmeasured_m, odom.pose_odom_base.theta, open_s)}

    def _on_path(self, stamp_s: float, path: Path, pose: Pose2, covariance: Sym3) -> PathOffset:
        told = offset_on_path(path, pose, covariance, stamp_s=stamp_s, near_station_m=self._station_m)
        self._station_m = told.station_m
        return told


def _anchor_after(before: _PoseAnchor, odom: OdomState, pose: Pose2, covariance: Sym3) -> _PoseAnchor:
    """Return the anchor after a correction: of the error that lasts, what the correction leaves room for."""
    anchor = _anchor_at(odom, pose, covariance, is_measured=True)
    unmeasured_m = before.unmeasured_at(odom)
    most_m = longest(unmeasured_m)
    if most_m <= 0.0:
        return anchor
    turn = odom.pose_odom_base.theta - pose.theta
    xx, xy, yy = turned((covariance[0], covariance[1], covariance[3]), turn)
    along = directions_above(unmeasured_m, 0.5 * most_m)
    across_m2 = along[0] * yy - 2.0 * along[1] * xy + along[2] * xx  # over the determinant: the information along
    left_m2 = max(xx * yy - xy * xy, 0.0) / across_m2 if across_m2 > 0.0 else 0.0
    kept_m = plus(NOWHERE, unmeasured_m, min(1.0, math.sqrt(left_m2) / most_m))
    return replace(anchor, excess=subtract(anchor.excess, squared_by_direction(kept_m)), unmeasured_m=kept_m)


def _anchor_at(odom: OdomState, pose: Pose2, covariance: Sym3, is_measured: bool) -> _PoseAnchor:
    """Return the anchor of a pose in the map, with its covariance there, at the place that odometry gives."""
    turn = pose.theta - odom.pose_odom_base.theta
    cos, sin = math.cos(turn), math.sin(turn)
    x, y = odom.pose_odom_base.x, odom.pose_odom_base.y
    spread = congruence(covariance, cos, -sin, y, -x)  # the inverse of what `_PoseAnchor.pose_at` does
    return _PoseAnchor(odom, pose, excess=subtract(spread, odom.spread), is_measured=is_measured)
