"""What is seen of landmarks in one picture: pixel, kind, vicinity, and the point in space with its covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats, Grey8, Indices
from trailmark_kinect_landmarks.colour import histograms
from trailmark_kinect_landmarks.finders import Regions
from trailmark_kinect_landmarks.kernels import best_pixels, keep_apart

__all__ = [
    "KINDS",
    "SeenLandmarks",
    "TrackedLandmarks",
    "anchors",
    "describe",
    "point_covariances",
    "spread_out",
    "vicinities",
]


KINDS = ("blob", "edge", "rectangle", "circle", "ellipse", "line", "flat", "mser")

_NEAR_PX, _WIDE_PX = 7, 20  # half sizes of the windows whose colours are remembered
_VICINITY_PX = 24  # the "constantly set vicinity" of the paper
_VICINITY_CELLS = 8
_MAX_ANCHOR_BOX_PX, _AROUND_BOX_PX = 40.0, 2.0
_CORNERNESS_BLOCK = 5


@dataclass(frozen=True, slots=True, eq=False)
class SeenLandmarks:
    """Landmarks as one picture shows them, a row each.

    Attributes
    ----------
    uv : (N, 2) float64
        Pixels that stand for them [px].
    kind : (N,) int8
        Index into `KINDS`.
    size_m : (N,) float64
        Size of the frame around them, at their depth [m].
    histogram : (N, B) float32
        Colours of the near and the wider surroundings.
    vicinity : (N, C) float32
        Brightness around them, mean 0 and length 1.
    points_base : (N, 3) float64
        Where they stand, in base axes [m].
    cov_base : (N, 3, 3) float64
        Of that [m^2].
    """

    uv: Floats
    kind: npt.NDArray[np.int8]
    size_m: Floats
    histogram: npt.NDArray[np.float32]
    vicinity: npt.NDArray[np.float32]
    points_base: Floats
    cov_base: Floats

    def __len__(self) -> int:
        return len(self.uv)

    def rows(self, which: npt.NDArray[np.intp] | npt.NDArray[np.bool_]) -> SeenLandmarks:
        """Return some of them."""
        return SeenLandmarks(
            self.uv[which],
            self.kind[which],
            self.size_m[which],
            self.histogram[which],
            self.vicinity[which],
            self.points_base[which],
            self.cov_base[which],
        )


@dataclass(frozen=True, slots=True, eq=False)
class TrackedLandmarks:
    """Landmarks of a picture with their rows in the memory.

    Attributes
    ----------
    seen : SeenLandmarks
        What is seen.
    rows : (N,) int
        Their rows; -1: not known yet.
    """

    seen: SeenLandmarks
    rows: Indices

    def __len__(self) -> int:
        return len(self.rows)

    def pick(self, which: Indices | npt.NDArray[np.bool_]) -> TrackedLandmarks:
        """Return some of them."""
        return TrackedLandmarks(self.seen.rows(which), self.rows[which])

    @classmethod
    def join(cls, parts: Sequence[TrackedLandmarks]) -> TrackedLandmarks:
        """Return the landmarks of all parts, one part after another."""
        seen = [part.seen for part in parts if len(part)] or [parts[0].seen]
        fields = ("uv", "kind", "size_m", "histogram", "vicinity", "points_base", "cov_base")
        arrays = [np.concatenate([getattr(item, name) for item in seen]) for name in fields]
        return cls(SeenLandmarks(*arrays), np.concatenate([part.rows for part in parts]))


def anchors(grey: Grey8, regions: Regions, at: str) -> tuple[Floats, Floats]:
    """Return the pixels that stand for regions, (N, 2), and how well marked each is, (N,).

    Parameters
    ----------
    at : {"corner", "centre"}
        ``centre`` of the frame, as in the paper. ``corner``: the best marked pixel within the frame.
        Differs from the paper: the centre of a blob moves with its outline by several pixels, a corner does not.
    """
    cornerness = np.asarray(cv2.cornerMinEigenVal(grey, _CORNERNESS_BLOCK), np.float32)
    height, width = grey.shape
    if at == "centre" or not len(regions):
        centres = regions.boxes[:, :2] + (regions.boxes[:, 2:] - 1.0) / 2.0
        whole = np.clip(np.rint(centres).astype(int), 0, (width - 1, height - 1))
        return centres, cornerness[whole[:, 1], whole[:, 0]].astype(np.float64)
    uv, strength = best_pixels(cornerness, regions.boxes, _MAX_ANCHOR_BOX_PX, _AROUND_BOX_PX)
    # one corner stands for many regions: it is refined once
    _, first, each = np.unique(uv[:, 0] + 1j * uv[:, 1], return_index=True, return_inverse=True)
    return _subpixel(grey, uv[first])[each], strength


def _subpixel(grey: Grey8, uv: Floats) -> Floats:
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 10, 0.03)
    refined = cv2.cornerSubPix(grey, uv.astype(np.float32).reshape(-1, 1, 2), (3, 3), (-1, -1), criteria)
    refined = np.asarray(refined, dtype=np.float64).reshape(-1, 2)
    near = np.abs(refined - uv).max(axis=1, keepdims=True) <= 3.0
    return np.where(near, refined, uv)


def spread_out(uv: Floats, strength: Floats, taken_uv: Floats, apart_px: float, n: int) -> npt.NDArray[np.intp]:
    """Return the best marked pixels, best first, none nearer than `apart_px` to another or to one that is taken.

    Parameters
    ----------
    uv : (N, 2) float64
        Pixels (u, v) [px].
    strength : (N,) float64
        How well marked each is.
    taken_uv : (K, 2) float64
        Pixels that are taken already [px].
    apart_px : float
        Least distance [px].
    n : int
        How many at the most.

    Returns
    -------
    (<= n,) int
        Rows of `uv`.
    """
    return keep_apart(uv, np.argsort(-strength, kind="stable"), taken_uv, apart_px, n)


def vicinities(grey: Grey8, uv: Floats) -> npt.NDArray[np.float32]:
    """Return the brightness around pixels on a coarse grid, (N, 64), each with mean 0 and length 1."""
    cell = _VICINITY_PX // _VICINITY_CELLS
    smooth = np.asarray(cv2.blur(grey, (cell, cell)), np.uint8)
    steps = (np.arange(_VICINITY_CELLS) - (_VICINITY_CELLS - 1) / 2.0) * cell
    rows = np.clip(np.rint(uv[:, 1, None, None] + steps[:, None]).astype(np.intp), 0, grey.shape[0] - 1)
    columns = np.clip(np.rint(uv[:, 0, None, None] + steps[None, :]).astype(np.intp), 0, grey.shape[1] - 1)
    patches = smooth[rows, columns].reshape(len(uv), _VICINITY_CELLS**2).astype(np.float32)
    patches -= patches.mean(axis=1, keepdims=True)
    lengths = np.linalg.norm(patches, axis=1, keepdims=True)
    return np.asarray(patches / np.maximum(lengths, 1e-6), dtype=np.float32)


def describe(grey: Grey8, index: Grey8, uv: Floats) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Return histograms (N, B), each with sum 1, and vicinities (N, C) of pixels; see `SeenLandmarks`."""
    step = index.shape[1] / grey.shape[1]  # colour classes may be made at a lower resolution
    near, wide = (histograms(index, uv * step, max(1, round(radius * step))) for radius in (_NEAR_PX, _WIDE_PX))
    return np.concatenate([near, wide], axis=1) * np.float32(0.5), vicinities(grey, uv)


def point_covariances(points_sensor: Floats, sigma_px: Floats, sigma_depth_m: Floats, focal_px: float) -> Floats:
    """Return the covariances of points, (N, 3, 3): long along the ray by the depth, thin across it by the pixel.

    Parameters
    ----------
    points_sensor : (N, 3) float
        In sensor axes, x forward [m].
    sigma_px, sigma_depth_m : (N,) float
        Standard deviations of the pixel [px] and of the depth [m].
    """
    ahead = np.maximum(points_sensor[:, :1], 1e-3)
    along = points_sensor / ahead * sigma_depth_m[:, None]
    across_m = ahead[:, 0] * sigma_px / focal_px
    covariances = np.einsum("ni,nj->nij", along, along)
    covariances[:, [1, 2], [1, 2]] += (across_m**2)[:, None]
    covariances[:, 0, 0] += 1e-8
    return np.asarray(covariances)
