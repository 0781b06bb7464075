"""Depth that can be trusted: correction of the picture (the paper's Figures 8 to 9), and one depth per landmark."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.arrays import Depth, Floats
from trailmark.frames import Scalar, Scan
from trailmark_kinect_landmarks.kernels import believed_depth

__all__ = ["DepthLimits", "as_scan", "correct_depth", "depth_at", "depth_sigma", "scan_depth"]


_ONE_BEAM_RAD = 0.1  # any step will do
_MIN_SHARE = 0.34  # of a landmark's window that must have depth
#: Of the 25 pixels around: more than the first must have depth for a hole to be filled, fewer than the second around
#: gloss. The grey level of a highlight.
_COUNTS = 15, 13, 250
_KINECT_SIGMA = 1.425e-3  # of depth at 1 m, growing with its square: Khoshelham & Oude Elberink 2012


@dataclass(frozen=True, slots=True)
class DepthLimits:
    """What depth is believed.

    Attributes
    ----------
    near_m, far_m : float
        Where the sensor measures [m].
    flying_share : float
        A pixel this far from the median of its neighbours, as a share of its depth, hangs in the air between two
        surfaces.
    """

    near_m: float = 0.4
    far_m: float = 6.0
    flying_share: float = 0.03


def correct_depth(depth_m: Depth, grey: npt.NDArray[np.uint8] | None, limits: DepthLimits) -> Depth:
    """Return depth without flying pixels, without what shines, and with small holes filled.

    Parameters
    ----------
    depth_m : (H, W) float32
        Depth, NaN where unknown [m].
    grey : (H, W) uint8, optional
        The colour picture of the same size, to tell highlights: a highlight around which most depth is missing is a
        mirror or gloss, and the depth it has is not that of its surface.

    Returns
    -------
    (H, W) float32
        NaN where unknown; a hole is filled only where most of its surroundings have depth.
    """
    near_m, far_m = np.float32(limits.near_m), np.float32(limits.far_m)
    # between the limits, not on them; NaN is in no range
    within = float(np.nextafter(near_m, far_m)), float(np.nextafter(far_m, near_m))
    known = np.asarray(cv2.inRange(depth_m, *within), np.uint8) >> 7
    depth = np.asarray(cv2.copyTo(depth_m, known), np.float32)  # 0 where it is not known
    median = np.asarray(cv2.medianBlur(depth, 5), np.float32)
    n_known = np.asarray(cv2.boxFilter(known, -1, (5, 5), normalize=False), np.uint8)
    brightest = np.zeros_like(known)
    if grey is not None and grey.shape == depth.shape:
        brightest = np.asarray(cv2.dilate(grey, np.ones((5, 5), np.uint8)), np.uint8)
    return believed_depth(depth, median, n_known, brightest, np.float32(limits.flying_share), _COUNTS)


def depth_at(depth_m: Depth, uv: Floats, radius_px: int = 2, limits: DepthLimits | None = None) -> Floats:
    """Return the median depth around pixels, NaN where there is too little of it or two surfaces meet.

    Parameters
    ----------
    depth_m : (H, W) float32
        Depth, NaN where unknown [m].
    uv : (N, 2) float
        Pixels, rounded to the nearest; the window ends at the border.
    radius_px : int
        Half the window [px].

    Returns
    -------
    (N,) float64
        Invalid stays invalid: never a number made of nothing [m].
    """
    limits = limits or DepthLimits()
    if len(uv) == 0:
        return np.empty(0)
    height, width = depth_m.shape
    centre = np.rint(uv).astype(np.intp)
    steps = np.arange(-radius_px, radius_px + 1)
    rows = centre[:, 1, None, None] + steps[None, :, None]
    columns = centre[:, 0, None, None] + steps[None, None, :]
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    windows = depth_m[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)].astype(np.float64)
    windows = np.where(inside, windows, np.nan).reshape(len(uv), -1)
    windows.sort(axis=1)  # NaN goes last
    n_known = np.isfinite(windows).sum(axis=1)
    row = np.arange(len(uv))
    low, middle, high = (windows[row, np.maximum(0, (n_known - 1) * q // 4)] for q in (1, 2, 3))
    one_surface = high - low <= np.maximum(limits.flying_share * middle, 6.0 * depth_sigma(middle))
    enough = n_known >= _MIN_SHARE * windows.shape[1]
    return np.where(enough & one_surface, middle, np.nan)


def depth_sigma(depth_m: Floats) -> Floats:
    """Return the standard deviation of a structured-light depth, (N,) [m]."""
    return np.asarray(_KINECT_SIGMA * np.square(depth_m) + 1e-3)


def as_scan(payload: Scan | Scalar) -> Scan:
    """Return a range sensor's reading as a sweep: a single range is a sweep of one beam, straight ahead."""
    if isinstance(payload, Scan):
        return payload
    return Scan(np.array([payload.value if payload.value > 0.0 else np.nan]), 0.0, _ONE_BEAM_RAD)


def scan_depth(scan: Scan, bearings_rad: Floats, max_gap_rad: float) -> Floats:
    """Return the ranges of a laser in given directions, NaN where no beam came back near enough.

    Parameters
    ----------
    scan : Scan
        A sweep, or an ultrasound as a single beam.
    bearings_rad : (N,) float
        Directions in the laser's axes, counter-clockwise [rad].
    max_gap_rad : float
        How far from the beam a landmark may be [rad].
    """
    known = np.isfinite(bearings_rad)
    bearings_rad = np.where(known, bearings_rad, 0.0)
    beam = np.rint((bearings_rad - scan.angle_min_rad) / scan.angle_step_rad).astype(np.intp)
    inside = known & (beam >= 0) & (beam < len(scan.ranges_m))
    beam = np.clip(beam, 0, len(scan.ranges_m) - 1)
    ranges = np.asarray(scan.ranges_m, dtype=np.float64)[beam]
    near = np.abs(scan.angle_min_rad + beam * scan.angle_step_rad - bearings_rad) <= max_gap_rad
    measured = (ranges > scan.range_min_m) & (ranges < scan.range_max_m)
    return np.where(inside & near & measured, ranges, np.nan)
