"""The motion of a vehicle on a fixed grid of time, so that adding a sensor changes nothing."""

from __future__ import annotations

import numpy as np

from trailmark.arrays import Floats
from trailmark.commands import Command, Stop
from trailmark.geometry import Pose2
from trailmark_sim.pilots import Driver
from trailmark_sim.rng import frame_rng
from trailmark_sim.vehicles import Vehicle, VehicleState

__all__ = ["VehicleIntegrator"]

#: Steps of the physics [s]; lags are integrated in closed form, so that shorter ones change little.
_TICK_S = 0.004
#: The pilot looks every so many ticks.
_TICKS_PER_LOOK = 5
_SLIP_BLOCK = 1024
_STANDSTILL_MPS = 1e-4


class VehicleIntegrator:
    """Integrates a vehicle; asked for the state at stamps that do not go back.

    Steps lie on a grid. A state between two grid points is computed and thrown away again, so that the way does
    not depend on when it is looked at. Only a command cuts a step in two.

    Parameters
    ----------
    vehicle : Vehicle
        What moves.
    pose : Pose2
        Where it stands at stamp 0.
    seed : int
        Of the wheels' slip.
    pilot : Driver or None
        Drives until the first command is given; None: it stands until then.
    """

    def __init__(self, vehicle: Vehicle, pose: Pose2, seed: int, pilot: Driver | None) -> None:
        self._vehicle, self._seed = vehicle, seed
        self.pilot = pilot
        self._state = VehicleState(pose)
        self._command: Command = Stop("nobody drives yet")
        self._time_s, self._tick = 0.0, 0
        self._slip: Floats = np.empty((0, 2))
        self.stands_since_s = 0.0

    def state_at(self, stamp_s: float) -> VehicleState:
        """Return the state at a stamp."""
        while (self._tick + 1) * _TICK_S <= stamp_s:
            if self.pilot is not None and self._tick % _TICKS_PER_LOOK == 0:
                self._command = self.pilot.step(self._state)
            self._advance((self._tick + 1) * _TICK_S)
            self._tick += 1
        rest_s = stamp_s - self._time_s
        return self._step(rest_s) if rest_s > 0.0 else self._state

    def command(self, stamp_s: float, command: Command) -> None:
        """Follow a command from a stamp on, and not the pilot any more."""
        if self.state_at(stamp_s) is not self._state:
            self._advance(stamp_s)
        self.pilot = None
        self._command = command

    @property
    def has_finished(self) -> bool:
        """Whether the route or the task is done and the vehicle stands."""
        is_done = isinstance(self._command, Stop) and self._command.done
        return is_done and self._stands(self._state)

    def _advance(self, stamp_s: float) -> None:
        self._state = self._step(stamp_s - self._time_s)
        self._time_s = stamp_s
        if not self._stands(self._state):
            self.stands_since_s = stamp_s

    def _step(self, dt_s: float) -> VehicleState:
        block, row = divmod(self._tick, _SLIP_BLOCK)
        if row == 0 or len(self._slip) == 0:
            self._slip = frame_rng(self._seed, "slip", block).standard_normal((_SLIP_BLOCK, 2))
        slip = (float(self._slip[row, 0]), float(self._slip[row, 1]))
        return self._vehicle.step(self._state, self._command, dt_s, slip)

    @staticmethod
    def _stands(state: VehicleState) -> bool:
        twist = state.twist
        return max(abs(twist.forward_mps), abs(twist.left_mps), abs(twist.yaw_radps)) < _STANDSTILL_MPS
