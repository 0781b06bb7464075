"""The paper's calibration from views of a rectangle: what depth does not see of the colour picture, Eqs. (3)-(6)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trailmark.errors import ConfigError
from trailmark.frames import DepthCamera, Pinhole
from trailmark_kinect_landmarks.calibrating.board import BoardView
from trailmark_kinect_landmarks.calibration import Crop, ratios

__all__ = ["CropFit", "as_depth_camera", "fit_crop", "lens_of_angle"]

Size = tuple[int, int]

_MIN_VIEWS = 3
_MIN_SPREAD = 0.4  # of the picture, that the corners must cover


@dataclass(frozen=True, slots=True)
class CropFit:
    """A crop, and how sure it is.

    Attributes
    ----------
    crop : Crop
        Lines that depth does not see [px].
    sigma_px : float
        Largest standard deviation of the four [px].
    rms_px : float
        Of the corners, in colour pixels: mostly the parallax, which no crop can make up for [px].
    """

    crop: Crop
    sigma_px: float
    rms_px: float


def fit_crop(views: Sequence[BoardView], colour_size: Size, depth_size: Size) -> CropFit:
    """Return the crop from rectangles that both cameras see.

    The paper moves the rectangle until it touches each border of the depth picture and looks where it is in colour.
    Corners anywhere tell the same by a straight line through them, and how exactly.

    Raises
    ------
    ConfigError
        If there are too few views, or they cover too little of the picture.
    """
    if len(views) < _MIN_VIEWS:
        raise ConfigError(
            f"the rectangle is seen whole by both cameras in {len(views)} pictures, {_MIN_VIEWS} are needed: move a"
            " bright flat rectangle before a darker background, away from walls, to all sides of the picture"
        )
    colour = np.concatenate([view.colour_uv for view in views])
    depth = np.concatenate([view.depth_uv for view in views])
    covered = (depth.max(axis=0) - depth.min(axis=0)) / np.array(depth_size)
    if covered.min() < _MIN_SPREAD:
        raise ConfigError(
            f"the rectangle covers only {100 * covered[0]:.0f} % of the picture's width and {100 * covered[1]:.0f} % of"
            " its height; move it to all four sides"
        )
    low_u, high_u, sigma_u, rms_u = _borders(depth[:, 0], colour[:, 0], depth_size[0])
    low_v, high_v, sigma_v, rms_v = _borders(depth[:, 1], colour[:, 1], depth_size[1])
    crop = Crop(
        max(0, round(low_u + 0.5)),
        max(0, round(colour_size[0] - 0.5 - high_u)),
        max(0, round(low_v + 0.5)),
        max(0, round(colour_size[1] - 0.5 - high_v)),
    )
    crop.size(colour_size)
    return CropFit(crop, max(sigma_u, sigma_v), math.hypot(rms_u, rms_v))


def _borders(
    depth: npt.NDArray[np.float64], colour: npt.NDArray[np.float64], n: int
) -> tuple[float, float, float, float]:
    """Return where the depth picture's first and last border are in colour, their sigma, and the residuals' rms."""
    A = np.stack([depth, np.ones_like(depth)], axis=1)
    line, *_ = np.linalg.lstsq(A, colour, rcond=None)
    residuals = colour - A @ line
    variance = float(residuals @ residuals) / max(len(depth) - 2, 1)
    cov = np.linalg.inv(A.T @ A) * variance
    borders = np.array([[-0.5, 1.0], [n - 0.5, 1.0]])
    sigma = float(np.sqrt(np.einsum("ij,jk,ik->i", borders, cov, borders).max()))
    low, high = (borders @ line).tolist()
    return low, high, sigma, float(np.sqrt((residuals**2).mean()))


def lens_of_angle(size: Size, horizontal_deg: float) -> Pinhole:
    """Return the lens of a capture angle, for cameras of which nothing else is known."""
    focal_px = size[0] / 2.0 / math.tan(math.radians(horizontal_deg) / 2.0)
    return Pinhole(focal_px, focal_px, (size[0] - 1) / 2.0, (size[1] - 1) / 2.0)


def as_depth_camera(crop: Crop, colour: Pinhole, colour_size: Size, depth_size: Size) -> DepthCamera:
    """Return the crop as a calibration: a depth lens at the same place that sees what the crop leaves.

    Parameters
    ----------
    crop : Crop
        What the depth camera does not see at each side.
    colour : Pinhole
        Lens of the colour camera.
    colour_size, depth_size : Size
        Width and height of the two pictures [px].

    Returns
    -------
    DepthCamera
        The depth lens, at the place of the colour lens.
    """
    R_x, R_y = ratios(depth_size, crop.size(colour_size))
    depth = Pinhole(
        R_x * colour.fx,
        R_y * colour.fy,
        R_x * (colour.cx - crop.left + 0.5) - 0.5,
        R_y * (colour.cy - crop.top + 0.5) - 0.5,
    )
    return DepthCamera(colour, depth)
