"""Goal seeking: drive to a pose in the map from wherever the robot finds itself (Tasaki et al. 2010, Sec. IV-C)."""

from __future__ import annotations

import math

import numpy as np

from trailmark.commands import Command, Stop, Velocity
from trailmark.estimates import Belief
from trailmark.geometry import Pose2, wrap_angle
from trailmark.interfaces import Controller, Session
from trailmark_controllers.goal_seeking_config import GoalSeekingConfig
from trailmark_controllers.taught_way import TaughtWay

__all__ = ["GoalSeeking"]

_SEARCH_DEG = 720.0
_LEAVE_FACTOR = 2.0  # the goal is left again only this many tolerances away: a turn on it moves the belief a little


class GoalSeeking(Controller):
    """Drives to a goal with `Velocity` commands, and stands while it does not know where it is.

    In replay it goes along the taught path, which was free, as far as that leads towards the goal; from there, and
    without a path from the start, straight.
    """

    config: GoalSeekingConfig

    @property
    def gives(self) -> frozenset[type[Command]]:
        """`Velocity` and `Stop`."""
        return frozenset({Velocity, Stop})

    def start(self, session: Session) -> None:
        """Take the goal; forget the last drive."""
        x, y, *heading_deg = self.config.goal
        self._goal = Pose2(x, y, math.radians(heading_deg[0]) if heading_deg else 0.0)
        self._has_heading = bool(heading_deg)
        path = session.path if self.config.way == "taught" else None
        self._way = None if path is None else TaughtWay(path, self._goal, self.config.lookahead_m)
        self._is_there = False
        self._n_settled = 0
        self._search_began_s: float | None = None

    def step(self, belief: Belief) -> Command:
        """Return the velocity for a belief; `Stop` while lost, `Stop(done=True)` at the goal."""
        pose = belief.pose_map_base
        reason = self._why_stand(belief)
        if pose is None or reason:
            self._n_settled = 0
            return self._look_around(belief.stamp_s) if pose is None else Stop(reason)
        self._search_began_s = None
        next_point = self._way.next_point(pose) if self._way is not None else None
        if next_point is not None:
            return self._along(pose.between(next_point))
        to_goal = pose.between(self._goal)
        distance_m = math.hypot(to_goal.x, to_goal.y)
        limit_m = self.config.arrive_m * (_LEAVE_FACTOR if self._is_there else 1.0)
        self._is_there = distance_m <= limit_m
        turn_rad = to_goal.theta if self._has_heading else 0.0
        if self._is_there and abs(turn_rad) <= math.radians(self.config.arrive_deg):
            return self._settle()
        self._n_settled = 0
        if self._is_there:
            return Velocity(0.0, 0.0, self._yaw(turn_rad))
        if self.config.drive == "holonomic":
            return self._any_way(to_goal, distance_m, turn_rad)
        return self._turn_and_drive(to_goal, distance_m)

    def _why_stand(self, belief: Belief) -> str:
        """Return why the robot must not move, or nothing."""
        config = self.config
        if belief.pose_map_base is None:
            return "the pose is not known yet"
        if config.max_fix_age_m is not None and belief.fix_age_m > config.max_fix_age_m:
            if math.isinf(belief.fix_age_m):
                return "lost: no fix yet"
            return f"lost: {belief.fix_age_m:.2f} m without a fix"
        if belief.covariance is not None:
            sigma_m = math.sqrt(max(0.0, float(np.linalg.eigvalsh(belief.covariance[:2, :2])[-1])))
            if sigma_m > config.max_sigma_m:
                return f"lost: the position is known to {sigma_m:.2f} m only"
        return ""

    def _look_around(self, stamp_s: float) -> Command:
        """Stand and look, then turn on the spot, twice around; then stand, and leave it to the guard to end the run."""
        search_dps = self.config.search_dps
        if self._search_began_s is None:
            self._search_began_s = stamp_s
        turning_s = stamp_s - self._search_began_s - self.config.search_wait_s
        if turning_s < 0.0:
            return Stop("looking around")
        if search_dps * turning_s >= _SEARCH_DEG or search_dps == 0.0:
            return Stop("the pose is not known yet")
        return Velocity(0.0, 0.0, math.radians(search_dps))

    def _settle(self) -> Stop:
        self._n_settled += 1
        if self._n_settled >= self.config.settle_steps:
            return Stop("the goal is reached", done=True)
        return Stop("at the goal, making sure")

    def _along(self, to_point: Pose2) -> Velocity:
        """Head for a point of the taught path, without braking for it."""
        self._n_settled, self._is_there = 0, False
        far_m = max(self.config.slow_down_m, math.hypot(to_point.x, to_point.y))
        if self.config.drive == "holonomic":
            bearing_rad = math.atan2(to_point.y, to_point.x)
            speed_mps = self._speed_mps(far_m)
            return Velocity(speed_mps * math.cos(bearing_rad), speed_mps * math.sin(bearing_rad), 0.0)
        return self._turn_and_drive(to_point, far_m)

    def _turn_and_drive(self, to_goal: Pose2, distance_m: float) -> Velocity:
        """Turn towards the goal and drive; nearby goals behind are reached backwards."""
        angle_rad, direction = math.atan2(to_goal.y, to_goal.x), 1.0
        if abs(angle_rad) > math.pi / 2 and distance_m < self.config.reverse_m:
            angle_rad, direction = wrap_angle(angle_rad + math.pi), -1.0
        if abs(angle_rad) > math.radians(self.config.turn_first_deg):
            return Velocity(0.0, 0.0, self._yaw(angle_rad))
        speed_mps = self._speed_mps(distance_m) * math.cos(angle_rad)
        return Velocity(direction * speed_mps, 0.0, self._yaw(angle_rad))

    def _any_way(self, to_goal: Pose2, distance_m: float, turn_rad: float) -> Velocity:
        speed_mps = self._speed_mps(distance_m)
        return Velocity(speed_mps * to_goal.x / distance_m, speed_mps * to_goal.y / distance_m, self._yaw(turn_rad))

    def _speed_mps(self, distance_m: float) -> float:
        config = self.config
        if config.slow_down_m == 0.0:
            return config.speed_mps
        return min(config.speed_mps, max(config.creep_mps, config.speed_mps * distance_m / config.slow_down_m))

    def _yaw(self, angle_rad: float) -> float:
        limit_radps = math.radians(self.config.turn_dps)
        return min(max(self.config.turn_gain * angle_rad, -limit_radps), limit_radps)
