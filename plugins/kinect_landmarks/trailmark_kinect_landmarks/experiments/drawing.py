"""Figures as SVG, all alike."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["COLOURS", "axes_of", "drawing", "with_jpegs"]

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#626a73")

_PNG = re.compile(r'data:image/png;base64,([^"]*)')
_JPEG_QUALITY = 85


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


def with_jpegs(svg: str) -> str:
    """Return a drawing whose pictures are JPEGs: matplotlib embeds PNGs, several times as large for photographs.

    Raises
    ------
    ValueError
        If a picture of it is transparent somewhere, which a JPEG cannot be.
    """
    return _PNG.sub(_as_jpeg, svg)


def _as_jpeg(embedded: re.Match[str]) -> str:
    import cv2

    png = np.frombuffer(base64.b64decode(embedded[1]), np.uint8)
    picture = np.asarray(cv2.imdecode(png, cv2.IMREAD_UNCHANGED), np.uint8)
    if picture.ndim == 3 and picture.shape[2] == 4:
        if picture[..., 3].min() < 255:
            raise ValueError("a picture that is transparent somewhere cannot be a JPEG")
        picture = picture[..., :3]
    jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1]
    return f"data:image/jpeg;base64,{base64.b64encode(jpeg.tobytes()).decode()}"
