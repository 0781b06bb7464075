"""What is left of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from trailmark.geometry import Trajectory

__all__ = ["RunResult", "Status"]

Status = Literal["done", "stopped", "interrupted", "failed"]


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
    metrics: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}), repr=False)
