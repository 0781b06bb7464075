"""What a pipeline hands out: one step for each frame."""

from __future__ import annotations

from dataclasses import dataclass

from trailmark.commands import Command
from trailmark.estimates import Applied, Belief, Estimate
from trailmark.frames import Frame

__all__ = ["Step", "Told"]


@dataclass(frozen=True, slots=True)
class Told:
    """An estimate, and what became of it.

    Attributes
    ----------
    arrived_s : float
        When it was applied; later than the frame for an async localizer [s].
    source : str
        Name of the localizer.
    estimate : Estimate
        What it said.
    applied : Applied
        What the estimator answered.
    """

    arrived_s: float
    source: str
    estimate: Estimate
    applied: Applied


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
    estimates : tuple of Told
        What was said since the last step, in the order in which it was applied.
    command : Command or None
        What the robot was told, if anything.
    """

    stamp_s: float
    frame: Frame | None
    belief: Belief
    estimates: tuple[Told, ...] = ()
    command: Command | None = None
