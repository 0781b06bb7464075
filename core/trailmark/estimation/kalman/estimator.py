"""The Kalman estimator: motion predicts, absolute estimates correct, and what comes late is put where it belongs."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from trailmark.estimates import Applied, Belief, Estimate, Fix, Lost, Motion, PathOffset
from trailmark.estimation.corrections import covariance_on_path
from trailmark.estimation.history import History
from trailmark.estimation.information import checked_covariance
from trailmark.estimation.kalman.clock import ClockGuard
from trailmark.estimation.kalman.correction import Correction, Filter
from trailmark.estimation.kalman.ekf import Ekf
from trailmark.estimation.kalman.health import Listening, health_of
from trailmark.estimation.kalman.knot import Knot
from trailmark.estimation.kalman.layout import Layout
from trailmark.estimation.kalman.measurements import (
    Measurement,
    fix_measurement,
    path_measurement,
    placed_measurement,
)
from trailmark.estimation.kalman.motions import Motions, StatedMotion
from trailmark.estimation.kalman.odometry import PublishedOdometry
from trailmark.estimation.kalman.prediction import Prediction
from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.kalman.trust import Trust
from trailmark.estimation.kalman.ukf import Ukf
from trailmark.estimation.kalman_config import KalmanConfig
from trailmark.estimation.symmetric import ZERO, inverse, to_matrix
from trailmark.frames.payloads import read_only
from trailmark.geometry import Pose2
from trailmark.interfaces import Estimator, Session

__all__ = ["Kalman"]

_ACCEPTED = Applied("accepted")

# A clock that was set says nothing of how long it really took: the belief is doubted as after this gap.
_GAP_OF_A_JUMP_S = 10.0


class Kalman(Estimator):
    """An extended Kalman filter of the planar pose, for any mix of localizers.

    The belief depends on what was said and on what instants it was said about, not on the order in which it came:
    any arrival inside the history gives what the right order would have given.
    """

    config: KalmanConfig

    def __init__(self, config: KalmanConfig) -> None:
        super().__init__(config)
        self.start(Session())

    def start(self, session: Session) -> None:
        """Forget everything; begin at the session's start pose, or nowhere."""
        config = self.config
        self._layout = layout = Layout.of(config)
        self._filter: Filter = Ukf(layout.n) if config.filter == "ukf" else Ekf(layout.n)
        self._path = session.path
        self._station_m: float | None = None
        self._correction = Correction(config, self._filter, layout)
        self._odometry = PublishedOdometry()
        self._clock = ClockGuard(config.time_jump_s, config.time_jump_after if config.time_jump == "reset" else None)
        self._ears = {source: Listening(Trust.of(config, source)) for source in config.sources}
        self._counted: Counter[str] = Counter()
        self._belief: Belief | None = None
        self._begin(self._start_state(session.start_pose))

    def counters(self) -> Mapping[str, int]:
        """Return what was refused, repaired, replayed and doubted."""
        return {**self._counted, "recoveries": self._history.state_at(math.inf).n_recoveries}

    def common_errors(self) -> Mapping[str, tuple[float, float]]:
        """Return the common errors now believed, by localizer: value and standard deviation [rad/s, or a share]."""
        state = self._history.state_at(math.inf)
        if state.x is None or state.covariance is None:
            return {}
        return {
            source: (float(state.x[i]), math.sqrt(float(state.covariance[i, i])))
            for source, i in ((source, common.index) for source, common in self._layout.common.items())
        }

    def apply(self, source: str, estimate: Estimate) -> Applied:
        """Take an estimate and say what became of it.

        The verdict is that of the moment: a later arrival about an earlier instant may turn it, and the belief with it.
        """
        ear = self._ears.get(source)
        if ear is None:
            ear = self._ears[source] = Listening(Trust.of(self.config, source))
        self._belief = None
        applied = self._timely(source, estimate, ear.trust)
        if applied.status == "refused":
            ear.refused(applied.reason)
        elif applied.status != "late":
            ear.heard(estimate.stamp_s)
        return applied

    def set_pose(
        self,
        pose_map_base: Pose2,
        covariance: npt.NDArray[np.float64] | None = None,
        stamp_s: float | None = None,
    ) -> Applied:
        """Replace the belief at an instant; what was heard about later ones is applied from there."""
        newest_s = self._history.newest_s
        stamp_s = newest_s if stamp_s is None else stamp_s
        told = self._start_covariance() if covariance is None else checked_covariance(covariance)
        if isinstance(told, str):
            return self._refused("set_pose", told)
        self._belief = None
        self._counted["poses_set"] += 1
        if newest_s == -math.inf and stamp_s == -math.inf:  # nothing was heard yet: it is the start
            self._begin(FilterState(-math.inf, *self._layout.begun(pose_map_base.array(), told)))
            return _ACCEPTED
        is_elsewhere = newest_s > -math.inf and abs(stamp_s - newest_s) > self.config.time_jump_s
        if is_elsewhere or not math.isfinite(stamp_s):
            return self._refused("set_pose", f"the stamp {stamp_s:g} s is of another time")
        if stamp_s < self._history.horizon_s:
            return Applied("late", f"the history reaches back {self.config.history_s:g} s")
        return self._correct(stamp_s, placed_measurement(pose_map_base, told))

    def belief(self, stamp_s: float | None = None) -> Belief:
        """Return the belief at a stamp: predicted from the last estimates before it.

        A stamp older than the history gets the oldest belief that is kept, with its own stamp.
        """
        if stamp_s is None:
            newest_s = self._history.newest_s
            stamp_s = newest_s if math.isfinite(newest_s) else 0.0
        belief = self._belief
        if belief is None or belief.stamp_s != stamp_s:
            belief = self._belief = self._believed(stamp_s)
        return belief

    def _start_state(self, start_pose: Pose2 | None) -> FilterState:
        if start_pose is None:
            return FilterState(-math.inf, None, None)
        begun = self._layout.begun(start_pose.array(), self._start_covariance())
        return FilterState(-math.inf, *begun)

    def _start_covariance(self) -> npt.NDArray[np.float64]:
        sigma_m, sigma_rad = self.config.start_sigma_m, math.radians(self.config.start_sigma_deg)
        return np.diag([sigma_m**2, sigma_m**2, sigma_rad**2])

    def _gate_of(self, source: str) -> float | None:
        return self._ears[source].trust.gate

    def _begin(self, state: FilterState) -> None:
        self._motions = Motions()
        self._prediction = Prediction(self.config, self._motions, self._filter, self._layout, self._gate_of)
        self._knots: dict[float, Knot] = {}
        self._history: History[Knot, FilterState] = History(self.config.history_s, self._step, state)
        self._kept_since_s = -math.inf
        self._belief = None

    def _step(self, state: FilterState, stamp_s: float, knot: Knot) -> FilterState:
        """Return the state after an instant: the step of the history."""
        if not knot.still_follows(state, self._motions.n_added):
            knot.begin(state, self._prediction.predicted(state, stamp_s), self._motions.n_added)
        return knot.finish(self._correction)

    def _timely(self, source: str, estimate: Estimate, trust: Trust) -> Applied:
        stamp_s, newest_s = estimate.stamp_s, self._history.newest_s
        if not math.isfinite(stamp_s):
            return self._refused("stamp", f"the stamp is not finite: {stamp_s}")
        judged = self._clock.judged(stamp_s, newest_s)
        if judged == "elsewhere":
            return self._refused("time_jump", f"the clock jumped by {stamp_s - newest_s:+.3f} s")
        if judged == "reset":
            self._reset()
        elif stamp_s < self._history.horizon_s:
            self._counted["late"] += 1
            story = f"{newest_s - stamp_s:.3f} s old, the history reaches back {self.config.history_s:g} s"
            return Applied("late", story)
        return self._taken(source, estimate, trust)

    def _taken(self, source: str, estimate: Estimate, trust: Trust) -> Applied:
        if isinstance(estimate, Lost):
            self._advance(estimate.stamp_s)
            return Applied("unused", f"lost: {estimate.reason}")
        information = trust.believed(estimate.information, self._counted)
        if isinstance(information, str):
            return Applied("refused", information)
        if isinstance(estimate, Motion):
            return self._move(source, estimate, StatedMotion(estimate, information))
        if isinstance(estimate, Fix):
            return self._correct(estimate.stamp_s, fix_measurement(source, estimate, information, trust))
        if self._path is None:
            return self._refused("no_path", "a path offset needs a path, and this run has none")
        if not math.isfinite(estimate.station_m + estimate.lateral_m + estimate.heading_rad):
            return self._refused("not_finite", "the path offset is not finite")
        return self._correct(estimate.stamp_s, path_measurement(source, estimate, information, trust, self._path))

    def _move(self, source: str, motion: Motion, stated: StatedMotion) -> Applied:
        if not math.isfinite(motion.since_s):
            return self._refused("stamp", f"the motion begins at {motion.since_s} s")
        if motion.stamp_s - motion.since_s > self.config.time_jump_s:
            return self._refused("time_jump", f"a motion over {motion.stamp_s - motion.since_s:g} s: the clock jumped")
        if not self._motions.add(source, stated):
            return self._refused("duplicate", "it has told of the same interval already")
        self._odometry.changed(motion.since_s)
        newest_s = self._history.last_stamp_s
        self._advance(motion.stamp_s)
        if motion.since_s < newest_s and (motion.since_s in self._knots or motion.since_s < self._history.horizon_s):
            self._history.replay(motion.since_s)
            self._counted["replayed"] += 1
        for stamp_s in (motion.since_s, motion.stamp_s):
            if stamp_s not in self._knots and stamp_s >= self._history.horizon_s:
                self._knots[stamp_s] = knot = Knot()
                self._history.insert(stamp_s, knot)
        return self._moved(source, motion.stamp_s)

    def _moved(self, source: str, stamp_s: float) -> Applied:
        """Return what became of a motion: left out, if it contradicts the others and the velocity before."""
        state = self._history.state_at(stamp_s)
        if not state.checks:
            return _ACCEPTED
        for other, nis, dof in state.checks:
            if other == source:
                if source not in state.left_out:
                    return Applied("accepted", "", nis, dof)
                return Applied("gated", f"NIS {nis:.1f} of {dof} dof against the motion of others", nis, dof)
        return _ACCEPTED

    def _correct(self, stamp_s: float, measurement: Measurement) -> Applied:
        knot = self._knots.get(stamp_s) or Knot()
        index = knot.index_of(measurement.key)
        if index < len(knot.measurements) and knot.measurements[index].key == measurement.key:
            return self._refused("duplicate", "it has told the same already")
        n_before = sum(other.source == measurement.source for other in knot.measurements)
        if n_before >= self.config.max_per_stamp:
            return self._refused("stuck_stamp", f"{n_before} estimates of one instant: does its clock stand still?")
        self._counted["replayed"] += stamp_s < self._history.last_stamp_s
        knot.insert(index, measurement)
        self._advance(stamp_s)
        if stamp_s in self._knots:
            self._history.replay(math.nextafter(stamp_s, -math.inf))
        else:
            self._knots[stamp_s] = knot
            self._history.insert(stamp_s, knot)
        verdict = self._history.state_at(stamp_s).verdicts[index]
        return Applied(verdict.status, verdict.reason, verdict.nis, verdict.dof)

    def _refused(self, what: str, reason: str) -> Applied:
        self._counted[f"refused_{what}"] += 1
        return Applied("refused", reason)

    def _advance(self, stamp_s: float) -> None:
        """Let time go on, and forget what has fallen out of the history; not at every call, it costs."""
        self._history.advance(stamp_s)
        horizon_s = self._history.horizon_s
        if horizon_s < self._kept_since_s + 1.0:
            return
        self._kept_since_s = horizon_s
        self._knots = {at: knot for at, knot in self._knots.items() if at >= horizon_s}
        self._motions.forget(self._history.state_at(-math.inf).stamp_s)

    def _reset(self) -> None:
        """Begin anew at any time, where the belief was, and doubt it."""
        self._counted["time_resets"] += 1
        last = self._history.state_at(math.inf)
        self._rejoin()
        pose, travelled_m = self._odometry.publish(last)
        doubted = self._prediction.doubted(last, _GAP_OF_A_JUMP_S)
        self._odometry = PublishedOdometry.going_on(pose, travelled_m, doubted)
        self._begin(doubted)

    def _rejoin(self) -> None:
        if self._odometry.is_doubtful:
            self._odometry.rejoin(self._state_at(self._odometry.last_s))

    def _state_at(self, stamp_s: float) -> FilterState:
        return self._prediction.predicted(self._history.state_at(stamp_s), stamp_s)

    def _believed(self, stamp_s: float) -> Belief:
        self._rejoin()
        state = self._state_at(stamp_s)
        pose_odom_base, travelled_m = self._odometry.publish(state)
        pose = None if state.x is None else Pose2(*state.x[:3].tolist())
        return Belief(
            state.stamp_s,
            pose,
            None if state.covariance is None else read_only(state.covariance[:3, :3]),
            pose_odom_base,
            state.twist,
            travelled_m,
            self._on_path(state, pose),
            state.travelled_m - state.fixed_at_m,
            state.gap_s if state.has_moved else math.inf,
            health_of(self._ears, state, self.config.recover_after),
        )

    def _on_path(self, state: FilterState, pose: Pose2 | None) -> PathOffset | None:
        if self._path is None or pose is None or state.covariance is None:
            return None
        located = self._path.locate(pose, self._station_m)
        self._station_m = located.station_m
        xx, xy, xt, _, yy, yt, _, _, tt = state.covariance[:3, :3].ravel().tolist()
        information = inverse(covariance_on_path((xx, xy, xt, yy, yt, tt), self._path, located.station_m)) or ZERO
        return PathOffset(
            state.stamp_s, located.station_m, located.lateral_m, located.heading_rad, to_matrix(information)
        )
