"""What a run hands out: one step for each frame, and what is left of it in the end."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import trailmark.frames
from trailmark.commands import Command
from trailmark.estimates import Belief, EstimateRecord
from trailmark.frames import Frame
from trailmark.geometry import Trajectory
from trailmark.geometry.notebook import pandas_module, plane_axes

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


@dataclass(frozen=True, slots=True, eq=False, repr=False)
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
    outlines: trailmark.frames.Outlines | None = field(default=None, repr=False)
    metrics: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}), repr=False)

    def __repr__(self) -> str:
        ended = f"{self.status}: {self.reason}" if self.reason else self.status
        where = "" if self.folder is None else f", folder {str(self.folder)!r}"
        return f"RunResult({ended}; trajectories {', '.join(self.trajectories) or 'none'}{where})"

    def to_frame(self) -> Any:
        """Return all poses as a pandas.DataFrame: ``trajectory``, ``stamp_s``, ``x``, ``y``, ``theta`` [s, m, m, rad].

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        ways = self._ways()
        pandas = pandas_module()
        frames = [way.to_frame().reset_index().assign(trajectory=name) for name, way in ways.items() if len(way)]
        columns = ["trajectory", "stamp_s", "x", "y", "theta"]
        return pandas.concat(frames, ignore_index=True)[columns] if frames else pandas.DataFrame(columns=columns)

    def plot(self, axes: Any = None) -> Any:
        """Draw all trajectories in the plane, as they are, and return the axes.

        Parameters
        ----------
        axes : matplotlib.axes.Axes, optional
            Where; default: the current ones of pyplot, as in a notebook.
        """
        axes = plane_axes(axes)
        for name, way in self._ways().items():
            if len(way):
                way.plot(axes, label=name, **_STYLES.get(name, {}))
        axes.legend()
        return axes

    def _repr_html_(self) -> str:
        """Return a small table, which notebooks show in place of the text."""
        ended = escape(f"{self.status}: {self.reason}" if self.reason else self.status)
        rows = "".join(_row_html(name, way, self.metrics) for name, way in self.trajectories.items())
        where = "" if self.folder is None else f"<p>{escape(str(self.folder / 'report.html'))}</p>"
        head = "<tr><th></th><th>poses</th><th>way [m]</th><th>rms error [m]</th></tr>"
        return f"<p><b>{ended}</b></p><table><thead>{head}</thead><tbody>{rows}</tbody></table>{where}"

    def _ways(self) -> dict[str, Trajectory]:
        """Return all trajectories, the truth first."""
        truth = {} if self.ground_truth is None else {"groundtruth": self.ground_truth}
        return truth | dict(self.trajectories)


#: Of the trajectories that every run has.
_STYLES: Mapping[str, Mapping[str, Any]] = {
    "groundtruth": {"color": "0.7", "linewidth": 4.0},
    "fused": {"color": "black"},
}


def _row_html(name: str, way: Trajectory, metrics: Mapping[str, Any]) -> str:
    known = metrics.get("trajectories", {}).get(name, {}).get("metrics", {})
    error = next((value for metric, value in known.items() if metric.startswith("ate_rmse_m")), None)
    cells = (escape(name), str(len(way)), f"{way.length_m():.4g}", "" if error is None else f"{error:.4g}")
    return f"<tr>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"
