"""An instant of the history: where a motion begins or ends, or absolute estimates speak."""

from __future__ import annotations

from bisect import bisect_left

from trailmark.estimation.kalman.fault_detection import FaultDetector
from trailmark.estimation.kalman.measurements import Measurement
from trailmark.estimation.kalman.state import FilterState

__all__ = ["TimeNode"]


class TimeNode:
    """The measurements of one instant, in an order of their own, and the states between them.

    What was computed for an instant stays good until the state before it, the motion until it, or a measurement of it
    changes: a further sighting of a frame costs one update and no prediction.

    Attributes
    ----------
    measurements : list of Measurement
        By their keys.
    """

    __slots__ = ("_before", "_n_motions", "_states", "measurements")

    def __init__(self) -> None:
        self.measurements: list[Measurement] = []
        self._before: FilterState | None = None
        self._n_motions = -1
        self._states: list[FilterState] = []  # predicted, then after each measurement

    def index_of(self, key: tuple[str, tuple[float, ...]]) -> int:
        """Return where a measurement stands, or would."""
        return bisect_left(self.measurements, key, key=lambda measurement: measurement.key)

    def insert(self, index: int, measurement: Measurement) -> None:
        """Add a measurement."""
        self.measurements.insert(index, measurement)
        del self._states[index + 1 :]

    def still_follows(self, before: FilterState, n_motions: int) -> bool:
        """Return whether the prediction is still that from a state, with so many motions known."""
        return self._before is before and self._n_motions == n_motions

    def set_prediction(self, before: FilterState, predicted: FilterState, n_motions: int) -> None:
        """Take a new prediction; what followed from the old one is void."""
        self._before, self._n_motions, self._states = before, n_motions, [predicted]

    def apply_measurements(self, faults: FaultDetector) -> FilterState:
        """Apply the measurements that are not applied yet and return the state after the last."""
        states = self._states
        for measurement in self.measurements[len(states) - 1 :]:
            states.append(faults.correct(states[-1], measurement))
        return states[-1]
