"""Figures as SVG, all alike."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["COLOURS", "axes_of", "drawing"]

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#626a73")


@contextmanager
def drawing(path: Path, rows: int = 1, columns: int = 1, height: float = 0.0) -> Iterator[Figure]:
    """Give a figure to draw into, and write it with the legend of all that is labelled."""
    from matplotlib.figure import Figure

    from trailmark.report.style import plotting, svg_of

    with plotting(path.stem):
        figure = Figure(figsize=(6.4, height or 0.6 + 2.0 * rows), layout="constrained")
        figure.subplots(rows, columns)
        yield figure
        labelled = [pair for axes in figure.axes for pair in zip(*axes.get_legend_handles_labels())]
        if labelled:
            handles, labels = zip(*labelled)
            figure.legend(handles, labels, loc="outside upper left", ncols=4)
        path.write_text(svg_of(figure), encoding="utf-8")


def axes_of(figure: Figure) -> Sequence[Axes]:
    """Return the axes of a figure, row by row."""
    return figure.axes
