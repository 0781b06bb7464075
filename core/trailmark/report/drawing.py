"""Figures of experiments: as wide as those of a report, in its colours and type, written as SVG.

For the plugins that bring experiments; the plots of a run are drawn by `trailmark.report.figures`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trailmark.report.style import BLUE, GREEN, INK, MUTED, RED, RULE, TRUTH, WIDTH_INCH, plotting, svg_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["BLUE", "GREEN", "INK", "MUTED", "RED", "RULE", "TRUTH", "drawing", "legend_above"]


@contextmanager
def drawing(
    path: Path, height_inch: float, rows: int = 1, columns: int = 1, name: str | None = None
) -> Iterator[tuple[Figure, Any]]:
    """Give a figure and its axes to draw into, and write it.

    Parameters
    ----------
    path : Path
        The file; its folder is made.
    height_inch : float
        Height of the figure, in inches of 72 px.
    rows, columns : int
        Of axes: one gives the axes themselves, more an array of them, as ``Figure.subplots`` does.
    name : str, optional
        What the ids inside the drawing are made of, so that two of them can stand in one page; left out, that of the
        file.

    Yields
    ------
    (Figure, Axes or array of Axes)
        The same content gives the same bytes.
    """
    from matplotlib.figure import Figure

    with plotting(name or path.stem):
        figure = Figure(figsize=(WIDTH_INCH, height_inch), layout="constrained")
        yield figure, figure.subplots(rows, columns)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(svg_of(figure), encoding="utf-8")


def legend_above(figure: Figure, columns: int) -> None:
    """Put a legend of all that is labelled above the axes, in so many columns at most; none where nothing is."""
    labelled = [pair for axes in figure.axes for pair in zip(*axes.get_legend_handles_labels())]
    if labelled:
        handles, labels = zip(*labelled)
        figure.legend(handles, labels, loc="outside upper left", ncols=min(len(labels), columns))
