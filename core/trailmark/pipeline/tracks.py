"""Trajectories of a run: the fused one, and one of each localizer by itself."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping

import numpy as np

from trailmark.estimates import Belief, Lost
from trailmark.estimation.dead_reckoning import DeadReckoning
from trailmark.estimation.dead_reckoning_config import DeadReckoningConfig
from trailmark.geometry import Pose2, Trajectory
from trailmark.interfaces import Session, Sink
from trailmark.pipeline.steps import Told

__all__ = ["ToldSink", "Track", "Tracks"]


class ToldSink(Sink):
    """A sink of the pipeline's own that also wants to know when an estimate arrived."""

    def on_told(self, told: Told) -> None:
        """An estimate was applied."""


class Track:
    """Poses over time as they become known: what was said about the past later does not change it."""

    def __init__(self) -> None:
        self._rows = array("d")
        self._last_s = -np.inf

    def __len__(self) -> int:
        return len(self._rows) // 4

    def add(self, stamp_s: float, pose: Pose2) -> None:
        """Add a pose; of one stamp the last counts, and an older one does not."""
        if stamp_s < self._last_s:
            return
        if stamp_s == self._last_s:
            del self._rows[-4:]
        self._rows.extend((stamp_s, pose.x, pose.y, pose.theta))
        self._last_s = stamp_s

    def trajectory(self) -> Trajectory:
        """Return what there is."""
        table = np.array(self._rows, dtype=np.float64).reshape(-1, 4)
        return Trajectory(table[:, 0], table[:, 1:])


class _Private:
    """A dead reckoning of one localizer's estimates, used or not."""

    def __init__(self, session: Session) -> None:
        self._estimator = DeadReckoning(DeadReckoningConfig())
        self._estimator.start(session)
        self._in_map, self._in_odom = Track(), Track()

    def take(self, told: Told) -> None:
        if self._estimator.apply(told.source, told.estimate).status == "refused":
            return
        belief = self._estimator.belief(told.estimate.stamp_s)
        if belief.pose_map_base is not None:
            self._in_map.add(belief.stamp_s, belief.pose_map_base)
        else:
            self._in_odom.add(belief.stamp_s, belief.pose_odom_base)

    def trajectory(self) -> Trajectory:
        """Return the way in the map; of a localizer that never knew where it started, the way from its start."""
        return (self._in_map if len(self._in_map) else self._in_odom).trajectory()


class Tracks(ToldSink):
    """Collects ``fused`` and a trajectory of each localizer.

    Parameters
    ----------
    names : iterable of str
        The localizers.
    session : Session
        Where a localizer's own dead reckoning starts: `path` and `start_pose`.
    """

    def __init__(self, names: Iterable[str], session: Session) -> None:
        super().__init__(None)
        self._fused = Track()
        self._private = {name: _Private(session) for name in names}

    def on_told(self, told: Told) -> None:
        """Let the localizer's own dead reckoning take the estimate."""
        if not isinstance(told.estimate, Lost):
            self._private[told.source].take(told)

    def on_belief(self, belief: Belief) -> None:
        """Add to the fused trajectory."""
        if belief.pose_map_base is not None:
            self._fused.add(belief.stamp_s, belief.pose_map_base)

    def trajectories(self) -> Mapping[str, Trajectory]:
        """Return all trajectories by name; a localizer that said nothing has an empty one."""
        return {name: private.trajectory() for name, private in self._private.items()} | {
            "fused": self._fused.trajectory()
        }
