"""Teaching: waypoints along the way, committed together with the keyframes since the last one."""

from __future__ import annotations

import math
from time import perf_counter_ns

from trailmark.errors import ConfigError
from trailmark.estimates import Belief
from trailmark.geometry import Pose2
from trailmark.interfaces import PathStore
from trailmark.paths import Waypoint
from trailmark.pipeline.instruments import Instruments
from trailmark.pipeline.teaching.guarded_store import GuardedMap
from trailmark.pipeline.teaching.way_log import WAY_LOG, WayLog

__all__ = ["Teaching"]

# Ways that went through sums of floats: this much short of a multiple is on it.
_SLACK_M = 1e-9

# Odometry starts with the robot; a recording that has given no motion for so long has none.
_GRACE_S = 5.0


class Teaching:
    """Lays a waypoint at the first frame at or beyond every multiple of `spacing_m`.

    The first, where the robot stood, is laid when there is motion: what cannot be taught leaves no path.

    Parameters
    ----------
    store : PathStore
        Open for writing. Its path, if it has one, is continued.
    spacing_m : float
        Way between waypoints, measured by `Belief.travelled_m` [m].
    start_pose : Pose2 or None
        Where the robot starts; a path is continued from its end straight to there.
    instruments : Instruments
        Count the waypoints, and time what laying them takes.
    """

    def __init__(self, store: PathStore, spacing_m: float, start_pose: Pose2 | None, instruments: Instruments) -> None:
        self._store = store
        self._spacing_m = spacing_m
        self._counters = instruments.counters
        self._times = instruments.times.stage("store")
        path = store.path()
        #: Stamps of the waypoints laid, by their stations [s].
        self.stamps: dict[float, float] = {}
        self._n_waypoints = 0 if path is None else len(path)
        between_m = 0.0 if path is None else _distance(path[-1].pose_map_base, start_pose, spacing_m)
        self.offset_m = 0.0 if path is None else path[-1].station_m + between_m
        self._next_m = 0.0 if path is None or between_m >= spacing_m / 2 else spacing_m
        self._last_m = -math.inf
        self._began_s: float | None = None
        self._has_motion = False
        self._first: Belief | None = None
        self._log: WayLog | None = None

    @property
    def n_waypoints(self) -> int:
        """How many waypoints are committed, with those of before."""
        return self._n_waypoints

    def keep_log(self) -> None:
        """Note the way from here on, so that it can be straightened at the end."""
        self._log = WayLog(GuardedMap(self._store.localizer_map(WAY_LOG)))

    def on_belief(self, belief: Belief) -> None:
        """Lay a waypoint if the robot has come far enough.

        Raises
        ------
        ConfigError
            If nothing has given any motion.
        """
        self._began_s = belief.stamp_s if self._began_s is None else self._began_s
        if not self._has_motion:
            self._has_motion = math.isfinite(belief.motion_age_s)
            if not self._has_motion and belief.stamp_s - self._began_s > _GRACE_S:
                raise self._no_motion(f"after {_GRACE_S:g} s")
        if not self._has_motion:
            self._first = self._first or (belief if belief.pose_map_base is not None else None)
            return
        if self._first is not None:
            first, self._first = self._first, None
            self._note(first)
            self._lay_if_due(first)
        self._note(belief)
        self._lay_if_due(belief)

    def end(self, belief: Belief) -> None:
        """Lay the last waypoint where the robot stopped, unless one is near; commit what is left.

        Raises
        ------
        ConfigError
            If there was no motion, or nobody ever knew the pose.
        """
        if not self._has_motion:
            raise self._no_motion("in the whole recording")
        if not self._n_waypoints and belief.pose_map_base is None:
            raise ConfigError("nothing was taught, because the pose was never known: give start: [x, y, deg]")
        if belief.travelled_m - self._last_m >= self._spacing_m / 2 and belief.pose_map_base is not None:
            self._lay(belief)
        self._store.commit()

    def _note(self, belief: Belief) -> None:
        if self._log is not None:
            self._log.note(belief, self.offset_m + belief.travelled_m)

    def _lay_if_due(self, belief: Belief) -> None:
        if belief.travelled_m >= self._next_m - _SLACK_M and belief.pose_map_base is not None:
            self._lay(belief)

    def _lay(self, belief: Belief) -> None:
        assert belief.pose_map_base is not None
        began_ns = perf_counter_ns()
        station_m = self.offset_m + belief.travelled_m
        self._store.append(Waypoint(self._n_waypoints, station_m, belief.pose_map_base))
        self._store.commit()
        self.stamps[station_m] = belief.stamp_s
        self._times.append(perf_counter_ns() - began_ns)
        self._n_waypoints += 1
        self._last_m = belief.travelled_m
        self._next_m = (math.floor((belief.travelled_m + _SLACK_M) / self._spacing_m) + 1) * self._spacing_m
        self._counters["teach.waypoints"] += 1

    def _no_motion(self, when: str) -> ConfigError:
        return ConfigError(
            f"teaching needs motion, and {when} no localizer has given any: add 'odometry' with the robot's wheel"
            " odometry, or 'constant_speed' if there is none"
        )


def _distance(end: Pose2, start: Pose2 | None, otherwise_m: float) -> float:
    return otherwise_m if start is None else end.distance_to(start)
