"""The robot of a run: it takes commands from the loop, and `Stop` from any thread."""

from __future__ import annotations

import logging
import threading

from trailmark.commands import Command, Stop
from trailmark.failures import raise_failure
from trailmark.interfaces import Drivable

__all__ = ["Robot"]

logger = logging.getLogger(__name__)

# A driver that has not come back by then hangs: `Stop` is given to it beside that call [s].
_PATIENCE_S = 0.05


class Robot:
    """Gives commands to a `Drivable`, one at a time.

    A robot that is held has got `Stop` from another thread, and takes nothing else until it is released: what the
    loop had in work when it was held is of the past.

    Parameters
    ----------
    drivable : Drivable
        Takes the commands.
    """

    def __init__(self, drivable: Drivable) -> None:
        self._drivable = drivable
        self._lock = threading.Lock()
        self._held: Stop | None = None
        self._is_for_good = self._has_ended = False
        self._is_under_way = False

    @property
    def is_under_way(self) -> bool:
        """Whether the last command that it got was to move."""
        return self._is_under_way

    @property
    def held_by(self) -> Stop | None:
        """The `Stop` by which it is held; None while it is not."""
        return self._held

    def drive(self, command: Command) -> None:
        """Give a command of the loop; while the robot is held, only `Stop` reaches it.

        Raises
        ------
        RunError
            If the robot fails at it.
        """
        with self._lock:
            if self._held is not None and not isinstance(command, Stop):
                return
            self._give(command)
        if self._held is not None and not isinstance(command, Stop):
            self._give(self._held)  # it was held while it took the command: which of the two came last is not known

    def hold(self, stop: Stop, *, for_good: bool = False) -> None:
        """Stop the robot from any thread, and let it take no other command; a driver that hangs is not waited for.

        Parameters
        ----------
        stop : Stop
            Says why.
        for_good : bool
            Whether `release` has no effect any more.

        Raises
        ------
        RunError
            If the robot fails at it.
        """
        if self._has_ended and not self._is_under_way:
            return  # it has got its last command, and may be closed by now
        if for_good:  # set, never taken back: the watchdog may hold the robot at the same time
            self._is_for_good = True
        self._held = stop
        is_ours = self._lock.acquire(timeout=_PATIENCE_S)
        try:
            if not is_ours:
                logger.warning("the robot has not come back from its last command: it is given Stop beside that")
            self._give(stop)
        finally:
            self._has_ended = self._is_for_good
            if is_ours:
                self._lock.release()

    def release(self) -> bool:
        """Let the robot take commands again; return whether it does, and is not stopped for good."""
        if not self._is_for_good:
            self._held = None
        return not self._is_for_good

    def _give(self, command: Command) -> None:
        if not isinstance(command, Stop):
            self._is_under_way = True
        try:
            self._drivable.drive(command)
        except BaseException as error:
            raise_failure(error, "the robot", f"drive({command})", keeps=())
        if isinstance(command, Stop):
            self._is_under_way = False
