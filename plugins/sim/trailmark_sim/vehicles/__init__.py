"""Vehicles: pure functions from a state and a command to the next state."""

from trailmark_sim.vehicles.ackermann import Ackermann
from trailmark_sim.vehicles.base import Vehicle, VehicleState, WheelErrors
from trailmark_sim.vehicles.holonomic import Holonomic
from trailmark_sim.vehicles.steering import FourWheelSteering
from trailmark_sim.vehicles.tracks import Differential, SkidSteer

__all__ = [
    "Ackermann",
    "Differential",
    "FourWheelSteering",
    "Holonomic",
    "SkidSteer",
    "Vehicle",
    "VehicleState",
    "WheelErrors",
]
