"""Pilots: they know where the vehicle is and keep it on a route, as a practised person would."""

from __future__ import annotations

import math
from typing import Protocol

from trailmark.commands import Command, Steer4WS, Stop, Velocity
from trailmark.geometry import Pose2
from trailmark.paths import OnPath
from trailmark_sim.routes import Route
from trailmark_sim.vehicles import FourWheelSteering, Holonomic, SkidSteer, Vehicle, VehicleState

__all__ = ["Driver", "Pilot"]

#: Way over which an error of the position is driven out [m]: critically damped.
_CORRECT_OVER_M = 0.25
#: Deceleration towards the end of the route [m/s^2].
_BRAKE_MPS2 = 0.15
#: What it creeps with at the very end [m/s].
_CREEP_MPS = 0.01
#: This near to the end a place level with it is the end itself [m].
_NEAR_END_M = 0.1


class Driver(Protocol):
    """Drives without commands: a pilot on a route, a person at the keys."""

    def step(self, state: VehicleState) -> Command:
        """Return what to do now; `Stop` with `done` ends the run."""


class Pilot:
    """Drives a vehicle along a route, from its true state.

    Parameters
    ----------
    route : Route
        Where to drive.
    vehicle : Vehicle
        What to drive.
    station_m : float
        Where on the route it stands [m].
    """

    def __init__(self, route: Route, vehicle: Vehicle, station_m: float = 0.0) -> None:
        self._route = route
        self._vehicle = vehicle
        self._station_m = station_m
        self.has_arrived = False

    def step(self, state: VehicleState) -> Command:
        """Return what to do now; `Stop` with `done` at the end of the route."""
        pose = state.pose_map_base
        on_path = self._route.path.locate(pose, self._station_m, window_m=0.5)
        self._station_m = max(self._station_m, on_path.station_m)
        rest_m = self._route.length_m - self._along(pose, on_path)
        rolls_m = math.hypot(state.twist.forward_mps, state.twist.left_mps) * self._vehicle.speed_lag_s
        self.has_arrived = self.has_arrived or rest_m <= rolls_m
        if self.has_arrived:
            return Stop("the end of the route is reached", done=True)
        speed_mps = self._speed(rest_m)
        if isinstance(self._vehicle, Holonomic):
            return self._slide(on_path, speed_mps)
        curvature = self._curvature(on_path, speed_mps)
        if isinstance(self._vehicle, FourWheelSteering):
            angle = self._vehicle.steering_for(curvature)
            return Steer4WS(angle, -angle, speed_mps)
        share = self._vehicle.turn_share if isinstance(self._vehicle, SkidSteer) else 1.0  # the rest is skidding
        return Velocity(speed_mps, 0.0, curvature * speed_mps / share)

    def _along(self, pose: Pose2, on_path: OnPath) -> float:
        """Return the station, growing on beyond the end of the route."""
        length_m = self._route.length_m
        if length_m - on_path.station_m > _NEAR_END_M:  # a route may pass its own end long before it is there
            return on_path.station_m
        ahead = self._route.pose_at(length_m).inverse() @ pose
        return length_m + ahead.x if 0.0 < ahead.x < _NEAR_END_M else on_path.station_m

    def _speed(self, rest_m: float) -> float:
        """Return the speed from which it can still stop at the end."""
        return min(self._route.speed_mps, math.sqrt(2.0 * _BRAKE_MPS2 * max(rest_m, 0.0)) + _CREEP_MPS)

    def _curvature(self, on_path: OnPath, speed_mps: float) -> float:
        """Return the curvature that leads back to the route; the servos' lag is looked through."""
        vehicle = self._vehicle
        lag_s = vehicle.steer_lag_s if isinstance(vehicle, FourWheelSteering) else vehicle.speed_lag_s
        ahead = self._route.curvature_at(on_path.station_m + speed_mps * lag_s)
        return ahead - on_path.lateral_m / _CORRECT_OVER_M**2 - 2.0 * on_path.heading_rad / _CORRECT_OVER_M

    def _slide(self, on_path: OnPath, speed_mps: float) -> Velocity:
        """Return the velocity of a holonomic vehicle: along the way, sideways against the error."""
        tangent = self._route.path.tangent_at(on_path.station_m)
        heading = self._route.pose_at(on_path.station_m).theta + on_path.heading_rad
        left_mps = -on_path.lateral_m / _CORRECT_OVER_M * max(speed_mps, 0.05)
        turn = tangent - heading
        forward = speed_mps * math.cos(turn) - left_mps * math.sin(turn)
        sideways = speed_mps * math.sin(turn) + left_mps * math.cos(turn)
        yaw = self._route.curvature_at(on_path.station_m) * speed_mps - on_path.heading_rad / _CORRECT_OVER_M
        return Velocity(forward, sideways, yaw)
