"""The paper's figures 10 to 13 and 16 to 18, of our runs, as SVG."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.geometry import Trajectory
from trailmark.report.drawing import BLUE, INK, RED, TRUTH, drawing, legend_above
from trailmark_papers.nagai2015.playback import Playback

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_indoor", "draw_outdoor"]

#: Points of a way farther apart than this are drawn [m].
_STEP_M = 0.05
#: So many of the longest labels stand beside each other without running out of the figure.
_LEGEND_COLUMNS = 3


def draw_indoor(out: Path, found: Playback, poles: Floats) -> None:
    """Draw Figs. 10 to 13; poles (N, 3) are x, y and radius [m]."""
    _draw(out / "figure_10_registered_path.svg", lambda axes: _draw_registration(axes, found, poles), 3.4)
    _draw(out / "figure_11_with_and_without_correction.svg", lambda axes: _with_and_without(axes, found), 3.4)
    _draw(out / "figure_12_offset_from_the_path.svg", lambda axes: _offsets(axes, found))
    _draw(out / "figure_13_error_detected.svg", lambda axes: _draw_detection(axes, found))


def draw_outdoor(out: Path, found: Sequence[Playback]) -> None:
    """Draw Figs. 16 to 18 of the ways of a day: forward, and back."""
    _draw(out / "figure_16_trajectories_outdoors.svg", lambda axes: _trajectories(axes, found), 5.2)
    _draw(out / "figure_17_deviation_outdoors.svg", lambda axes: _deviations(axes, found))
    _draw(out / "figure_18_way_between_corrections.svg", lambda axes: _intervals(axes, found))


def _draw(path: Path, draw: Callable[[Axes], None], height_inch: float = 2.8) -> None:
    with drawing(path, height_inch) as (figure, axes):
        draw(axes)
        legend_above(figure, _LEGEND_COLUMNS)


def _draw_registration(axes: Axes, found: Playback, poles: Floats) -> None:
    points = np.array([keyframe.pose_map_base.array()[:2] for keyframe in found.registrations])
    axes.plot(*points.T, ".", color=BLUE, markersize=2.5, label=f"{len(points)} registrations")
    if len(poles):
        axes.plot(*poles[:, :2].T, "o", color=INK, markersize=4.0, label="poles of the gates")
    _plane(axes)


def _with_and_without(axes: Axes, found: Playback) -> None:
    _way(axes, found.taught, TRUTH, "taught", width=4.0)
    _way(axes, found.relative_only, BLUE, "without correction")
    _way(axes, found.fused, RED, "with correction")
    _plane(axes)


def _offsets(axes: Axes, found: Playback) -> None:
    offsets_mm = 1e3 * found.at_searches()[:, 1]
    _by_direction(axes, found, found.travelled_m, offsets_mm)
    axes.set_title("offset of the vehicle from the recorded path [mm]")
    axes.set_xlabel("way [m]")


def _draw_detection(axes: Axes, found: Playback) -> None:
    believed = found.searches.is_found
    axes.plot(found.travelled_m[believed], 1e3 * found.detected_m(), color=BLUE, linewidth=0.8)
    axes.set_ylim(bottom=0.0)
    axes.set_title("error detected by the absolute search [mm]")
    axes.set_xlabel("way [m]")


def _trajectories(axes: Axes, found: Sequence[Playback]) -> None:
    _way(axes, found[0].taught, TRUTH, "recording", width=4.0)
    for playback, colour, label in zip(found, (BLUE, RED), ("forward", "reverse")):
        _way(axes, playback.relative_only, colour, f"{label}, without correction", width=0.7)
    for playback, colour, label in zip(found, (BLUE, RED), ("forward", "reverse")):
        _way(axes, playback.fused, colour, label, width=1.4)
    _plane(axes)


def _deviations(axes: Axes, found: Sequence[Playback]) -> None:
    for playback in found:
        offsets = playback.at_searches()
        _by_direction(axes, playback, offsets[:, 0], 1e3 * offsets[:, 1])
    axes.set_title("deviation of the vehicle from the recorded path [mm]")
    axes.set_xlabel("station on the path [m]")


def _intervals(axes: Axes, found: Sequence[Playback]) -> None:
    began_m = 0.0
    for playback, colour, label in zip(found, (BLUE, RED), ("forward", "reverse")):
        way_m = playback.travelled_m[playback.searches.is_found][1:]
        axes.plot(began_m + way_m, 1e3 * playback.intervals_m(), color=colour, linewidth=0.8, label=label)
        began_m += float(playback.travelled_m[-1])
    axes.set_ylim(bottom=0.0)
    axes.set_title("way between corrections [mm]")
    axes.set_xlabel("way [m]")


def _by_direction(axes: Axes, found: Playback, x: Floats, y: Floats) -> None:
    """Draw values at the searches, in a colour of its own for each direction; a gap where it turns."""
    for direction, colour, label in ((1, BLUE, "forward"), (-1, RED, "reverse")):
        values = np.where(found.directions == direction, y, np.nan)
        if np.isfinite(values).sum() > 5:  # where it stands at first it drives neither way
            axes.plot(x, values, color=colour, linewidth=0.8, label=label)


def _way(axes: Axes, trajectory: Trajectory, colour: str, label: str, width: float = 1.2) -> None:
    step = np.floor(trajectory.travelled_m() / _STEP_M)
    kept = np.concatenate([[True], np.diff(step) > 0])
    points: Any = trajectory.positions[kept]
    axes.plot(*points.T, color=colour, linewidth=width, label=label)


def _plane(axes: Axes) -> None:
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title("y [m]")
    axes.set_xlabel("x [m]")
