"""Driving by hand: keys of the terminal become commands."""

from __future__ import annotations

import os
import select
import sys
from typing import Any

from trailmark.commands import Command, Steer4WS, Stop, Velocity
from trailmark.errors import ConfigError
from trailmark_sim.vehicles import FourWheelSteering, Vehicle, VehicleState

__all__ = ["KEYS_HELP", "KeyboardPilot", "Terminal"]

KEYS_HELP = "w faster, s slower or backwards, a left, d right, c straight, space stop, q done"

#: What one key changes: speed as a share of the vehicle's, and curvature [1/m].
_SPEED_STEP, _TURN_STEP = 0.1, 0.1
_MOST_CURVATURE = 1.3


class KeyboardPilot:
    """Turns keys into commands; one key is one step of speed or of curvature.

    Parameters
    ----------
    vehicle : Vehicle
        What to drive.
    terminal : Terminal
        Where the keys come from.
    """

    def __init__(self, vehicle: Vehicle, terminal: Terminal) -> None:
        self._vehicle, self._terminal = vehicle, terminal
        self._speed, self._curvature = 0.0, 0.0
        self._is_done = False

    def step(self, state: VehicleState) -> Command:
        """Return what the keys pressed so far ask for."""
        for key in self._terminal.read_keys():
            self._press(key)
        if self._is_done:
            return Stop("q was pressed", done=True)
        speed_mps = self._speed * self._vehicle.max_speed_mps
        if isinstance(self._vehicle, FourWheelSteering):
            angle = self._vehicle.steering_for(self._curvature)
            return Steer4WS(angle, -angle, speed_mps)
        # On the spot it turns as if it drove slowly.
        pace = speed_mps or 0.3 * self._vehicle.max_speed_mps * (self._curvature != 0.0)
        return Velocity(speed_mps, 0.0, self._curvature * pace)

    def _press(self, key: str) -> None:
        if key in ("w", "s"):
            step = _SPEED_STEP if key == "w" else -_SPEED_STEP
            self._speed = round(min(1.0, max(-1.0, self._speed + step)), 9)
        elif key in ("a", "d"):
            step = _TURN_STEP if key == "a" else -_TURN_STEP
            self._curvature = round(min(_MOST_CURVATURE, max(-_MOST_CURVATURE, self._curvature + step)), 9)
        elif key == "c":
            self._curvature = 0.0
        elif key == " ":
            self._speed = 0.0
        elif key == "q":
            self._is_done = True


class Terminal:
    """A terminal whose keys come at once, without Enter, until it is closed.

    Parameters
    ----------
    descriptor : int, optional
        The terminal; default: standard input.

    Raises
    ------
    ConfigError
        If it is no terminal, or the system has none of this kind.
    """

    def __init__(self, descriptor: int | None = None) -> None:
        try:
            import termios
            import tty
        except ImportError:
            raise ConfigError("sim: driver keyboard needs a terminal of a Unix system; use driver: route") from None
        self._descriptor = sys.stdin.fileno() if descriptor is None else descriptor
        if not os.isatty(self._descriptor):
            raise ConfigError("sim: driver keyboard needs a terminal to read keys from; use driver: route")
        self._before: list[Any] | None = termios.tcgetattr(self._descriptor)
        tty.setcbreak(self._descriptor)

    def read_keys(self) -> str:
        """Return the keys pressed since the last call, oldest first; does not wait."""
        keys = ""
        while self._before is not None and select.select([self._descriptor], [], [], 0.0)[0]:
            data = os.read(self._descriptor, 64)
            if not data:
                break
            keys += data.decode(errors="ignore")
        return keys

    def close(self) -> None:
        """Put the terminal back as it was."""
        if self._before is not None:
            import termios

            termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)
            self._before = None
