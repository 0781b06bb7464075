"""Frames, beliefs and estimates in the archetypes of Rerun."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import rerun as rr

from trailmark.frames import Arrays, Calibration, DepthCamera, Pinhole, Record, Scan
from trailmark.geometry import Pose2, Pose3
from trailmark_viewers.common import jpeg, quaternion_xyzw, to_space

__all__ = [
    "depth_lens",
    "depth_picture",
    "known_landmarks",
    "lens",
    "line",
    "picture",
    "pinhole",
    "scalars",
    "scan",
    "sightings",
    "transform",
]

Floats = npt.NDArray[np.floating[Any]]

# Spots are drawn at this radius in the scene [m].
_SPOT_M = 0.03


def transform(pose: Pose2 | Pose3) -> Any:
    """Return ``pose_parent_child``, for the entity that is the child's frame."""
    pose = to_space(pose) if isinstance(pose, Pose2) else pose
    return rr.Transform3D(
        translation=[pose.x, pose.y, pose.z], quaternion=rr.Quaternion(xyzw=list(quaternion_xyzw(pose)))
    )


def line(poses: Sequence[Pose2], colour: Sequence[int] | None = None) -> Any:
    """Return the way through some poses."""
    return rr.LineStrips3D([[[pose.x, pose.y, 0.0] for pose in poses]], colors=None if colour is None else [colour])


def picture(pixels: npt.NDArray[Any], how: str, quality: int) -> Any:
    """Return a grey or BGR picture, as JPEG if asked for and it has 8 bits."""
    if how == "jpeg" and pixels.dtype == np.uint8:
        return rr.EncodedImage(contents=jpeg(pixels, quality), media_type="image/jpeg")
    return rr.Image(pixels, color_model="L" if pixels.ndim == 2 else "BGR")


def depth_picture(depth_m: npt.NDArray[np.float32]) -> Any:
    """Return a picture of depths; zero where it is not known, as Rerun has it."""
    return rr.DepthImage(np.nan_to_num(depth_m, nan=0.0, posinf=0.0), meter=1.0)


def lens(calibration: Calibration | None) -> Pinhole | None:
    """Return the lens of a picture that shows space; of one of the ground there is none to draw."""
    if isinstance(calibration, DepthCamera):
        return calibration.colour
    return calibration if isinstance(calibration, Pinhole) else None


def depth_lens(calibration: Calibration | None) -> tuple[Pinhole, Pose3] | None:
    """Return lens and place beside the colour camera of a depth picture; None where depth lies along the rays."""
    if not isinstance(calibration, DepthCamera) or calibration.depth_kind != "z":
        return None
    if calibration.depth is None:
        return calibration.colour, Pose3()
    return calibration.depth, calibration.pose_colour_depth


def pinhole(calibration: Pinhole, pixels: npt.NDArray[Any]) -> Any:
    """Return a lens, without its distortion, in sensor axes: x forward, y left, z up."""
    height, width = pixels.shape[:2]
    return rr.Pinhole(
        image_from_camera=calibration.matrix(),
        resolution=[width, height],
        camera_xyz=rr.ViewCoordinates.FLU,
        image_plane_distance=0.3,
    )


def scan(payload: Scan) -> Any:
    """Return the spots of a sweep, in sensor axes."""
    ranges_m: Floats = np.asarray(payload.ranges_m, dtype=np.float64)
    bearings: Floats = payload.angle_min_rad + payload.angle_step_rad * np.arange(len(ranges_m))
    return _spots(ranges_m, bearings)


def sightings(payload: Record) -> Any | None:
    """Return landmarks that were seen at ``ranges_m`` and ``bearings_rad``, in sensor axes; None of another record."""
    arrays = payload.arrays
    if not {"ranges_m", "bearings_rad"} <= arrays.keys():
        return None
    ranges_m: Floats = np.asarray(arrays["ranges_m"], dtype=np.float64)
    bearings: Floats = np.asarray(arrays["bearings_rad"], dtype=np.float64)
    return _spots(ranges_m, bearings, arrays.get("ids"))


def known_landmarks(calibration: Calibration | None) -> Any | None:
    """Return landmarks whose ``positions_map`` are known; None without them."""
    if not isinstance(calibration, Arrays) or "positions_map" not in calibration.arrays:
        return None
    positions = np.asarray(calibration.arrays["positions_map"], dtype=np.float64)
    places = np.column_stack([positions[:, :2], np.zeros(len(positions))])
    return rr.Points3D(places, radii=_SPOT_M, labels=_labels(calibration.arrays.get("ids")), show_labels=True)


def _spots(ranges_m: Floats, bearings: Floats, ids: Any = None) -> Any:
    seen = np.isfinite(ranges_m)
    ranges_m, bearings = ranges_m[seen], bearings[seen]
    places = np.stack([ranges_m * np.cos(bearings), ranges_m * np.sin(bearings), np.zeros(len(ranges_m))], axis=1)
    return rr.Points3D(places, radii=_SPOT_M, labels=None if ids is None else _labels(np.asarray(ids)[seen]))


def _labels(ids: Any) -> list[str] | None:
    return None if ids is None else [str(item) for item in np.asarray(ids).tolist()]


def scalars(values: Sequence[float | None]) -> Any | None:
    """Return numbers to plot; None where there is none, or one of them is not known."""
    if not values or any(value is None or not math.isfinite(value) for value in values):
        return None
    return rr.Scalars([float(value) for value in values if value is not None])
