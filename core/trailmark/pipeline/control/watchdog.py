"""The watchdog of a run in real time: when the loop stands still, another thread stops the robot."""

from __future__ import annotations

import logging
import sys
import threading
from pathlib import Path

from trailmark.clock import RunClock
from trailmark.commands import Stop
from trailmark.errors import TrailmarkError
from trailmark.pipeline.control.robot import Robot

__all__ = ["Watchdog"]

logger = logging.getLogger(__name__)

_JUST_AFTER_S = 1e-3


class Watchdog:
    """Watches the loop, and stops a moving robot when the loop stands still.

    A robot that stands is let be: before the first command there is nothing to stop, however long devices take to open
    and kernels to compile.

    Parameters
    ----------
    robot : Robot
        Is held when the loop stands still; the loop releases it when it comes back.
    clock : RunClock
        Knows when the loop last lived.
    stall_s : float
        For how long the loop may stand still [s].
    """

    def __init__(self, robot: Robot, clock: RunClock, stall_s: float) -> None:
        self._robot = robot
        self._clock = clock
        self._stall_s = stall_s
        self._closed = threading.Event()
        self._loop_ident = threading.get_ident()
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)

    def start(self) -> None:
        """Begin to watch the thread that calls this."""
        self._clock.beat()
        self._thread.start()

    def close(self) -> None:
        """Watch no longer."""
        self._closed.set()

    def _watch(self) -> None:
        often_s = look_s = self._stall_s / 4
        while not self._closed.wait(look_s):
            quiet_s = self._clock.quiet_s()
            left_s = self._stall_s - quiet_s
            look_s = min(left_s + _JUST_AFTER_S, often_s) if left_s > 0.0 else often_s
            if left_s <= 0.0 and self._robot.is_under_way:
                self._stop(quiet_s)

    def _stop(self, quiet_s: float) -> None:
        logger.warning(
            "the run has stood still for %.2f s (stop_when.stall_s: %g)%s: the robot is stopped until it goes on",
            quiet_s,
            self._stall_s,
            self._whereabouts(),
        )
        try:
            self._robot.hold(Stop(f"the run stood still for {quiet_s:.2f} s (stop_when.stall_s: {self._stall_s:g})"))
        except TrailmarkError as error:
            logger.warning("%s", error)

    def _whereabouts(self) -> str:
        """Return the place in the code where the loop is, for the message."""
        frame = sys._current_frames().get(self._loop_ident)
        if frame is None:
            return ""
        return f" in {frame.f_code.co_name}, {Path(frame.f_code.co_filename).name} line {frame.f_lineno}"
