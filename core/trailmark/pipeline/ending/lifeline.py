"""What is left to do for a run that cannot end in order: its robot is stopped, and what is known is written."""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

from trailmark.errors import TrailmarkError
from trailmark.interruption import Lifeline
from trailmark.pipeline.outputs.result import RunResult

if TYPE_CHECKING:
    from trailmark.pipeline.control import Control
    from trailmark.pipeline.outputs.recorder import Recorder

__all__ = ["RunLifeline"]

logger = logging.getLogger(__name__)


class RunLifeline(Lifeline):
    """Acts for a run from another thread, while the run itself may stand anywhere.

    Parameters
    ----------
    control : Control or None
        Has the robot.
    recorder : Recorder or None
        Has the folder.
    conclude : callable
        Returns the result of the run as it stands, given the reason of its end.
    is_realtime : bool
        Whether the robot goes on while the process is suspended; at ``pace: step`` its time stands still, too.
    """

    def __init__(
        self,
        control: Control | None,
        recorder: Recorder | None,
        conclude: Callable[[str], RunResult],
        *,
        is_realtime: bool,
    ) -> None:
        self._control = control
        self._is_realtime = is_realtime
        self._recorder = recorder
        self._conclude = conclude

    def stop(self, reason: str) -> None:
        """Stop the robot, if there is one."""
        if self._control is None:
            return
        try:
            self._control.stop_for_good(reason)
        except TrailmarkError as error:
            logger.warning("%s", error)

    def hold(self, reason: str) -> None:
        """Stop the robot for as long as the process is suspended."""
        if self._control is None or not self._is_realtime:
            return
        try:
            self._control.hold(reason)
        except TrailmarkError as error:
            logger.warning("%s", error)

    def release(self) -> None:
        """Let the run command the robot again, from its next step but one on."""
        if self._control is not None:
            self._control.release()

    def mark(self, reason: str) -> None:
        """Let ``run.json`` say that the run was interrupted, unless the run has written its end itself."""
        if self._recorder is not None and not self._recorder.is_written:
            with suppress(Exception):  # nobody is left who could do something about it
                self._recorder.mark("interrupted", reason)

    def write(self, reason: str) -> None:
        """Write trajectories, times and counts as they stand."""
        if self._recorder is not None and not self._recorder.is_written:
            with suppress(Exception):  # the run may stand in the middle of a row
                self._recorder.write(self._conclude(reason))
