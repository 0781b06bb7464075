"""The Kalman estimator: motion predicts, absolute estimates correct, and what comes late is put where it belongs."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import ALL_HEALTHY, Applied, Belief, Estimate, Fix, Lost, Motion
from trailmark.estimation.information import checked_covariance
from trailmark.estimation.kalman.belief_places import BeliefPlaces
from trailmark.estimation.kalman.clock import ClockGuard, gap_of_jump_s
from trailmark.estimation.kalman.clock_offsets import TimeOffset
from trailmark.estimation.kalman.correction import Filter
from trailmark.estimation.kalman.ekf import Ekf
from trailmark.estimation.kalman.health import SourceMonitor, health_of
from trailmark.estimation.kalman.lasting_errors import UNAFFECTED, LastingPrior
from trailmark.estimation.kalman.layout import Layout
from trailmark.estimation.kalman.measurements import (
    Measurement,
    fix_measurement,
    path_measurement,
    pose_measurement,
)
from trailmark.estimation.kalman.motions import StatedMotion
from trailmark.estimation.kalman.odometry import PublishedOdometry
from trailmark.estimation.kalman.parting import PartingLog
from trailmark.estimation.kalman.plausibility import fix_refusal, motion_refusal, offset_refusal
from trailmark.estimation.kalman.source_learning import SourceLearning
from trailmark.estimation.kalman.state import FilterState, Gaussian
from trailmark.estimation.kalman.timeline import Timeline
from trailmark.estimation.kalman.trust import Trust
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.overlaps import OVERLAPS, TOLD_ALREADY, TOLD_S
from trailmark.geometry import Pose2
from trailmark.interfaces import Estimator, Session

__all__ = ["Kalman"]

_ACCEPTED = Applied("accepted")
_IMPOSSIBLE = "no robot changes its velocity like this between two readings"


class Kalman(Estimator):
    """An extended Kalman filter of the planar pose, for any mix of localizers.

    With ``filter: ukf`` prediction and update are filterpy's. Those of the extended filter, gates, recovery, hypotheses
    of who lies, and the history are Trailmark's own.

    The belief depends on what was said and on what instants it was said about, not on the order in which it came:
    any arrival inside the history gives what the right order would have given.
    """

    config: KalmanConfig

    def __init__(self, config: KalmanConfig) -> None:
        super().__init__(config)

    def start(self, session: Session) -> None:
        """Forget everything; begin at the session's start pose, or nowhere."""
        config = self.config
        self._layout = layout = Layout.of(config)
        self._filter = _new_filter(config, layout)
        self._path = session.path
        self._places = BeliefPlaces(session.path, LastingPrior.of(config))
        self._odometry = PublishedOdometry()
        self._clock = ClockGuard(config.time_jump_s, config.time_jump_after if config.time_jump == "reset" else None)
        self._monitors = {source: SourceMonitor(Trust.of(config, source)) for source in config.sources}
        self._counted: Counter[str] = Counter()
        self._learning = SourceLearning(config, self._counted)
        self._parting_log = PartingLog()
        self._belief: Belief | None = None
        self._begin_history(self._start_state(session.start_pose))

    def counters(self) -> Mapping[str, int]:
        """Return what was refused, repaired, replayed and doubted."""
        scales = {f"sigma_percent.{source}": round(100.0 * scale) for source, scale in self.noise_scales().items()}
        lasting = {f"correlation_ms.{source}": round(1e3 * s) for source, s in self.correlation_times().items()}
        recoveries = self._timeline.state_at(math.inf).rejections.n_recoveries
        overlaps = {f"overlaps.{source}": n for source, n in self._timeline.motions.n_overlaps().items()}
        return {**self._counted, **overlaps, **scales, **lasting, "recoveries": recoveries}

    def common_errors(self) -> Mapping[str, tuple[float, float]]:
        """Return the common errors now believed, by localizer: value and standard deviation [rad/s, or a share]."""
        gaussian = self._timeline.state_at(math.inf).gaussian
        if gaussian is None:
            return {}
        return {
            source: (float(gaussian.x[i]), math.sqrt(float(gaussian.covariance[i, i])))
            for source, i in ((source, common.index) for source, common in self._layout.common.items())
        }

    def noise_scales(self) -> Mapping[str, float]:
        """Return by which factor stated standard deviations are multiplied, by localizer; those at their word not."""
        return self._learning.noise_scales()

    def correlation_times(self) -> Mapping[str, float]:
        """Return how long errors of absolute poses are found to last, by localizer; those that err anew not [s]."""
        return self._learning.correlation_times()

    def clock_offsets(self) -> Mapping[str, TimeOffset]:
        """Return how late or early stamps are found to be, by localizer; nothing where that is not certain."""
        return self._learning.clock_offsets()

    def apply(self, source: str, estimate: Estimate) -> Applied:
        """Use an estimate and return what became of it.

        The verdict is that of the moment: a later arrival about an earlier instant may turn it, and the belief with it.
        """
        monitor = self._monitors.get(source)
        if monitor is None:
            monitor = self._monitors[source] = SourceMonitor(Trust.of(self.config, source))
        self._belief = None
        moved_s, before_s = 0.0, self._learning.moved_s(source)
        if self.config.clock_offsets != "off" and self._clock.is_near(estimate.stamp_s, self._timeline.newest_s):
            estimate, moved_s = self._learning.on_one_clock(source, estimate, self._timeline)
        applied = self._check_stamp(source, estimate, monitor.trust, moved_s=(before_s, moved_s))
        if applied.status == "refused":
            monitor.record_refusal(applied.reason)
        elif applied.status != "late":
            monitor.record_arrival(estimate.stamp_s)
            self._learning.compare_when_due(estimate.stamp_s, self._timeline)
        return applied

    def set_pose(
        self,
        pose_map_base: Pose2,
        covariance: Floats | None = None,
        stamp_s: float | None = None,
    ) -> Applied:
        """Replace the belief at an instant; what was said about later ones is applied from there."""
        newest_s = self._timeline.newest_s
        stamp_s = newest_s if stamp_s is None else stamp_s
        checked = self._start_covariance() if covariance is None else checked_covariance(covariance)
        if isinstance(checked, str):
            return self._refuse("set_pose", checked)
        self._belief = None
        self._counted["poses_set"] += 1
        if newest_s == -math.inf and stamp_s == -math.inf:  # nothing was heard yet: it is the start
            gaussian = Gaussian(*self._layout.initial_state(pose_map_base.array(), checked), UNAFFECTED)
            self._begin_history(FilterState(-math.inf, gaussian))
            return _ACCEPTED
        is_elsewhere = newest_s > -math.inf and abs(stamp_s - newest_s) > self.config.time_jump_s
        if is_elsewhere or not math.isfinite(stamp_s):
            return self._refuse("set_pose", f"the stamp {stamp_s:g} s is of another time")
        if stamp_s < self._timeline.horizon_s:
            return Applied("late", f"the history reaches back {self.config.history_s:g} s")
        return self._apply_measurement(stamp_s, pose_measurement(pose_map_base, checked))

    def belief(self, stamp_s: float | None = None) -> Belief:
        """Return the belief at a stamp: predicted from the last estimates before it.

        A stamp older than the history gets the oldest belief that is kept, with its own stamp.
        """
        newest_s = self._timeline.newest_s
        if stamp_s is None:
            stamp_s = newest_s if math.isfinite(newest_s) else 0.0
        elif newest_s == -math.inf:
            self._timeline.hear_of(stamp_s)
        belief = self._belief
        if belief is None or belief.stamp_s != stamp_s:
            belief = self._belief = self._make_belief(stamp_s)
        return belief

    def _start_state(self, start_pose: Pose2 | None) -> FilterState:
        if start_pose is None:
            return FilterState(-math.inf, None)
        gaussian = Gaussian(*self._layout.initial_state(start_pose.array(), self._start_covariance()), UNAFFECTED)
        return FilterState(-math.inf, gaussian)

    def _start_covariance(self) -> Floats:
        sigma_m, sigma_rad = self.config.start_sigma_m, math.radians(self.config.start_sigma_deg)
        return np.diag([sigma_m**2, sigma_m**2, sigma_rad**2])

    def _gate_of(self, source: str) -> float | None:
        return self._monitors[source].trust.gate

    def _begin_history(self, state: FilterState) -> None:
        self._timeline = Timeline(
            self.config, self._filter, self._layout, gate_of=self._gate_of, state=state, counted=self._counted
        )
        self._belief = None

    def _check_stamp(self, source: str, estimate: Estimate, trust: Trust, *, moved_s: tuple[float, float]) -> Applied:
        stamp_s, newest_s = estimate.stamp_s, self._timeline.newest_s
        if not math.isfinite(stamp_s):
            return self._refuse("stamp", f"the stamp is not finite: {stamp_s}")
        place = self._clock.classify(stamp_s, newest_s)
        if place == "elsewhere":
            return self._refuse("time_jump", f"the clock jumped by {stamp_s - newest_s:+.3f} s")
        if place == "reset":
            self._restart_clock(stamp_s)
        elif newest_s == -math.inf:
            self._timeline.hear_of(stamp_s)
        elif stamp_s < self._timeline.horizon_s:
            self._counted["late"] += 1
            message = f"{newest_s - stamp_s:.3f} s old, the history reaches back {self.config.history_s:g} s"
            return Applied("late", message)
        return self._dispatch(source, estimate, trust, moved_s=moved_s)

    def _dispatch(self, source: str, estimate: Estimate, trust: Trust, *, moved_s: tuple[float, float]) -> Applied:
        if isinstance(estimate, Lost):
            self._timeline.advance(estimate.stamp_s)
            return Applied("unused", f"lost: {estimate.reason}")
        information = trust.floored_information(estimate, self._counted)
        if isinstance(information, str):
            return Applied("refused", information)
        monitor = self._monitors[source]
        if isinstance(estimate, Motion):
            refusal = motion_refusal(estimate, self.config)
            if refusal is not None:
                return self._refuse(*refusal)
            information = monitor.believed_of_motion(estimate, information)
            information = self._learning.believed_of_motion(source, estimate, information)
            return self._apply_motion(source, estimate, StatedMotion(estimate, information))
        if isinstance(estimate, Fix):
            refusal = fix_refusal(estimate)
            if refusal is not None:
                return self._refuse(*refusal)
            information = monitor.fix_certainty.believed(information, estimate.stamp_s)
            information = self._learning.believed_of_fix(source, estimate, information, moved_s=moved_s[1])
            correlation_s, learns = self._learning.correlation_s(source, estimate, trust)
            shifted_s = moved_s[1] - moved_s[0]
            measurement = fix_measurement(source, estimate, information, trust, correlation_s, shifted_s)
            return self._apply_measurement(estimate.stamp_s, measurement, learns=learns)
        if self._path is None:
            return self._refuse("no_path", "a path offset needs a path, and this run has none")
        refusal = offset_refusal(estimate)
        if refusal is not None:
            return self._refuse(*refusal)
        measurement = path_measurement(source, estimate, information, trust, self._path)
        return self._apply_measurement(estimate.stamp_s, measurement)

    def _apply_motion(self, source: str, motion: Motion, stated: StatedMotion) -> Applied:
        if not self._timeline.add_motion(source, stated):
            return self._refuse("duplicate", "it has told of the same interval already")
        self._odometry.note_change(motion.since_s)
        if not self._timeline.motions.uses(source, stated):
            return Applied("unused", TOLD_ALREADY)
        return self._motion_outcome(source, motion.stamp_s)

    def _motion_outcome(self, source: str, stamp_s: float) -> Applied:
        """Return what became of a motion: left out, if it contradicts the others and the velocity before."""
        state = self._timeline.state_at(stamp_s)
        fault = state.diagnosis.faults.get(source)
        if fault is not None:
            return Applied("gated", fault.reason)
        if not state.checks:
            return Applied("gated", _IMPOSSIBLE) if source in state.left_out else _ACCEPTED
        for check in state.checks:
            if check.source == source:
                if source not in state.left_out:
                    return Applied("accepted", "", check.nis, check.dof)
                reason = f"NIS {check.nis:.1f} of {check.dof} dof against the motion of others"
                return Applied("gated", reason, check.nis, check.dof)
        return _ACCEPTED

    def _apply_measurement(self, stamp_s: float, measurement: Measurement, *, learns: bool = False) -> Applied:
        node = self._timeline.node_at(stamp_s)
        index = node.index_of(measurement.key)
        if index < len(node.measurements) and node.measurements[index].key == measurement.key:
            return self._refuse("duplicate", "it has told the same already")
        monitor = self._monitors.get(measurement.source)
        if monitor is not None and monitor.is_repetition(measurement.key, stamp_s):
            return self._refuse("repeated", "it has told the same just before: one observation counts once")
        n_before = sum(other.source == measurement.source for other in node.measurements)
        if n_before >= self.config.max_per_stamp:
            return self._refuse("stuck_stamp", f"{n_before} estimates of one instant: does its clock stand still?")
        node.insert(index, measurement)
        state = self._timeline.add_node(stamp_s, node)
        verdict = state.verdicts[index]
        if learns:
            self._learning.observe(measurement.source, state, verdict)
        return Applied(verdict.status, verdict.reason, verdict.nis, verdict.dof)

    def _refuse(self, what: str, reason: str) -> Applied:
        self._counted[f"refused_{what}"] += 1
        return Applied("refused", reason)

    def _restart_clock(self, stamp_s: float) -> None:
        """Begin anew at any time, where the belief was, as uncertain as after a gap."""
        self._counted["time_resets"] += 1
        self._learning.begin_anew()
        last = self._timeline.state_at(math.inf)
        self._rejoin()
        pose, travelled_m = self._odometry.publish(last.odometry, last.stamp_s)
        inflated = self._timeline.last_after_gap(gap_of_jump_s(stamp_s - last.stamp_s), stamp_s)
        self._odometry = PublishedOdometry.continue_from(pose, travelled_m, inflated.odometry)
        self._begin_history(inflated)
        for monitor in self._monitors.values():
            monitor.restart_clock(stamp_s)

    def _rejoin(self) -> None:
        if self._odometry.is_doubtful:
            self._odometry.rejoin(self._timeline.predicted_at(self._odometry.last_s).odometry)

    def _make_belief(self, stamp_s: float) -> Belief:
        self._rejoin()
        state = self._timeline.predicted_at(stamp_s)
        return self._places.belief_of(state, self._odometry.publish(state.odometry, state.stamp_s), self._health(state))

    def _health(self, state: FilterState) -> Mapping[str, str]:
        health = health_of(self._monitors, state, self.config.recover_after)
        self._learning.add_to_health(health)
        if state.diagnosis.parting.told:
            self._parting_log.note(state.diagnosis.parting.told)
        for source in self._timeline.motions.overlapping(state.stamp_s - TOLD_S):
            health.setdefault(source, OVERLAPS)
        return health or ALL_HEALTHY


def _new_filter(config: KalmanConfig, layout: Layout) -> Filter:
    if config.filter == "ekf":
        return Ekf(layout.n)
    from trailmark.estimation.kalman.ukf import Ukf  # filterpy imports much of scipy

    return Ukf(layout.n)
