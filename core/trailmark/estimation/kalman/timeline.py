"""The states of the last seconds: what was said is put at the instant that it is about, and what follows is redone."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable

from trailmark.estimation.history import History
from trailmark.estimation.kalman.agreement import Tolerance
from trailmark.estimation.kalman.correction import Correction, Filter
from trailmark.estimation.kalman.fault_detection import FaultDetector
from trailmark.estimation.kalman.gaps import drift_of
from trailmark.estimation.kalman.layout import Layout
from trailmark.estimation.kalman.motions import Motions, StatedMotion
from trailmark.estimation.kalman.prediction import Prediction
from trailmark.estimation.kalman.state import FilterState
from trailmark.estimation.kalman.time_node import TimeNode
from trailmark.estimation.kalman.windows import LONGEST_S, WINDOW_S
from trailmark.estimation.kalman_config import KalmanConfig

__all__ = ["Timeline"]


class Timeline:
    """A history of filter states that a motion cuts at both of its ends, and an absolute estimate at its instant.

    Parameters
    ----------
    config : KalmanConfig
        Of the estimator.
    kalman : Filter
        Does the arithmetic.
    layout : Layout
        Of the state.
    gate_of : callable
        Probability with which a right motion of a localizer passes its test; None: no test.
    state : FilterState
        The state before all that is said.
    counted : Counter of str
        Takes how often the past was redone.
    """

    def __init__(
        self,
        config: KalmanConfig,
        kalman: Filter,
        layout: Layout,
        *,
        gate_of: Callable[[str], float | None],
        state: FilterState,
        counted: Counter[str],
    ) -> None:
        self._counted = counted
        self._motions = Motions(drift_of(config))
        self._prediction = Prediction(config, self._motions, kalman, layout, gate_of)
        self._faults = FaultDetector(self._prediction, Correction(config, kalman, layout), Tolerance.of(config))
        self._nodes: dict[float, TimeNode] = {}
        self._kept_since_s = self._heard_s = -math.inf
        self._time_jump_s = config.time_jump_s
        self._history: History[TimeNode, FilterState] = History(config.history_s, self._step, state)

    @property
    def newest_s(self) -> float:
        """The newest stamp heard of; ``-inf`` before the first [s]."""
        return self._history.newest_s

    @property
    def motions(self) -> Motions:
        """What is known of motion."""
        return self._motions

    @property
    def horizon_s(self) -> float:
        """What is older comes too late [s]."""
        return self._history.horizon_s

    def hear_of(self, stamp_s: float) -> None:
        """Take note of an instant of the run before anything was said: from the first on, time counts for the start."""
        if stamp_s - self._heard_s > self._time_jump_s:  # the first, or of another clock
            self._prediction.begun_s = stamp_s
        self._heard_s = max(self._heard_s, stamp_s)

    def state_at(self, stamp_s: float) -> FilterState:
        """Return the state after the last instant at or before a stamp."""
        return self._history.state_at(stamp_s)

    def predicted_at(self, stamp_s: float) -> FilterState:
        """Return the state at a stamp, predicted from the last instant before it."""
        return self._faults.predict(self._history.state_at(stamp_s), stamp_s)

    def last_after_gap(self, gap_s: float, stamp_s: float) -> FilterState:
        """Return the last state as one that starts anew at a stamp of another clock, as uncertain as after a gap."""
        return self._prediction.restart_after_gap(self._history.state_at(math.inf), gap_s, stamp_s)

    def add_motion(self, source: str, stated: StatedMotion) -> bool:
        """Put a motion where it belongs; False if this localizer has told of the same interval already."""
        if not self._motions.add(source, stated):
            return False
        since_s, stamp_s, history = stated.since_s, stated.stamp_s, self._history
        newest_s = history.last_stamp_s
        self.advance(stamp_s)
        if since_s < newest_s and (since_s in self._nodes or since_s < history.horizon_s):
            history.replay(since_s)
            self._counted["replayed"] += 1
        for at_s in (since_s, stamp_s):
            if at_s not in self._nodes and at_s >= history.horizon_s:
                self._nodes[at_s] = node = TimeNode()
                history.insert(at_s, node)
        return True

    def node_at(self, stamp_s: float) -> TimeNode:
        """Return the node of an instant, or a new one for `add_node`."""
        return self._nodes.get(stamp_s) or TimeNode()

    def add_node(self, stamp_s: float, node: TimeNode) -> FilterState:
        """Return the state at an instant whose node, from `node_at`, has another measurement now."""
        history = self._history
        self._counted["replayed"] += stamp_s < history.last_stamp_s
        self.advance(stamp_s)
        if stamp_s in self._nodes:
            history.replay(math.nextafter(stamp_s, -math.inf))
        else:
            self._nodes[stamp_s] = node
            history.insert(stamp_s, node)
        return history.state_at(stamp_s)

    def advance(self, stamp_s: float) -> None:
        """Let time go on, and forget what has fallen out of the history; not at every call, it costs."""
        self._history.advance(stamp_s)
        horizon_s = self._history.horizon_s
        if horizon_s < self._kept_since_s + 1.0:
            return
        self._kept_since_s = horizon_s
        # what is older than the history is asked for no more, and would keep its states alive
        self._nodes = {at: node for at, node in self._nodes.items() if at >= horizon_s}
        self._motions.forget(self._history.state_at(-math.inf).stamp_s - LONGEST_S - 2.0 * WINDOW_S)

    def _step(self, state: FilterState, stamp_s: float, node: TimeNode) -> FilterState:
        """Return the state after an instant: the step of the history."""
        if not node.still_follows(state, self._motions.n_added):
            node.set_prediction(state, self._faults.predict(state, stamp_s), self._motions.n_added)
        return node.apply_measurements(self._faults)
