"""The fixed-lag smoother: all poses of the last seconds are estimated together, whenever one of them is measured."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import ALL_HEALTHY, Applied, Belief, Estimate, Fix, Lost, Motion, PathOffset
from trailmark.estimation.chain import OdomState
from trailmark.estimation.information import checked_covariance
from trailmark.estimation.kalman.clock import ClockGuard, gap_of_jump_s
from trailmark.estimation.kalman.measurements import Measurement, fix_measurement, path_measurement
from trailmark.estimation.kalman.motions import StatedMotion
from trailmark.estimation.kalman.odometry import PublishedOdometry
from trailmark.estimation.kalman.state import OdometryState
from trailmark.estimation.kalman.trust import Trust
from trailmark.estimation.on_path import offset_on_path
from trailmark.estimation.overlaps import OVERLAPS, TOLD_ALREADY, TOLD_S
from trailmark.estimation.smoother.health import SourceRecord, contradiction_of, health_of
from trailmark.estimation.smoother.motion_line import MotionLine
from trailmark.estimation.smoother.window import Window
from trailmark.estimation.smoother_config import SmootherConfig
from trailmark.estimation.symmetric import Sym3, frozen_matrix, scaled, to_matrix
from trailmark.geometry import Pose2
from trailmark.interfaces import Estimator, Session

__all__ = ["Smoother"]

# Half the way around the Earth.
_FARTHEST_M = 2e7


class Smoother(Estimator):
    """A fixed-lag smoother of the planar pose, for any mix of localizers.

    Motion between two instants that were measured is one relation, whoever told it and however late; absolute
    estimates are relations to the map that lose weight where they do not fit. Gauss-Newton finds the poses of the whole
    window; a decision on an outlier is open for as long as it is in the window.

    Parameters
    ----------
    config : SmootherConfig
        Its options.
    """

    config: SmootherConfig

    def __init__(self, config: SmootherConfig) -> None:
        super().__init__(config)

    def start(self, session: Session) -> None:
        """Forget everything; begin at the session's start pose, or nowhere."""
        config = self.config
        self._path = session.path
        self._station_m: float | None = None
        gate = None if config.gate == "off" else config.gate
        floors = config.floor_m, math.radians(config.floor_deg)
        self._trust = Trust(gate, "none", config.timeout_s, 1.0, floors, None)
        self._clock = ClockGuard(config.time_jump_s, config.time_jump_after)
        self._records: dict[str, SourceRecord] = {}
        self._counted: Counter[str] = Counter()
        self._odometry = PublishedOdometry()
        self._belief: Belief | None = None
        self._begin()
        if session.start_pose is not None:
            self._open_window(-math.inf, session.start_pose.array(), self._start_covariance())

    def counters(self) -> Mapping[str, int]:
        """Return what was refused, and how often the poses were sought anew."""
        overlaps = {f"overlaps.{source}": n for source, n in self._line.motions.n_overlaps().items()}
        return {
            **self._counted,
            **overlaps,
            "recoveries": self._n_sought + (self._window.n_sought if self._window else 0),
        }

    def apply(self, source: str, estimate: Estimate) -> Applied:
        """Use an estimate and return what became of it: the verdict of the moment, which a later one may turn."""
        record = self._records.setdefault(source, SourceRecord())
        self._belief = None
        applied = self._check_stamp(source, estimate)
        if applied.status == "refused":
            record.record_refusal(applied.reason)
        elif applied.status != "late":
            record.record_arrival(estimate.stamp_s)
        return applied

    def set_pose(self, pose_map_base: Pose2, covariance: Floats | None = None, stamp_s: float | None = None) -> Applied:
        """Replace the belief at an instant; what was said about later ones counts from there."""
        checked = self._start_covariance() if covariance is None else checked_covariance(covariance)
        if isinstance(checked, str):
            return self._refuse("set_pose", checked)
        stamp_s = self._newest_s if stamp_s is None else stamp_s
        is_elsewhere = self._newest_s > -math.inf and abs(stamp_s - self._newest_s) > self.config.time_jump_s
        if is_elsewhere or (not math.isfinite(stamp_s) and self._newest_s > -math.inf):
            return self._refuse("set_pose", f"the stamp {stamp_s:g} s is of another time")
        if stamp_s < self._newest_s - self.config.lag_s:
            return Applied("late", f"the window reaches back {self.config.lag_s:g} s")
        self._belief = None
        self._counted["poses_set"] += 1
        if self._window is None or stamp_s == -math.inf:
            self._open_window(stamp_s, pose_map_base.array(), checked)
        elif stamp_s < self._window.begin_s:
            return Applied("late", "a pose was told of a later instant")
        else:
            self._window.restart(stamp_s, pose_map_base.array(), checked)
        for record in self._records.values():
            record.forgive()
        if stamp_s > -math.inf:
            self._advance(stamp_s)
        return Applied("accepted")

    def belief(self, stamp_s: float | None = None) -> Belief:
        """Return the belief at a stamp: that of the window, carried on by the motion since.

        Of a past stamp it is smoothed: what was said later is in it. A stamp older than the window gets the oldest
        belief that is kept, with its own stamp.
        """
        if stamp_s is None:
            stamp_s = self._newest_s if math.isfinite(self._newest_s) else 0.0
        belief = self._belief
        if belief is None or belief.stamp_s != stamp_s:
            belief = self._belief = self._make_belief(stamp_s)
        return belief

    def _begin(self) -> None:
        self._line = MotionLine(self.config)
        self._window: Window | None = None
        self._newest_s = self._kept_since_s = -math.inf
        self._n_sought = 0

    def _open_window(self, stamp_s: float, pose: Floats, covariance: Floats) -> None:
        self._window = Window(self._line, self.config, stamp_s, (pose, covariance))

    def _start_covariance(self) -> Floats:
        sigma_m, sigma_rad = self.config.start_sigma_m, math.radians(self.config.start_sigma_deg)
        return np.diag([sigma_m**2, sigma_m**2, sigma_rad**2])

    def _check_stamp(self, source: str, estimate: Estimate) -> Applied:
        stamp_s, newest_s = estimate.stamp_s, self._newest_s
        if not math.isfinite(stamp_s):
            return self._refuse("stamp", f"the stamp is not finite: {stamp_s}")
        place = self._clock.classify(stamp_s, newest_s)
        if place == "elsewhere":
            return self._refuse("time_jump", f"the clock jumped by {stamp_s - newest_s:+.3f} s")
        if place == "reset":
            self._restart_clock(stamp_s)
        elif stamp_s < newest_s - self.config.lag_s:
            self._counted["late"] += 1
            message = f"{newest_s - stamp_s:.3f} s old, the window reaches back {self.config.lag_s:g} s"
            return Applied("late", message)
        return self._dispatch(source, estimate)

    def _dispatch(self, source: str, estimate: Estimate) -> Applied:
        if isinstance(estimate, Lost):
            self._advance(estimate.stamp_s)
            return Applied("unused", f"lost: {estimate.reason}")
        information = self._trust.floored_information(estimate, self._counted)
        if isinstance(information, str):
            return Applied("refused", information)
        if isinstance(estimate, Motion):
            return self._apply_motion(source, estimate, StatedMotion(estimate, information))
        if isinstance(estimate, Fix):
            x_m, y_m = estimate.pose_map_base.x, estimate.pose_map_base.y
            if not (abs(x_m) <= _FARTHEST_M and abs(y_m) <= _FARTHEST_M):
                return self._refuse("too_far", f"({x_m:.3g}, {y_m:.3g}) m is no place on Earth")
            return self._apply_absolute(estimate.stamp_s, fix_measurement(source, estimate, information, self._trust))
        if self._path is None:
            return self._refuse("no_path", "a path offset needs a path, and this run has none")
        if not math.isfinite(estimate.station_m + estimate.lateral_m + estimate.heading_rad):
            return self._refuse("not_finite", "the path offset is not finite")
        measurement = path_measurement(source, estimate, information, self._trust, self._path)
        return self._apply_absolute(estimate.stamp_s, measurement)

    def _apply_motion(self, source: str, motion: Motion, stated: StatedMotion) -> Applied:
        if not math.isfinite(motion.since_s) or motion.stamp_s - motion.since_s > self.config.time_jump_s:
            return self._refuse("time_jump", f"a motion over {motion.stamp_s - motion.since_s:g} s: the clock jumped")
        pose = motion.pose_since_now
        speed_mps = math.hypot(pose.x, pose.y) / (motion.stamp_s - motion.since_s)
        if not speed_mps <= self.config.max_speed_mps:
            return self._refuse("too_fast", f"a motion of {speed_mps:.3g} m/s: see max_speed_mps")
        changed_s = self._line.add(source, stated)
        if changed_s is None:
            return self._refuse("duplicate", "it has told of the same interval already")
        self._odometry.note_change(changed_s)
        if self._window is not None:
            self._window.note_motion(changed_s)
        self._advance(motion.stamp_s)
        if not self._line.motions.uses(source, stated):
            return Applied("unused", TOLD_ALREADY)
        if self._line.leaves_out(source, motion.stamp_s):
            return Applied("gated", "its motion contradicts that of others, or the velocity before")
        return Applied("accepted")

    def _apply_absolute(self, stamp_s: float, measurement: Measurement) -> Applied:
        window = self._window
        if window is None:
            start = measurement.as_start()
            self._advance(stamp_s)
            if start is None:
                dof = len(measurement.root)
                return Applied("unused", f"the pose is unknown, and this says {dof} of its 3 numbers", None, dof)
            self._open_window(stamp_s, *start)
            return Applied("accepted", "the pose was unknown: it begins here", None, 3)
        if stamp_s < window.begin_s:
            self._counted["late"] += 1
            return Applied("late", "it is about an instant before the pose was known")
        if window.has(measurement, stamp_s):
            return self._refuse("duplicate", "it has told the same already")
        n_before = window.n_of(measurement.source, stamp_s)
        if n_before >= self.config.max_per_stamp:
            return self._refuse("stuck_stamp", f"{n_before} estimates of one instant: does its clock stand still?")
        verdict = window.insert(stamp_s, measurement)
        self._advance(stamp_s)
        record = self._records[measurement.source]
        record.record_verdict(stamp_s, verdict.is_accepted, verdict.nis / verdict.dof)
        if verdict.is_accepted:
            return Applied("accepted", "", verdict.nis, verdict.dof)
        if record.n_rejected % self.config.recover_after == 0 and window.seek_elsewhere():
            for each in self._records.values():
                each.forgive()
            return Applied("accepted", "the poses were sought anew", verdict.nis, verdict.dof)
        reason = f"NIS {verdict.nis:.1f} of {verdict.dof} dof against the window"
        return Applied("gated", reason, verdict.nis, verdict.dof)

    def _refuse(self, what: str, reason: str) -> Applied:
        self._counted[f"refused_{what}"] += 1
        return Applied("refused", reason)

    def _advance(self, stamp_s: float) -> None:
        """Let time go on; what has left the window is eliminated once in a while."""
        self._newest_s = max(self._newest_s, stamp_s)
        self._line.begin(stamp_s)
        horizon_s = self._newest_s - self.config.lag_s
        if horizon_s < self._kept_since_s + 0.1 * self.config.lag_s:
            return
        self._kept_since_s = horizon_s
        if self._window is not None:
            self._window.forget(horizon_s)
        else:
            self._line.forget(horizon_s)

    def _restart_clock(self, stamp_s: float) -> None:
        """Begin anew at any time, where the belief was, as uncertain as after a gap."""
        self._counted["time_resets"] += 1
        self._rejoin()
        pose, travelled_m = self._odometry.publish(_published(self._line.at(self._newest_s)), self._newest_s)
        gap_s = gap_of_jump_s(stamp_s - self._newest_s)
        last = None if self._window is None else self._window.predict(self._newest_s + gap_s)
        before = None if self._window is None else self._window.predict(self._newest_s)
        n_sought = self._n_sought + (self._window.n_sought if self._window else 0)
        self._begin()
        self._n_sought = n_sought
        self._odometry = PublishedOdometry.continue_from(pose, travelled_m, _published(OdomState(0.0)))
        if last is not None and before is not None:
            self._open_window(-math.inf, before.pose.array(), to_matrix(last.covariance))
        for record in self._records.values():
            record.restart_clock(stamp_s)

    def _rejoin(self) -> None:
        if self._odometry.is_doubtful:
            self._odometry.rejoin(_published(self._line.at(self._odometry.last_s)))

    def _make_belief(self, stamp_s: float) -> Belief:
        self._rejoin()
        predicted = None if self._window is None else self._window.predict(stamp_s)
        odometry = self._line.at(stamp_s) if predicted is None else predicted.odometry
        at_s = stamp_s if predicted is None else odometry.stamp_s
        pose_odom_base, travelled_m = self._odometry.publish(_published(odometry), at_s)
        covariance, on_path, fix_age_m = None, None, math.inf
        if predicted is not None and self._window is not None:
            factor = contradiction_of(self._records, self._newest_s, self.config.timeout_s)
            doubted = scaled(predicted.covariance, factor)
            covariance, on_path = frozen_matrix(doubted), self._on_path(at_s, predicted.pose, doubted)
            fix_age_m = odometry.travelled_m - self._window.fixed_at_m(at_s)
        return Belief(
            stamp_s=at_s,
            pose_map_base=None if predicted is None else predicted.pose,
            covariance=covariance,
            pose_odom_base=pose_odom_base,
            twist=odometry.twist,
            travelled_m=travelled_m,
            on_path=on_path,
            fix_age_m=fix_age_m,
            motion_age_s=odometry.motion_age_s,
            health=self._health(at_s),
        )

    def _health(self, stamp_s: float) -> Mapping[str, str]:
        health = health_of(self._records, stamp_s, self.config.timeout_s)
        for source in self._line.motions.overlapping(stamp_s - TOLD_S):
            health.setdefault(source, OVERLAPS)
        return health or ALL_HEALTHY

    def _on_path(self, stamp_s: float, pose: Pose2, covariance: Sym3) -> PathOffset | None:
        if self._path is None:
            return None
        told = offset_on_path(self._path, pose, covariance, stamp_s=stamp_s, near_station_m=self._station_m)
        self._station_m = told.station_m
        return told


def _published(odometry: OdomState) -> OdometryState:
    return OdometryState(
        odometry.pose_odom_base, odometry.travelled_m, odometry.twist, is_measured=odometry.motion_age_s == 0.0
    )
