"""Figs. 6 and 7 as drawings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from trailmark.arrays import Floats
from trailmark.report.drawing import INK, MUTED, RULE
from trailmark.report.style import line_styles
from trailmark_papers.kit import panels

if TYPE_CHECKING:
    from trailmark_papers.tasaki2010.variants import Answers

__all__ = ["draw_line", "draw_routes"]

_NAMES = {"developed": "developed", "plain": "SURF only, least squares"}
#: Middle of the shelves of the simulated supermarket, and their size, for the drawing alone [m].
_SHELVES = tuple((x, y) for y in (4.6, 6.6, 8.6) for x in (3.2, 7.0))
_SHELF_M = (2.4, 0.8)


class _PlottedRoute(Protocol):
    @property
    def way(self) -> Floats: ...
    @property
    def believed(self) -> Floats: ...


def draw_line(path: Path, answers: Mapping[str, Answers]) -> None:
    """Draw where both methods say the robot is, beside the route (Fig. 6)."""
    title = "Positions along the line by the wall, y [m]"
    with panels(path, 3.4, title, xlabel="x [m]", name="fig6") as (_, (axes,)):
        styles = line_styles(_NAMES)
        axes.plot(*answers["developed"].truth[:, :2].T, color=MUTED, linewidth=1.2, label="where the robot was")
        for name, marker in (("plain", "^"), ("developed", "s")):
            said = answers[name].said[:, :2]
            axes.plot(*said.T, marker, color=styles[name].colour, markersize=3.0, label=_NAMES[name])
        axes.set_xlim(0.0, 6.0)
        axes.set_ylim(0.0, 4.0)  # as in the paper; what lies outside is not drawn
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=3)


def draw_routes(path: Path, drives: Sequence[_PlottedRoute], goal: tuple[float, float]) -> None:
    """Draw the ways to the goal, true and believed (Fig. 7)."""
    from matplotlib.patches import Circle, Rectangle

    title = "Routes to the goal (line: true, dots: believed), y [m]"
    with panels(path, 6.4, title, xlabel="x [m]", name="fig7") as (_, (axes,)):
        for x, y in _SHELVES:
            corner = (x - _SHELF_M[0] / 2, y - _SHELF_M[1] / 2)
            axes.add_patch(Rectangle(corner, *_SHELF_M, facecolor=RULE, edgecolor=MUTED, linewidth=0.8))
        styles = line_styles(f"trial {k + 1}" for k in range(len(drives)))
        for (name, style), drive in zip(list(styles.items())[2:], drives):
            axes.plot(*drive.believed.T, ".", color=style.colour, markersize=2.0)
            axes.plot(*drive.way.T, color=style.colour, linewidth=1.3, label=name)
            axes.plot(*drive.way[0], "o", color=style.colour, markersize=5)
        axes.add_patch(Circle(goal, 0.15, fill=False, edgecolor=INK, linewidth=1.2))
        axes.set_xlim(0, 10)
        axes.set_ylim(0, 10)
        axes.set_aspect("equal")
        axes.legend(loc="upper right")
