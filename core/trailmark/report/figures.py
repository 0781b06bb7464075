"""The plots of a run. Drawn with matplotlib's Figure alone: no window, no global figure."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.evaluation import OUTCOMES
from trailmark.geometry import Trajectory
from trailmark.report.numbers import length_unit
from trailmark.report.series import ErrorSeries, Lane, way
from trailmark.report.style import INK, OUTCOME_COLOURS, WIDTH_INCH, LineStyle

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

__all__ = ["distribution_figure", "errors_figure", "outcomes_figure", "trajectories_figure"]

_HEIGHT = 5.0
_LEGEND_CHARACTERS = 72
_LEGEND_ROW = 0.21
_N_BINS = 60
# Above this ratio the best line would lie on the axis of the worst.
_LOGARITHMIC_ABOVE = 20.0


def trajectories_figure(trajectories: Mapping[str, Trajectory], styles: Mapping[str, LineStyle]) -> Figure:
    """Draw the ways in the plane with equal axes; the start of each is marked."""
    figure, axes = _figure(_plane_height(trajectories) + _legend_height(trajectories))
    for name, trajectory in trajectories.items():
        points, style = way(trajectory), styles[name]
        axes.plot(*points.T, **_line(name, style))
        if len(trajectory):
            axes.plot(*points[0], "o", color=style.colour, markersize=4.5, zorder=style.order + 0.5)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title("y [m]")
    axes.set_xlabel("x [m]")
    _legend(figure, axes)
    return figure


def errors_figure(series: Mapping[str, ErrorSeries], styles: Mapping[str, LineStyle], are_errors: bool) -> Figure:
    """Draw position and heading errors (or differences) over time."""
    figure, (above, below) = _figure(_HEIGHT + _legend_height(series), rows=2)
    word = "error" if are_errors else "difference"
    rms = [_rms(item.position_m) for item in series.values()]
    unit, per_m = length_unit(rms)
    for name, item in series.items():
        above.plot(item.time_s, per_m * item.position_m, **_line(name, styles[name]))
        below.plot(item.time_s, item.heading_deg, **_line(name, styles[name]))
    above.set_title(f"Position {word} [{unit}]")
    below.set_title(f"Heading {word} [°]")
    below.set_xlabel("time since start [s]")
    positive = [value for value in rms if value > 0.0]
    if positive and max(positive) > _LOGARITHMIC_ABOVE * min(positive):
        _logarithmic(above, per_m * min(positive) / 10.0)
    else:
        above.set_ylim(bottom=0.0)
    _legend(figure, above)
    return figure


def outcomes_figure(found: Sequence[Lane]) -> Figure:
    """Draw what became of the estimates of each localizer: in each lane the shares of the outcomes over time."""
    figure, axes = _figure(1.25 + 0.42 * len(found))
    for row, lane in enumerate(found):
        _draw_lane(axes, lane, bottom=-row)
    axes.set_yticks([0.36 - row for row in range(len(found))], [lane.name for lane in found])
    axes.tick_params(axis="y", length=0, labelcolor=INK)
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    axes.set_ylim(0.06 - len(found) + 0.76, 0.9)
    axes.set_xlabel("time since start [s]")
    _outcome_legend(figure, [word for word in OUTCOMES if any(word in lane.counts for lane in found)])
    return figure


def distribution_figure(errors: Mapping[str, Floats], styles: Mapping[str, LineStyle]) -> Figure:
    """Draw how often errors of each size were made: for each trajectory a histogram over a box plot; logarithmic.

    The box holds half of the errors, its mark is the median, the line reaches from 2.5 to 97.5 %.
    """
    figure, axes = _figure(1.0 + 0.62 * len(errors))
    positive = {name: values[values > 0.0] for name, values in errors.items()}
    unit, per_m = length_unit([_rms(values) for values in positive.values() if len(values)])
    everything = np.concatenate([per_m * values for values in positive.values()])
    low, high = (np.quantile(everything, share) for share in (0.002, 1.0)) if len(everything) else (1.0, 10.0)
    edges = np.geomspace(low, max(high, 1.001 * low) * 1.001, _N_BINS + 1)
    for row, (name, values) in enumerate(positive.items()):
        if len(values):
            _draw_distribution(axes, per_m * values, edges, -row, styles[name])
    axes.set_xscale("log")
    axes.set_xlim(edges[0], edges[-1])
    _label_logarithmic(axes.xaxis)
    axes.set_yticks([0.2 - row for row in range(len(errors))], list(errors))
    axes.tick_params(axis="y", length=0, labelcolor=INK)
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    axes.set_ylim(0.72 - len(errors), 0.8)
    axes.set_xlabel(f"[{unit}], logarithmic")
    return figure


def _draw_distribution(axes: Axes, values: Floats, edges: Floats, bottom: float, style: LineStyle) -> None:
    counts, _ = np.histogram(values, edges)
    level = bottom + 0.62 * counts / max(1, counts.max())
    axes.fill_between(
        edges, bottom, np.append(level, level[-1]), step="post", color=style.colour, alpha=0.45, linewidth=0.0
    )
    outer, lower, middle, upper, last = np.quantile(values, [0.025, 0.25, 0.5, 0.75, 0.975])
    y = bottom - 0.11
    axes.plot([outer, last], [y, y], color=style.colour, linewidth=1.0, solid_capstyle="butt")
    axes.plot([lower, upper], [y, y], color=style.colour, linewidth=5.0, solid_capstyle="butt")
    axes.plot([middle], [y], "o", color=INK, markersize=4.5)


def _figure(height: float, rows: int = 1) -> tuple[Figure, Any]:
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    air = ConstrainedLayoutEngine(h_pad=0.1, w_pad=0.02)  # between the legend and the drawing
    figure = Figure(figsize=(WIDTH_INCH, height), layout=air)
    return figure, figure.subplots(rows, sharex=True)


def _line(name: str, style: LineStyle) -> dict[str, Any]:
    return {
        "label": name,
        "color": style.colour,
        "linewidth": style.width,
        "linestyle": style.dashes,
        "zorder": style.order,
    }


def _plane_height(trajectories: Mapping[str, Trajectory]) -> float:
    """Return a height that suits the shape of the ways, between a strip and a square [inch]."""
    positions = np.concatenate([np.zeros((1, 2)), *(item.positions for item in trajectories.values() if len(item))])
    width_m, height_m = np.ptp(positions[1:], axis=0) if len(positions) > 1 else (1.0, 1.0)
    shape = float(height_m / max(width_m, height_m, 1e-9))
    return 1.1 + (WIDTH_INCH - 1.0) * min(1.0, max(0.3, 1.1 * shape))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.nanmean(values * values)))


def _logarithmic(axes: Axes, lowest: float) -> None:
    axes.set_yscale("log")
    axes.set_ylim(bottom=lowest)
    _label_logarithmic(axes.yaxis)
    axes.set_title(axes.get_title(loc="left") + ", logarithmic")


def _label_logarithmic(axis: Axis) -> None:
    """Write plain numbers at an axis: the fewer decades it has, the more of them; matplotlib's own are formulas."""
    from matplotlib.ticker import LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    decades = math.log10(high / low)
    steps = (1.0, 2.0, 3.0, 5.0, 7.0) if decades < 1.0 else (1.0, 2.0, 5.0) if decades < 2.5 else (1.0,)
    axis.set_major_locator(LogLocator(subs=steps))
    axis.set_major_formatter(lambda value, _position: f"{value:g}")
    axis.set_minor_formatter(NullFormatter())


