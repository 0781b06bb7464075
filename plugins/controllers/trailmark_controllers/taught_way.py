"""The way along a taught path towards a goal beside it: it was free when it was taught."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from trailmark.geometry import Pose2
from trailmark.paths import Path

__all__ = ["TaughtWay"]


@dataclass(slots=True)
class TaughtWay:
    """Says what to head for on the way to a goal.

    Parameters
    ----------
    path : Path
        The taught path.
    goal : Pose2
        Where to, in the map.
    lookahead_m : float
        How far ahead on the path the robot heads; as near to the goal's place on the path it heads for the goal [m].
    """

    path: Path
    goal: Pose2
    lookahead_m: float
    _goal_station_m: float = field(init=False)
    _station_m: float | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self._goal_station_m = self.path.locate(self.goal).station_m

    def next_point(self, pose_map_base: Pose2) -> Pose2 | None:
        """Return the point of the path to head for; None when the goal itself is next."""
        # Its own station: where the path comes near to itself, the robot stays on the part that it follows.
        self._station_m = self.path.locate(pose_map_base, self._station_m).station_m
        rest_m = self._goal_station_m - self._station_m
        if abs(rest_m) <= self.lookahead_m:
            return None
        return self.path.pose_at(self._station_m + math.copysign(self.lookahead_m, rest_m))
