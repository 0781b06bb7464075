"""Finders of areas: colour blobs, stable areas (MSER) and flat objects."""

from __future__ import annotations

import cv2
import numpy as np

from trailmark.arrays import Grey8, Int32s
from trailmark_kinect_landmarks.finders.view import Regions, WorkingImage

__all__ = ["find_blobs", "find_flats", "find_mser", "patches_of"]


_MIN_BLOB, _MAX_BLOB = 1.0e-4, 0.03  # share of the picture's area
_MIN_FLAT, _MAX_FLAT = 4.0e-3, 0.25
_MIN_FILL = 0.35  # of its frame: less is a frame around something else
_MSER_DELTA = 5
_FLAT_STEP_PX = 8
_NORMAL_CLASSES = 6  # of a normal's components, each way


def find_blobs(view: WorkingImage) -> Regions:
    """Return connected areas of one colour class; also black, grey and white ones."""
    return view.regions("blob", patches_of(view.half.index, _MIN_BLOB, _MAX_BLOB), 0.5)


def find_mser(view: WorkingImage) -> Regions:
    """Return areas that stay the same over many thresholds of grey (Matas et al. 2002)."""
    small = view.half.grey
    n = small.size
    mser = cv2.MSER.create(_MSER_DELTA, max(12, round(_MIN_BLOB * n)), round(_MAX_BLOB * n))
    _, found = mser.detectRegions(small)
    boxes = np.asarray(found, np.int32).reshape(-1, 4)
    cells = (boxes[:, :2] + boxes[:, 2:] // 2) // 6
    _, first = np.unique(cells @ (1, 1 << 16), return_index=True)  # thresholds in a row find one thing again and again
    return view.regions("mser", boxes[np.sort(first)], 0.5)


def find_flats(view: WorkingImage) -> Regions:
    """Return flat objects: areas of one direction of the surface, bounded by steps of depth.

    Depth is needed every eighth pixel only; the surface's direction comes from the slope of the inverse depth, which
    is linear in the pixel on a plane.
    """
    step = _FLAT_STEP_PX
    inverse = 1.0 / view.depth_m[step // 2 :: step, step // 2 :: step].astype(np.float64)
    if min(inverse.shape) < 4:
        return view.regions("flat", ())
    slope_v, slope_u = np.gradient(inverse)
    share = np.stack([slope_u, slope_v]) / inverse * (_NORMAL_CLASSES * 4)
    known = np.isfinite(share).all(axis=0) & (np.abs(share) < _NORMAL_CLASSES).all(axis=0)
    classes = np.rint(np.where(known, share, 0.0)).astype(np.int32) + _NORMAL_CLASSES
    distance = np.rint(np.log(np.where(known, 1.0 / inverse, 1.0)) * 8.0).astype(np.int32)  # steps of an eighth
    labels = np.where(known, 1 + classes[0] + 16 * classes[1] + 256 * (distance + 64), 0).astype(np.int32)
    return view.regions("flat", patches_of(labels, _MIN_FLAT, _MAX_FLAT, skip_zero=True), 1.0 / (step * view.scale))


def patches_of(labels: Int32s | Grey8, min_share: float, max_share: float, skip_zero: bool = False) -> Int32s:
    """Return the frames of the connected areas of one label, in one pass over all labels.

    A pixel whose right or lower neighbour bears another label is a border; what the borders leave is connected.

    Parameters
    ----------
    labels : (H, W) int
        Label of every pixel.
    min_share, max_share : float
        Least and greatest share of the picture that an area may have.
    skip_zero : bool
        Whether pixels of label 0 belong to no area.

    Returns
    -------
    (N, 4) int
        Bounding boxes: u, v, width and height [px].
    """
    inside = np.ones(labels.shape, dtype=np.uint8)
    inside[:, :-1] &= labels[:, :-1] == labels[:, 1:]
    inside[:-1] &= labels[:-1] == labels[1:]
    if skip_zero:
        inside &= labels != 0
    n, _, stats, _ = cv2.connectedComponentsWithStats(inside, connectivity=4, ltype=cv2.CV_32S)
    stats = np.asarray(stats)[1:n]
    area = stats[:, cv2.CC_STAT_AREA]
    frame = stats[:, cv2.CC_STAT_WIDTH] * stats[:, cv2.CC_STAT_HEIGHT]
    good = (area >= min_share * labels.size) & (area <= max_share * labels.size) & (area >= _MIN_FILL * frame)
    return np.asarray(stats[good, : cv2.CC_STAT_AREA], np.int32)