def _legend(figure: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    if labels:
        figure.legend(handles, labels, loc="outside upper left", ncols=_legend_columns(labels))


def _legend_columns(names: Collection[str]) -> int:
    return max(1, min(len(names), _LEGEND_CHARACTERS // (max(map(len, names)) + 7)))


def _legend_height(names: Collection[str]) -> float:
    """Return what the legend needs beyond its first line, so that it takes nothing from the drawing [inch]."""
    return _LEGEND_ROW * (math.ceil(len(names) / _legend_columns(names)) - 1) if names else 0.0


def _draw_lane(axes: Axes, lane: Lane, bottom: float) -> None:
    level = np.full(len(lane.edges_s) - 1, bottom, dtype=np.float64)
    for outcome in OUTCOMES:
        upper = level + 0.72 * lane.shares[outcome]
        if (upper > level).any():
            axes.fill_between(
                lane.edges_s,
                np.append(level, level[-1]),
                np.append(upper, upper[-1]),
                step="post",
                color=OUTCOME_COLOURS[outcome],
                linewidth=0.0,
            )
        level = upper


def _outcome_legend(figure: Figure, outcomes: Sequence[str]) -> None:
    from matplotlib.patches import Patch

    handles = [Patch(facecolor=OUTCOME_COLOURS[outcome], edgecolor="none", label=outcome) for outcome in outcomes]
    if handles:
        figure.legend(handles=handles, loc="outside upper left", ncols=len(handles), handlelength=0.9, handleheight=0.9)
