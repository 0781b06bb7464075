"""The Kalman estimator: motion predicts, absolute estimates correct, and what comes late is put where it belongs."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

import numpy as np

from trailmark.arrays import Floats
from trailmark.estimates import Applied, Belief, Estimate, Fix, Lost, Motion
from trailmark.estimation.history import History
from trailmark.estimation.information import checked_covariance
from trailmark.estimation.kalman.agreement import Tolerance
from trailmark.estimation.kalman.belief_places import BeliefPlaces
from trailmark.estimation.kalman.clock import ClockGuard
from trailmark.estimation.kalman.clock_offsets import ClockOffsets, TimeOffset
from trailmark.estimation.kalman.correction import Correction
from trailmark.estimation.kalman.correlation_times import CorrelationTimes
from trailmark.estimation.kalman.ekf import Ekf
from trailmark.estimation.kalman.fault_detection import FaultDetector, accused_sources, outvoted_motions
from trailmark.estimation.kalman.health import SourceMonitor, health_of
from trailmark.estimation.kalman.layout import Layout
from trailmark.estimation.kalman.measurements import (
    Measurement,
    fix_measurement,
    path_measurement,
    pose_measurement,
)
from trailmark.estimation.kalman.motions import Motions, StatedMotion
from trailmark.estimation.kalman.noise_scales import NoiseScales, told_scale
from trailmark.estimation.kalman.odometry import PublishedOdometry
from trailmark.estimation.kalman.prediction import Prediction
from trailmark.estimation.kalman.state import FilterState, Gaussian
from trailmark.estimation.kalman.time_node import TimeNode
from trailmark.estimation.kalman.trust import Trust
from trailmark.estimation.kalman.ukf import Ukf
from trailmark.estimation.kalman.windows import WINDOW_S
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.symmetric import Sym3
from trailmark.geometry import Pose2
from trailmark.interfaces import Estimator, Session

__all__ = ["Kalman"]

_ACCEPTED = Applied("accepted")
_IMPOSSIBLE = "no robot changes its velocity like this between two readings"

# A clock that was set says nothing of how long it really took: the belief is as uncertain as after this gap.
_GAP_OF_A_JUMP_S = 10.0
# Half the way around the Earth.
_FARTHEST_M = 2e7


class Kalman(Estimator):
    """An extended Kalman filter of the planar pose, for any mix of localizers.

    filterpy does the prediction, and with ``filter: ukf`` the update, too. The update of the extended filter, gates,
    recovery, hypotheses of who lies, and the history are Trailmark's own.

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
        self._filter = Ukf(layout.n) if config.filter == "ukf" else Ekf(layout.n)
        self._path = session.path
        self._places = BeliefPlaces(session.path)
        self._correction = Correction(config, self._filter, layout)
        self._odometry = PublishedOdometry()
        self._clock = ClockGuard(config.time_jump_s, config.time_jump_after if config.time_jump == "reset" else None)
        self._monitors = {source: SourceMonitor(Trust.of(config, source)) for source in config.sources}
        self._offsets = ClockOffsets()
        self._noise = NoiseScales() if config.learn_scales else None
        self._correlations = CorrelationTimes()
        self._counted: Counter[str] = Counter()
        self._belief: Belief | None = None
        self._begin_history(self._start_state(session.start_pose))

    def counters(self) -> Mapping[str, int]:
        """Return what was refused, repaired, replayed and doubted."""
        scales = {f"sigma_percent.{source}": round(100.0 * scale) for source, scale in self.noise_scales().items()}
        lasting = {f"correlation_ms.{source}": round(1e3 * s) for source, s in self.correlation_times().items()}
        recoveries = self._history.state_at(math.inf).rejections.n_recoveries
        return {**self._counted, **scales, **lasting, "recoveries": recoveries}

    def common_errors(self) -> Mapping[str, tuple[float, float]]:
        """Return the common errors now believed, by localizer: value and standard deviation [rad/s, or a share]."""
        gaussian = self._history.state_at(math.inf).gaussian
        if gaussian is None:
            return {}
        return {
            source: (float(gaussian.x[i]), math.sqrt(float(gaussian.covariance[i, i])))
            for source, i in ((source, common.index) for source, common in self._layout.common.items())
        }

    def noise_scales(self) -> Mapping[str, float]:
        """Return by which factor stated standard deviations are multiplied, by localizer; those at their word not."""
        return {} if self._noise is None else self._noise.scales()

    def correlation_times(self) -> Mapping[str, float]:
        """Return how long errors of absolute poses are found to last, by localizer; those that err anew not [s]."""
        return self._correlations.times()

    def clock_offsets(self) -> Mapping[str, TimeOffset]:
        """Return how late or early stamps are found to be, by localizer; nothing where that is not certain."""
        return self._offsets.certain

    def apply(self, source: str, estimate: Estimate) -> Applied:
        """Use an estimate and return what became of it.

        The verdict is that of the moment: a later arrival about an earlier instant may turn it, and the belief with it.
        """
        monitor = self._monitors.get(source)
        if monitor is None:
            monitor = self._monitors[source] = SourceMonitor(Trust.of(self.config, source))
        self._belief = None
        if self.config.clock_offsets != "off" and self._clock.is_near(estimate.stamp_s, self._history.newest_s):
            estimate = self._on_one_clock(source, estimate)
        applied = self._check_stamp(source, estimate, monitor.trust)
        if applied.status == "refused":
            monitor.record_refusal(applied.reason)
        elif applied.status != "late":
            monitor.record_arrival(estimate.stamp_s)
            if self._noise is not None and self._noise.is_due(estimate.stamp_s):
                self._compare_noise(self._noise, estimate.stamp_s)
        return applied

    def set_pose(
        self,
        pose_map_base: Pose2,
        covariance: Floats | None = None,
        stamp_s: float | None = None,
    ) -> Applied:
        """Replace the belief at an instant; what was said about later ones is applied from there."""
        newest_s = self._history.newest_s
        stamp_s = newest_s if stamp_s is None else stamp_s
        checked = self._start_covariance() if covariance is None else checked_covariance(covariance)
        if isinstance(checked, str):
            return self._refuse("set_pose", checked)
        self._belief = None
        self._counted["poses_set"] += 1
        if newest_s == -math.inf and stamp_s == -math.inf:  # nothing was heard yet: it is the start
            gaussian = Gaussian(*self._layout.initial_state(pose_map_base.array(), checked))
            self._begin_history(FilterState(-math.inf, gaussian))
            return _ACCEPTED
        is_elsewhere = newest_s > -math.inf and abs(stamp_s - newest_s) > self.config.time_jump_s
        if is_elsewhere or not math.isfinite(stamp_s):
            return self._refuse("set_pose", f"the stamp {stamp_s:g} s is of another time")
        if stamp_s < self._history.horizon_s:
            return Applied("late", f"the history reaches back {self.config.history_s:g} s")
        return self._apply_measurement(stamp_s, pose_measurement(pose_map_base, checked))

    def belief(self, stamp_s: float | None = None) -> Belief:
        """Return the belief at a stamp: predicted from the last estimates before it.

        A stamp older than the history gets the oldest belief that is kept, with its own stamp.
        """
        if stamp_s is None:
            newest_s = self._history.newest_s
            stamp_s = newest_s if math.isfinite(newest_s) else 0.0
        belief = self._belief
        if belief is None or belief.stamp_s != stamp_s:
            belief = self._belief = self._make_belief(stamp_s)
        return belief

    def _start_state(self, start_pose: Pose2 | None) -> FilterState:
        if start_pose is None:
            return FilterState(-math.inf, None)
        gaussian = Gaussian(*self._layout.initial_state(start_pose.array(), self._start_covariance()))
        return FilterState(-math.inf, gaussian)

    def _start_covariance(self) -> Floats:
        sigma_m, sigma_rad = self.config.start_sigma_m, math.radians(self.config.start_sigma_deg)
        return np.diag([sigma_m**2, sigma_m**2, sigma_rad**2])

    def _gate_of(self, source: str) -> float | None:
        return self._monitors[source].trust.gate

    def _begin_history(self, state: FilterState) -> None:
        self._motions = Motions()
        self._prediction = Prediction(self.config, self._motions, self._filter, self._layout, self._gate_of)
        self._faults = FaultDetector(self._prediction, self._correction, Tolerance.of(self.config))
        self._nodes: dict[float, TimeNode] = {}
        self._history: History[TimeNode, FilterState] = History(self.config.history_s, self._step, state)
        self._kept_since_s = -math.inf
        self._belief = None

    def _step(self, state: FilterState, stamp_s: float, node: TimeNode) -> FilterState:
        """Return the state after an instant: the step of the history."""
        if not node.still_follows(state, self._motions.n_added):
            node.set_prediction(state, self._faults.predict(state, stamp_s), self._motions.n_added)
        return node.apply_measurements(self._faults)

    def _on_one_clock(self, source: str, estimate: Estimate) -> Estimate:
        """Return a fix that is certainly late with the stamp that it should have; liars are compared with nobody."""
        if self._offsets.is_due(estimate.stamp_s):
            for liar in outvoted_motions(self._history.state_at(math.inf)):
                self._offsets.forget(liar)
        corrected = self._offsets.on_one_clock(source, estimate)
        if self.config.clock_offsets != "use" or corrected is estimate:
            return estimate
        self._counted["stamps_corrected"] += 1
        return corrected

    def _compare_noise(self, noise: NoiseScales, stamp_s: float) -> None:
        state = self._history.state_at(math.inf)
        diagnosis = state.diagnosis
        corrected = None
        if state.gaussian is not None and not self._correlations.explains_corrections:
            corrected = diagnosis.corrections, diagnosis.correction_covariance
        noise.compare(stamp_s, accused_sources(state, self.config.recover_after), corrected)

    def _check_stamp(self, source: str, estimate: Estimate, trust: Trust) -> Applied:
        stamp_s, newest_s = estimate.stamp_s, self._history.newest_s
        if not math.isfinite(stamp_s):
            return self._refuse("stamp", f"the stamp is not finite: {stamp_s}")
        place = self._clock.classify(stamp_s, newest_s)
        if place == "elsewhere":
            return self._refuse("time_jump", f"the clock jumped by {stamp_s - newest_s:+.3f} s")
        if place == "reset":
            self._restart_clock()
        elif stamp_s < self._history.horizon_s:
            self._counted["late"] += 1
            message = f"{newest_s - stamp_s:.3f} s old, the history reaches back {self.config.history_s:g} s"
            return Applied("late", message)
        return self._dispatch(source, estimate, trust)

    def _dispatch(self, source: str, estimate: Estimate, trust: Trust) -> Applied:
        if isinstance(estimate, Lost):
            self._advance(estimate.stamp_s)
            return Applied("unused", f"lost: {estimate.reason}")
        information = trust.floored_information(estimate.information, self._counted)
        if isinstance(information, str):
            return Applied("refused", information)
        monitor = self._monitors[source]
        if isinstance(estimate, Motion):
            refused = self._check_motion(estimate)
            if refused is not None:
                return refused
            information = monitor.believed_of_motion(estimate, information)
            if self._noise is not None:
                information = self._noise.believed_of_motion(source, estimate, information)
            return self._apply_motion(source, estimate, StatedMotion(estimate, information))
        if isinstance(estimate, Fix):
            x_m, y_m = estimate.pose_map_base.x, estimate.pose_map_base.y
            if not (abs(x_m) <= _FARTHEST_M and abs(y_m) <= _FARTHEST_M):
                return self._refuse("too_far", f"({x_m:.3g}, {y_m:.3g}) m is no place on Earth")
            information = monitor.fix_certainty.believed(information, estimate.stamp_s)
            if self._noise is not None:
                information = self._noise.believed_of_fix(source, estimate, information)
            return self._apply_fix(source, estimate, information, trust)
        if self._path is None:
            return self._refuse("no_path", "a path offset needs a path, and this run has none")
        if not math.isfinite(estimate.station_m + estimate.lateral_m + estimate.heading_rad):
            return self._refuse("not_finite", "the path offset is not finite")
        return self._apply_measurement(
            estimate.stamp_s, path_measurement(source, estimate, information, trust, self._path)
        )

    def _apply_fix(self, source: str, fix: Fix, information: Sym3, trust: Trust) -> Applied:
        """Correct with an absolute pose, and learn how long the errors last of one that does not say it."""
        correlation_s = fix.correlation_s if trust.correlation_s is None else trust.correlation_s
        learns = correlation_s is None and self.config.learn_correlations
        if correlation_s is None:
            correlation_s = self._correlations.correlation_s(source)
        measurement = fix_measurement(source, fix, information, trust, correlation_s)
        return self._apply_measurement(fix.stamp_s, measurement, learns=learns)

    def _check_motion(self, motion: Motion) -> Applied | None:
        """Return why a motion cannot be, before anything is learned from it; None if it can."""
        dt_s = motion.stamp_s - motion.since_s
        if not math.isfinite(motion.since_s):
            return self._refuse("stamp", f"the motion begins at {motion.since_s} s")
        if dt_s > self.config.time_jump_s:
            return self._refuse("time_jump", f"a motion over {dt_s:g} s: the clock jumped")
        speed_mps = math.hypot(motion.pose_since_now.x, motion.pose_since_now.y) / dt_s
        if speed_mps > self.config.max_speed_mps:
            return self._refuse("too_fast", f"a motion of {speed_mps:.3g} m/s: see max_speed_mps")
        return None

    def _apply_motion(self, source: str, motion: Motion, stated: StatedMotion) -> Applied:
        if not self._motions.add(source, stated):
            return self._refuse("duplicate", "it has told of the same interval already")
        self._odometry.note_change(motion.since_s)
        newest_s = self._history.last_stamp_s
        self._advance(motion.stamp_s)
        if motion.since_s < newest_s and (motion.since_s in self._nodes or motion.since_s < self._history.horizon_s):
            self._history.replay(motion.since_s)
            self._counted["replayed"] += 1
        for stamp_s in (motion.since_s, motion.stamp_s):
            if stamp_s not in self._nodes and stamp_s >= self._history.horizon_s:
                self._nodes[stamp_s] = node = TimeNode()
                self._history.insert(stamp_s, node)
        return self._motion_outcome(source, motion.stamp_s)

    def _motion_outcome(self, source: str, stamp_s: float) -> Applied:
        """Return what became of a motion: left out, if it contradicts the others and the velocity before."""
        state = self._history.state_at(stamp_s)
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
        node = self._nodes.get(stamp_s) or TimeNode()
        index = node.index_of(measurement.key)
        if index < len(node.measurements) and node.measurements[index].key == measurement.key:
            return self._refuse("duplicate", "it has told the same already")
        monitor = self._monitors.get(measurement.source)
        if monitor is not None and monitor.is_repetition(measurement.key, stamp_s):
            return self._refuse("repeated", "it has told the same just before: one observation counts once")
        n_before = sum(other.source == measurement.source for other in node.measurements)
        if n_before >= self.config.max_per_stamp:
            return self._refuse("stuck_stamp", f"{n_before} estimates of one instant: does its clock stand still?")
        self._counted["replayed"] += stamp_s < self._history.last_stamp_s
        node.insert(index, measurement)
        self._advance(stamp_s)
        if stamp_s in self._nodes:
            self._history.replay(math.nextafter(stamp_s, -math.inf))
        else:
            self._nodes[stamp_s] = node
            self._history.insert(stamp_s, node)
        state = self._history.state_at(stamp_s)
        verdict = state.verdicts[index]
        if learns and verdict.seen is not None and verdict.used is not None and not state.diagnosis.rivals:
            self._correlations.observe(measurement.source, stamp_s, verdict.seen, verdict.used)
        return Applied(verdict.status, verdict.reason, verdict.nis, verdict.dof)

    def _refuse(self, what: str, reason: str) -> Applied:
        self._counted[f"refused_{what}"] += 1
        return Applied("refused", reason)

    def _advance(self, stamp_s: float) -> None:
        """Let time go on, and forget what has fallen out of the history; not at every call, it costs."""
        self._history.advance(stamp_s)
        horizon_s = self._history.horizon_s
        if horizon_s < self._kept_since_s + 1.0:
            return
        self._kept_since_s = horizon_s
        self._nodes = {at: node for at, node in self._nodes.items() if at >= horizon_s}
        self._motions.forget(self._history.state_at(-math.inf).stamp_s - 3.0 * WINDOW_S)

    def _restart_clock(self) -> None:
        """Begin anew at any time, where the belief was, as uncertain as after a gap."""
        self._counted["time_resets"] += 1
        self._offsets = self._offsets.begin_anew()
        self._correlations = self._correlations.begin_anew()
        if self._noise is not None:
            self._noise = self._noise.begin_anew()
        last = self._history.state_at(math.inf)
        self._rejoin()
        pose, travelled_m = self._odometry.publish(last.odometry, last.stamp_s)
        inflated = self._prediction.restart_after_gap(last, _GAP_OF_A_JUMP_S)
        self._odometry = PublishedOdometry.continue_from(pose, travelled_m, inflated.odometry)
        self._begin_history(inflated)

    def _rejoin(self) -> None:
        if self._odometry.is_doubtful:
            self._odometry.rejoin(self._state_at(self._odometry.last_s).odometry)

    def _state_at(self, stamp_s: float) -> FilterState:
        return self._faults.predict(self._history.state_at(stamp_s), stamp_s)

    def _make_belief(self, stamp_s: float) -> Belief:
        self._rejoin()
        state = self._state_at(stamp_s)
        return self._places.belief_of(state, self._odometry.publish(state.odometry, state.stamp_s), self._health(state))

    def _health(self, state: FilterState) -> Mapping[str, str]:
        health = health_of(self._monitors, state, self.config.recover_after)
        for source, offset in self._offsets.certain.items():
            health.setdefault(source, str(offset))
        if self._noise is not None:
            for source, scale in self._noise.scales().items():
                health.setdefault(source, told_scale(scale))
        return health
