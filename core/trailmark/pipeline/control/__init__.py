"""Who moves the robot: the controller's commands and the guard's, and the watchdog when the run stands still."""

from __future__ import annotations

from trailmark.pipeline.control.commands import Control, Guard, check_commands
from trailmark.pipeline.control.robot import Robot

__all__ = ["Control", "Guard", "Robot", "check_commands"]
