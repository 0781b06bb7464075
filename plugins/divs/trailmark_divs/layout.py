"""Which pixels of a picture make which column of a change vector."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trailmark.errors import ConfigError
from trailmark.frames import RGBD, Image

__all__ = ["ColumnLayout", "grey_region", "make_layout"]

# A column of which less than this share lies inside the lens circle is left out: its sum would be noise.
_LEAST_SHARE = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class ColumnLayout:
    """The region of interest, its columns and its mask.

    Attributes
    ----------
    width_px : int
        Width of the picture [px].
    rows : (int, int)
        First row of the region, and the row after its last.
    column_px : int
        Width of a column; what remains at the right edge is not used, as in the reference [px].
    mask : (rows, width) uint8 or None
        255 where a pixel counts, 0 where it does not; None: all count.
    area : (d,) int64
        Pixels that count in each column.
    usable : (d,) bool
        Columns with enough of them.
    """

    width_px: int
    rows: tuple[int, int]
    column_px: int
    mask: npt.NDArray[np.uint8] | None
    area: npt.NDArray[np.int64]
    usable: npt.NDArray[np.bool_]

    @property
    def n_columns(self) -> int:
        """Number of columns, d of the paper."""
        return len(self.area)

    @property
    def n_rows(self) -> int:
        """Number of rows of the region."""
        return self.rows[1] - self.rows[0]

    @property
    def scale(self) -> npt.NDArray[np.float64]:
        """Factor of each column that makes up for its masked pixels; 0 where the column is not usable, (d,)."""
        full = self.n_rows * self.column_px
        return np.where(self.usable, full / np.maximum(self.area, 1), 0.0)


def make_layout(
    size: tuple[int, int], n_columns: int, region: tuple[float, float], lens_radius: float | None = None
) -> ColumnLayout:
    """Lay out the columns of a picture, Eq. (7).

    Parameters
    ----------
    size : (int, int)
        Width and height of the picture [px].
    n_columns : int
        Number of columns d.
    region : (float, float)
        First and last row of the region of interest, as shares of the height from the top.
    lens_radius : float, optional
        Radius of the lens circle about the picture's centre, as a share of the width; what lies outside is masked.

    Raises
    ------
    ConfigError
        If a column would be narrower than a pixel, the region is empty, or the mask leaves no column.
    """
    width, height = size
    rows = (round(region[0] * height), round(region[1] * height))
    column_px = width // n_columns
    if column_px < 1 or rows[1] <= rows[0]:
        raise ConfigError(
            f"a picture of {width} x {height} px has no {n_columns} columns in rows {rows[0]} to {rows[1]};"
            " lower 'columns' or widen 'region'"
        )
    inside = np.ones((rows[1] - rows[0], width), dtype=bool)
    if lens_radius is not None:
        v, u = np.mgrid[rows[0] : rows[1], :width]
        inside = np.hypot(u - (width - 1) / 2, v - (height - 1) / 2) <= lens_radius * width
    area = inside[:, : column_px * n_columns].reshape(len(inside), n_columns, column_px).sum(axis=(0, 2))
    usable = area >= math.ceil(_LEAST_SHARE * len(inside) * column_px)
    if not usable.any():
        raise ConfigError(f"lens_radius {lens_radius} leaves no column of a picture of {width} x {height} px")
    mask = None if inside.all() else np.where(inside, np.uint8(255), np.uint8(0))
    return ColumnLayout(width, rows, column_px, mask, area, usable)


def grey_region(payload: Image | RGBD, rows: tuple[int, int]) -> npt.NDArray[np.uint8]:
    """Return the rows of a picture in grey, (rows, width) uint8, contiguous; 16-bit pictures lose their low byte."""
    pixels = payload.bgr if isinstance(payload, RGBD) else payload.pixels
    part = pixels[rows[0] : rows[1]]
    if part.ndim == 3:
        import cv2

        return np.asarray(cv2.cvtColor(np.ascontiguousarray(part), cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    if part.dtype == np.uint16:
        return (part >> 8).astype(np.uint8)
    return np.ascontiguousarray(part, dtype=np.uint8)
