"""The differential visual stream: pictures in, change vectors out (Sec. II)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trailmark.errors import ShapeError
from trailmark_divs.averaging import trimmed_mean
from trailmark_divs.difference import column_counts, difference_image, otsu_threshold, percentile_threshold
from trailmark_divs.layout import ColumnLayout
from trailmark_divs.options import Average, Threshold

__all__ = ["ChangeStream", "n_trimmed"]

_P90 = 0.9
_BLUR_SIGMA_PX = 1.5
_BLUR_SIZE_PX = 5


def n_trimmed(window: int, average: Average) -> int:
    """Return how many values of a window are left out at each end: a quarter, or none."""
    return window // 4 if average == "trimmed" else 0


class ChangeStream:
    """Differences of the pictures since "time zero", summed up by columns.

    Column sums and the average over the window are both linear, so the window keeps w rows of d sums and
    a running total instead of w pictures: a picture costs O(pixels) once, however long the window is.

    Parameters
    ----------
    layout : ColumnLayout
        Region, columns and mask.
    window : int
        Differences in a window, w.
    threshold : {"otsu", "p90", "blur_otsu"}
        What counts as a change: Otsu's method (the paper), the top tenth, or Otsu after a Gaussian blur.
    average : {"trimmed", "mean"}
        Mean without the outer quarters, or the plain mean of Eq. (6).
    keep_pictures : bool
        Keep the binary pictures too, so that `change_image` can be asked for.
    """

    def __init__(
        self,
        layout: ColumnLayout,
        window: int,
        threshold: Threshold = "otsu",
        average: Average = "mean",
        keep_pictures: bool = False,
    ) -> None:
        self._layout = layout
        self._scale = layout.scale
        self._threshold = threshold
        self._n_trimmed = n_trimmed(window, average)
        self._difference = np.empty((layout.n_rows, layout.width_px), dtype=np.uint8)
        self._pair = (np.empty_like(self._difference), np.empty_like(self._difference))  # sources may reuse theirs
        self._n_pictures = 0
        self._n_masked = 0 if layout.mask is None else int((layout.mask == 0).sum())
        self._ring = np.zeros((window, layout.n_columns), dtype=np.int64)
        self._total = np.zeros(layout.n_columns, dtype=np.int64)
        shape = (window, *self._difference.shape) if keep_pictures else (0, 0, 0)
        self._pictures = np.zeros(shape, dtype=np.bool_)
        self._count = 0

    @property
    def is_full(self) -> bool:
        """True when a whole window of differences has been seen since time zero."""
        return self._count >= len(self._ring)

    @property
    def count(self) -> int:
        """Differences since time zero."""
        return self._count

    def restart(self) -> None:
        """Set a new "time zero": what was seen is forgotten, but the last picture stays to difference against."""
        self._count = 0
        self._ring[:] = 0
        self._total[:] = 0

    def push(self, grey: npt.NDArray[np.uint8]) -> npt.NDArray[np.int64] | None:
        """Take a picture; return the column sums of its difference to the one before, (d,).

        Parameters
        ----------
        grey : (rows, width) uint8
            Region of interest in grey.

        Returns
        -------
        (d,) int64 or None
            Changed pixels in each column; None for the first picture.

        Raises
        ------
        ShapeError
            If the picture does not fit the layout.
        """
        if grey.shape != self._difference.shape:
            raise ShapeError(f"the region of interest must be {self._difference.shape}, not {grey.shape}")
        previous, current = self._pair[self._n_pictures % 2], self._pair[(self._n_pictures + 1) % 2]
        self._prepare(grey, current)
        self._n_pictures += 1
        if self._n_pictures == 1:
            return None
        level = self._level(difference_image(previous, current, self._difference))
        sums = column_counts(self._difference, level, self._layout.n_columns, self._layout.column_px)
        self._remember(sums, level)
        return sums

    @property
    def newest(self) -> npt.NDArray[np.uint8]:
        """The last picture as it was compared: blurred where asked for, and 0 where it is masked, (rows, width)."""
        return self._pair[self._n_pictures % 2]

    def vector(self) -> npt.NDArray[np.float64]:
        """Return the change vector of the window, Eqs. (6) and (7), (d,); 0 in unusable columns.

        Raises
        ------
        ShapeError
            If no whole window has been seen since time zero.
        """
        if not self.is_full:
            raise ShapeError(f"the window holds {self._count} of {len(self._ring)} differences; ask `is_full` first")
        if self._n_trimmed:
            return trimmed_mean(self._ring, self._n_trimmed) * self._scale
        return self._total / len(self._ring) * self._scale

    def change_image(self) -> npt.NDArray[np.float32]:
        """Return the change image C of Eq. (6), (rows, width) in [0, 1], over what the window holds.

        Raises
        ------
        ShapeError
            If the stream was made without `keep_pictures`, or has seen no difference since time zero.
        """
        held = min(self._count, len(self._ring))
        if not len(self._pictures) or not held:
            raise ShapeError("no change image: make the stream with keep_pictures and push two pictures first")
        newest = [(self._count - 1 - age) % len(self._ring) for age in range(held)]
        return np.asarray(self._pictures[newest].mean(axis=0, dtype=np.float32))

    def _prepare(self, grey: npt.NDArray[np.uint8], prepared: npt.NDArray[np.uint8]) -> None:
        if self._threshold == "blur_otsu":
            import cv2

            cv2.GaussianBlur(grey, (_BLUR_SIZE_PX, _BLUR_SIZE_PX), _BLUR_SIGMA_PX, dst=prepared)
        else:
            np.copyto(prepared, grey)
        if self._layout.mask is not None:
            np.bitwise_and(prepared, self._layout.mask, out=prepared)

    def _level(self, histogram: npt.NDArray[np.int64]) -> int:
        histogram[0] -= self._n_masked  # masked pixels are black in both pictures
        if self._threshold == "p90":
            return percentile_threshold(histogram, _P90)
        return otsu_threshold(histogram)

    def _remember(self, sums: npt.NDArray[np.int64], level: int) -> None:
        place = self._count % len(self._ring)
        self._total += sums - self._ring[place]
        self._ring[place] = sums
        if len(self._pictures):
            self._pictures[place] = self._difference > level
        self._count += 1
