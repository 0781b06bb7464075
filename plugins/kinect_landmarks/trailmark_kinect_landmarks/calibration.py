"""Which depth belongs to which colour pixel: the paper's crop ratios, or registration by reprojection.

Both answer with integer depth pixels that exist.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import ConfigError
from trailmark.frames import DepthCamera
from trailmark.geometry import Pose3
from trailmark.kernels import kernel

__all__ = ["Crop", "depth_pixels", "optical_transform", "ratios", "register_depth", "sensor_transform"]


_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # optical axes in sensor axes, REP-103


@dataclass(frozen=True, slots=True)
class Crop:
    """Lines of the colour picture that the depth camera does not see, at each side [px].

    Attributes
    ----------
    left, right, top, bottom : int
        Columns and rows at that side [px].
    """

    left: int = 0
    right: int = 0
    top: int = 0
    bottom: int = 0

    def size(self, colour_size: tuple[int, int]) -> tuple[int, int]:
        """Return x_calib and y_calib, the size of what is left of the colour picture [px].

        Raises
        ------
        ConfigError
            If nothing is left.
        """
        width, height = colour_size[0] - self.left - self.right, colour_size[1] - self.top - self.bottom
        if min(width, height, self.left + 1, self.right + 1, self.top + 1, self.bottom + 1) < 1:
            raise ConfigError(
                f"crop {self} does not fit into a colour picture of {colour_size[0]} x {colour_size[1]} px"
            )
        return width, height

    @classmethod
    def from_rectangles(cls, colour_edges: tuple[float, float, float, float], colour_size: tuple[int, int]) -> Crop:
        """Return the crop of the paper's procedure: where the rectangle was when it touched the depth's borders.

        Parameters
        ----------
        colour_edges : (left, right, top, bottom)
            Colour columns and rows of the rectangle's outer edge when it touched that border of the depth picture,
            in colour pixels from the picture's left and top [px].
        colour_size : (int, int)
            Width and height of the colour picture [px].
        """
        left, right, top, bottom = (round(edge) for edge in colour_edges)
        crop = cls(left, colour_size[0] - 1 - right, top, colour_size[1] - 1 - bottom)
        crop.size(colour_size)
        return crop


def ratios(depth_size: tuple[int, int], crop_size: tuple[int, int]) -> tuple[float, float]:
    """Return R_x and R_y, Eqs. (3) and (4): size of the depth picture by that of the cropped colour picture."""
    return depth_size[0] / crop_size[0], depth_size[1] / crop_size[1]


def depth_pixels(
    uv: Floats, crop: Crop, colour_size: tuple[int, int], depth_size: tuple[int, int]
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.bool_]]:
    """Return the depth pixels of colour pixels, Eqs. (5) and (6), and which of them exist.

    Parameters
    ----------
    uv : (N, 2) float
        Pixels of the whole colour picture [px].

    Returns
    -------
    (N, 2) int, (N,) bool
        x_final, y_final, rounded, and kept inside the depth picture where they would fall outside of it.
    """
    R = np.array(ratios(depth_size, crop.size(colour_size)))
    final = np.floor(R * (np.asarray(uv, float) - (crop.left, crop.top) + 0.5)).astype(np.intp)  # centres of pixels
    last = np.array(depth_size) - 1
    exists = np.all((final >= 0) & (final <= last), axis=1)
    return np.clip(final, 0, last), exists


def optical_transform(pose_colour_depth: Pose3) -> Floats:
    """Return the (4, 4) transform from the depth camera's optical axes to the colour camera's.

    The pose is between sensor axes (x forward, y left, z up), as every pose of a sensor is.
    """
    axes = np.eye(4)
    axes[:3, :3] = _OPTICAL
    return np.asarray(axes.T @ pose_colour_depth.matrix() @ axes)


def sensor_transform(T_colour_depth: Floats) -> Pose3:
    """Return the pose between the sensor axes of a (4, 4) transform between the optical axes."""
    axes = np.eye(4)
    axes[:3, :3] = _OPTICAL
    return Pose3.from_matrix(axes @ T_colour_depth @ axes.T)


def register_depth(
    depth_m: npt.NDArray[np.float32], camera: DepthCamera, colour_size: tuple[int, int]
) -> npt.NDArray[np.float32]:
    """Return depth as the colour camera would see it, NaN where unknown.

    Parameters
    ----------
    depth_m : (h, w) float32
        Picture of the depth camera, NaN where unknown [m].
    camera : DepthCamera
        Both lenses and the pose between them. The depth lens's distortion is ignored: structured-light and
        time-of-flight cameras deliver rectified depth.
    colour_size : (int, int)
        Width and height of the result [px].

    Returns
    -------
    (H, W) float32
        Of the same `depth_kind`; where two surfaces fall on one pixel, the nearer.
    """
    if camera.depth is None:
        return depth_m
    colour, depth = camera.colour, camera.depth
    registered = np.full((colour_size[1], colour_size[0]), np.float32(np.inf))
    k = np.zeros(8)
    k[: len(colour.distortion)] = colour.distortion
    _reproject(
        np.ascontiguousarray(depth_m),
        np.array([depth.fx, depth.fy, depth.cx, depth.cy]),
        np.array([colour.fx, colour.fy, colour.cx, colour.cy]),
        k,
        optical_transform(camera.pose_colour_depth),
        camera.depth_kind == "range",
        registered,
    )
    registered[np.isinf(registered)] = np.nan
    return registered


@kernel
def _reproject(depth_m: Any, lens: Any, colour: Any, k: Any, T: Any, is_range: bool, out: Any) -> None:
    height, width = out.shape
    # one depth pixel covers this many colour pixels: without it a wider lens leaves a grid of holes
    half_u = 0.5 * colour[0] / lens[0]
    half_v = 0.5 * colour[1] / lens[1]
    for row in range(depth_m.shape[0]):
        for column in range(depth_m.shape[1]):
            d = depth_m[row, column]
            if not d > 0.0:
                continue
            x, y = (column - lens[2]) / lens[0], (row - lens[3]) / lens[1]
            z = d / np.sqrt(1.0 + x * x + y * y) if is_range else d
            px = T[0, 0] * x * z + T[0, 1] * y * z + T[0, 2] * z + T[0, 3]
            py = T[1, 0] * x * z + T[1, 1] * y * z + T[1, 2] * z + T[1, 3]
            pz = T[2, 0] * x * z + T[2, 1] * y * z + T[2, 2] * z + T[2, 3]
            if pz <= 0.0:
                continue
            a, b = px / pz, py / pz
            r2 = a * a + b * b
            radial = (1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))) / (1.0 + r2 * (k[5] + r2 * (k[6] + r2 * k[7])))
            u = colour[0] * (a * radial + 2.0 * k[2] * a * b + k[3] * (r2 + 2.0 * a * a)) + colour[2]
            v = colour[1] * (b * radial + k[2] * (r2 + 2.0 * b * b) + 2.0 * k[3] * a * b) + colour[3]
            told = np.sqrt(px * px + py * py + pz * pz) if is_range else pz
            for i in range(max(0, int(np.ceil(v - half_v))), min(height - 1, int(np.floor(v + half_v))) + 1):
                for j in range(max(0, int(np.ceil(u - half_u))), min(width - 1, int(np.floor(u + half_u))) + 1):
                    out[i, j] = min(out[i, j], told)
