"""A robot's true distance from its path, and the distance that it believed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from trailmark.arrays import Floats
from trailmark.evaluation import FUSED, GROUND_TRUTH, RunEvaluation, offsets_from_path
from trailmark.geometry import Trajectory
from trailmark.paths import Path
from trailmark.report.numbers import length_unit
from trailmark.report.style import WIDTH_INCH, LineStyle

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Offsets", "offset_series", "offsets_figure"]

#: Time since the start [s] and lateral offset [m], (N, 2), of each trajectory.
Offsets = Mapping[str, Floats]

# To find a pose on the path takes a while.
_MAX_POINTS = 800
_HEIGHT_INCH = 3.0


def offset_series(evaluated: RunEvaluation, path: Path | None) -> Offsets:
    """Return the offsets of the truth and of the belief; empty without a path."""
    run = evaluated.run
    ways = {GROUND_TRUTH: evaluated.truth_beside_path(), FUSED: run.trajectories.get(FUSED)}
    span = run.span_s()
    if path is None or len(path) < 2 or span is None:
        return {}
    return {name: _offsets(way, path, span[0]) for name, way in ways.items() if way is not None and len(way)}


def offsets_figure(series: Offsets, styles: Mapping[str, LineStyle]) -> Figure:
    """Draw the lateral offsets over time."""
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    air = ConstrainedLayoutEngine(h_pad=0.1, w_pad=0.02)  # between the legend and the drawing
    figure = Figure(figsize=(WIDTH_INCH, _HEIGHT_INCH), layout=air)
    axes = figure.subplots()
    unit, per_m = length_unit([float(np.sqrt(np.mean(line[:, 1] ** 2))) for line in series.values()])
    for name, line in series.items():
        style = styles[name]
        axes.plot(
            line[:, 0],
            per_m * line[:, 1],
            label=name,
            color=style.colour,
            linewidth=style.width,
            linestyle=style.dashes,
            zorder=style.order,
        )
    axes.set_title(f"Left of the path [{unit}]")
    axes.set_xlabel("time since start [s]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=len(series))
    return figure


def _offsets(way: Trajectory, path: Path, start_s: float) -> Floats:
    step = max(1, -(-len(way) // _MAX_POINTS))
    kept = Trajectory(way.stamps_s[::step], way.poses[::step])
    return np.column_stack([kept.stamps_s - start_s, offsets_from_path(kept, path)[:, 1]])
