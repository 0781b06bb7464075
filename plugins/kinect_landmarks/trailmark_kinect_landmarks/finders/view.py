"""What finders look at: one picture at working resolution, and what several of them need of it, made once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.arrays import Bgr8, Floats, Grey8
from trailmark_kinect_landmarks.colour import colour_index

__all__ = ["Region", "Regions", "WorkingImage"]


@dataclass(frozen=True, slots=True)
class Region:
    """Something that a finder found.

    Attributes
    ----------
    kind : str
        What it is: ``blob``, ``edge``, ``rectangle``, ``circle``, ``ellipse``, ``line``, ``flat``, ``mser``.
    u, v, width, height : float
        Upper left corner and size of the frame drawn around it, in pixels of the whole picture [px].
    """

    kind: str
    u: float
    v: float
    width: float
    height: float

    @property
    def centre(self) -> tuple[float, float]:
        """The pixel that stands for it: the centre of its frame (u, v) [px]."""
        return self.u + (self.width - 1.0) / 2.0, self.v + (self.height - 1.0) / 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Regions:
    """What finders found, a row each: there are hundreds, of which few become landmarks.

    Attributes
    ----------
    kinds : list of str
        What each is, as in `Region`.
    boxes : (N, 4) float64
        Upper left corners, widths and heights, as in `Region` [px].
    """

    kinds: list[str]
    boxes: Floats

    def __len__(self) -> int:
        return len(self.kinds)

    def __getitem__(self, row: int) -> Region:
        return Region(self.kinds[row], *self.boxes[row].tolist())


class WorkingImage:
    """A colour picture with its depth, reduced to a working resolution.

    Parameters
    ----------
    bgr : (H, W, 3) uint8
        The compensated colour picture.
    depth_m : (H, W) float32
        Depth registered to it, NaN where unknown [m].
    scale : float
        Working resolution as a share of the whole, at most 1.
    grey : (H, W) uint8, optional
        The picture in grey, where it is known already.
    """

    def __init__(
        self, bgr: Bgr8, depth_m: npt.NDArray[np.float32], scale: float = 1.0, grey: Grey8 | None = None
    ) -> None:
        self.whole, self.depth_m, self.scale, self._whole_grey = bgr, depth_m, scale, grey

    @cached_property
    def bgr(self) -> Bgr8:
        """Colour at working resolution."""
        return self.whole if self.scale == 1.0 else _reduce_to_grey(self.whole, self.scale)

    @cached_property
    def grey(self) -> Grey8:
        """Grey at working resolution."""
        if self._whole_grey is not None and self.scale == 1.0:
            return self._whole_grey
        return np.asarray(cv2.cvtColor(self.bgr, cv2.COLOR_BGR2GRAY), dtype=np.uint8)

    @cached_property
    def half(self) -> WorkingImage:
        """The same at half the working resolution, for what needs no more."""
        return WorkingImage(self.bgr, self.depth_m, 0.5)

    @cached_property
    def index(self) -> Grey8:
        """Colour classes at working resolution."""
        return colour_index(np.asarray(cv2.cvtColor(self.bgr, cv2.COLOR_BGR2HSV), dtype=np.uint8))

    @cached_property
    def edges(self) -> Grey8:
        """Edges (Canny)."""
        smooth = cv2.GaussianBlur(self.grey, (3, 3), 0)
        return np.asarray(cv2.Canny(smooth, 40, 100), dtype=np.uint8)

    @cached_property
    def contours(self) -> Sequence[npt.NDArray[Any]]:
        """Edges as chains of pixels, without those that are too short for a landmark."""
        found, _ = cv2.findContours(self.edges, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        return [chain for chain in found if len(chain) >= 30]

    @cached_property
    def polygons(self) -> Sequence[npt.NDArray[Any]]:
        """The contours with as few corners as keep them within 2.5 pixels."""
        return [cv2.approxPolyDP(chain, 2.5, closed=True) for chain in self.contours]

    def regions(self, kinds: str | list[str], boxes: npt.ArrayLike, share: float = 1.0) -> Regions:
        """Return what was found in boxes (u, v, width, height), (N, 4), at a share of the working resolution.

        Parameters
        ----------
        kinds : str or list of str
            What all of them are, or each.
        boxes : (N, 4) float
            At that resolution [px].
        share : float
            Of the working resolution.
        """
        found = np.array(boxes, dtype=np.float64).reshape(-1, 4)
        for scale in (share, self.scale):
            found[:, :2] = (found[:, :2] + 0.5) / scale - 0.5
            found[:, 2:] /= scale
        return Regions([kinds] * len(found) if isinstance(kinds, str) else kinds, found)


def _reduce_to_grey(bgr: Bgr8, scale: float) -> Grey8:
    size = max(1, round(bgr.shape[1] * scale)), max(1, round(bgr.shape[0] * scale))
    return np.asarray(cv2.resize(bgr, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
