"""Figures of the papers, redrawn: panels one below the other, each under its title."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trailmark.report.drawing import drawing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["panels"]


@contextmanager
def panels(
    path: Path, height_inch: float, *titles: str, xlabel: str = "", name: str | None = None
) -> Iterator[tuple[Figure, list[Any]]]:
    """Give a figure and its axes to draw into, and write it as SVG.

    Parameters
    ----------
    path : Path
        The file; its folder is made.
    height_inch : float
        Height of the figure, in inches of 72 px.
    *titles : str
        One for each panel: what it shows, and in what unit.
    xlabel : str
        Below the last panel.
    name : str, optional
        What the ids inside the drawing are made of; left out, that of the file.

    Yields
    ------
    (Figure, list of Axes)
        The same content gives the same bytes.
    """
    with drawing(path, height_inch, rows=len(titles), name=name) as (figure, _):
        for axes, title in zip(figure.axes, titles, strict=True):
            axes.set_title(title)
        if xlabel:
            figure.axes[-1].set_xlabel(xlabel)
        yield figure, figure.axes
