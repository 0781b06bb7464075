"""What is known about how a sensor maps the world to its readings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from trailmark.errors import ShapeError
from trailmark.frames.payloads import read_only
from trailmark.geometry import Pose3

__all__ = ["Arrays", "Calibration", "DepthCamera", "GroundPlane", "Omni", "Pinhole"]


@dataclass(frozen=True, slots=True)
class Pinhole:
    """A perspective camera with the lens distortion model of OpenCV.

    Camera axes: x right, y down, z forward; pixels (u, v), centre of the first pixel at (0, 0).

    Attributes
    ----------
    fx, fy : float
        Focal lengths [px].
    cx, cy : float
        Principal point [px].
    distortion : tuple of float
        k1, k2, p1, p2[, k3[, k4, k5, k6]]; empty for none.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not (self.fx > 0 and self.fy > 0):
            raise ShapeError(f"focal lengths must be positive, not fx={self.fx}, fy={self.fy}")
        if len(self.distortion) not in (0, 4, 5, 8):
            raise ShapeError(f"distortion has 4, 5 or 8 numbers (k1 k2 p1 p2 ...), not {len(self.distortion)}")

    def matrix(self) -> npt.NDArray[np.float64]:
        """Return the (3, 3) camera matrix."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True)
class Omni:
    """An omnidirectional camera that looks straight up or down: bearings turn about the image centre.

    Attributes
    ----------
    centre_u, centre_v : float or None
        Image centre of the mirror or lens; None: to be found in the image [px].
    radius_inner_px, radius_outer_px : float or None
        Ring of the image that shows the surroundings [px].
    turns : {"clockwise", "counterclockwise"}
        How the image turns when the world's bearing grows counter-clockwise: mirrors seen from
        below turn one way, lenses the other.
    forward_deg : float
        Image direction of the robot's forward axis, from +u towards +v [deg].
    """

    centre_u: float | None = None
    centre_v: float | None = None
    radius_inner_px: float | None = None
    radius_outer_px: float | None = None
    turns: Literal["clockwise", "counterclockwise"] = "counterclockwise"
    forward_deg: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class GroundPlane:
    """A camera that looks straight down on the ground.

    Attributes
    ----------
    metres_per_pixel : (float, float)
        Ground distance of one pixel along u and along v [m/px].
    lens : Pinhole or None
        Lens model, where the distortion is to be removed.
    flat_field : (H, W) float32 or None
        Brightness of a uniform surface relative to its mean: vignetting and uneven lighting.
    """

    metres_per_pixel: tuple[float, float]
    lens: Pinhole | None = None
    flat_field: npt.NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        scales: Sequence[float] = self.metres_per_pixel
        if len(scales) != 2 or not all(scale > 0 for scale in scales):
            raise ShapeError(f"metres_per_pixel must be two positive numbers, not {self.metres_per_pixel}")
        if self.flat_field is not None:
            flat = np.asarray(self.flat_field, dtype=np.float32)
            if flat.ndim != 2 or not np.all(flat > 0):
                raise ShapeError(f"flat_field must be (H, W) of positive numbers, not {flat.shape}")
            object.__setattr__(self, "flat_field", read_only(flat))


@dataclass(frozen=True, slots=True)
class DepthCamera:
    """A colour camera with a depth camera beside it.

    Attributes
    ----------
    colour : Pinhole
        The colour camera.
    depth : Pinhole or None
        The depth camera; None when depth is registered to colour, pixel by pixel.
    pose_colour_depth : Pose3
        ``point_colour = pose_colour_depth @ point_depth``, in sensor axes (x forward, y left, z up) as every pose of a
        sensor.
    depth_kind : {"z", "range"}
        Whether depth is measured along the optical axis or along the ray.
    """

    colour: Pinhole
    depth: Pinhole | None = None
    pose_colour_depth: Pose3 = Pose3()
    depth_kind: Literal["z", "range"] = "z"


@dataclass(frozen=True, slots=True, eq=False)
class Arrays:
    """Named arrays, for sensors that fit no other model.

    Attributes
    ----------
    arrays : mapping of str to ndarray
        What they mean is between the source and the localizer.
    """

    arrays: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        views = {name: read_only(np.asarray(array)) for name, array in self.arrays.items()}
        object.__setattr__(self, "arrays", MappingProxyType(views))


Calibration = Pinhole | Omni | GroundPlane | DepthCamera | Arrays
