"""What a pipeline hands out: one step for each frame."""

from __future__ import annotations

from dataclasses import dataclass

from trailmark.commands import Command
from trailmark.estimates import Belief, EstimateRecord
from trailmark.frames import Frame

__all__ = ["Step"]


@dataclass(frozen=True, slots=True)
class Step:
    """A frame went through the pipeline; or, in real time, the controller was asked between two frames.

    Attributes
    ----------
    stamp_s : float
        Of the frame, or of the controller's tick [s].
    frame : Frame or None
        The frame; None for a tick.
    belief : Belief
        What is believed at `stamp_s`, after all localizers saw the frame.
    estimates : tuple of EstimateRecord
        What was said since the last step, in the order in which it was applied.
    command : Command or None
        What the robot was told, if anything.
    """

    stamp_s: float
    frame: Frame | None
    belief: Belief
    estimates: tuple[EstimateRecord, ...] = ()
    command: Command | None = None
