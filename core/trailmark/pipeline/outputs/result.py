"""What a run hands out: one step for each frame, and what is left of it in the end."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from trailmark.commands import Command
from trailmark.estimates import Belief, EstimateRecord
from trailmark.frames import Frame
from trailmark.frames.outlines import Outlines
from trailmark.geometry import Trajectory

__all__ = ["RunResult", "Status", "Step"]

Status = Literal["done", "stopped", "interrupted", "failed"]


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


@dataclass(frozen=True, slots=True, eq=False)
class RunResult:
    """How a run ended, and what it gave.

    Attributes
    ----------
    status : {"done", "stopped", "interrupted", "failed"}
        At the end of the frames or the goal; by the guard; by the user; by an error.
    reason : str
        One line; empty for a plain end.
    counters : mapping of str to int
        Everything that was counted, by dotted name.
    trajectories : mapping of str to Trajectory
        ``fused``, and one of each localizer.
    ground_truth : Trajectory or None
        Where a source knows it.
    timing : mapping
        As in ``timing.json``: ``stages``, ``peak_rss_mb``, ``frames``, ``wall_s``.
    folder : Path or None
        The run's folder.
    outlines : Outlines or None
        What stands around and how large the robot is, where a source knows it.
    metrics : mapping
        As in ``metrics.json``; empty unless `trailmark.run` computed them.
    """

    status: Status
    reason: str = ""
    counters: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    trajectories: Mapping[str, Trajectory] = field(default_factory=lambda: MappingProxyType({}), repr=False)
    ground_truth: Trajectory | None = field(default=None, repr=False)
    timing: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}), repr=False)
    folder: Path | None = None
    outlines: Outlines | None = field(default=None, repr=False)
    metrics: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}), repr=False)
