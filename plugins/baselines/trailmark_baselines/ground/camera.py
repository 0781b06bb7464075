"""What the peers know of their camera: grey pictures of even light, and pixels as places on the ground."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from trailmark.config import UNNAMED
from trailmark.errors import SensorMismatchError, ShapeError
from trailmark.frames import Frame, GroundPlane, Image, SensorInfo
from trailmark.geometry import Pose2
from trailmark.interfaces import Session

__all__ = ["DownwardCamera", "Grey", "Points", "ground_camera"]

Grey = npt.NDArray[np.uint8]
Points = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class DownwardCamera:
    """A calibrated camera that looks straight down; its axes are x along +u and y along -v.

    Attributes
    ----------
    name : str
        Name of the sensor.
    plane : GroundPlane
        Its calibration.
    mounting : Pose2
        The camera as seen from base.
    """

    name: str
    plane: GroundPlane
    mounting: Pose2

    def grey(self, frame: Frame) -> Grey:
        """Return the grey picture without distortion and vignette, (H, W) uint8.

        Raises
        ------
        ShapeError
            If the frame is no image, or of another size than the flat field.
        """
        if not isinstance(frame.payload, Image):
            raise ShapeError(f"sensor {self.name!r} gave {type(frame.payload).__name__}, but a camera gives Image")
        pixels, flat = frame.payload.pixels, self.plane.flat_field
        if pixels.dtype != np.uint8:
            raise ShapeError(f"sensor {self.name!r} gives {pixels.dtype}; this localizer takes pictures of 8 bits")
        grey = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY) if pixels.ndim == 3 else pixels
        if flat is not None:
            if flat.shape != grey.shape:
                raise ShapeError(f"the flat field of sensor {self.name!r} is {flat.shape}, its pictures {grey.shape}")
            grey = cv2.divide(grey, flat, dtype=cv2.CV_8U)
        lens = self.plane.lens
        if lens is not None and any(lens.distortion):
            grey = cv2.undistort(grey, lens.matrix(), np.array(lens.distortion))
        return np.asarray(grey, np.uint8)

    def on_ground(self, pixels: Points, size: tuple[int, int]) -> Points:
        """Return where pixels (N, 2) of a picture of `size` (W, H) lie, in the camera's axes (N, 2) [m]."""
        along_u, along_v = self.plane.metres_per_pixel
        middle = np.array([(size[0] - 1) / 2.0, (size[1] - 1) / 2.0])
        return np.asarray((pixels - middle) * np.array([along_u, -along_v]))

    def in_picture(self, points: Points, size: tuple[int, int]) -> Points:
        """Return the pixels (N, 2) that show places (N, 2) [m]: the inverse of `on_ground`."""
        along_u, along_v = self.plane.metres_per_pixel
        middle = np.array([(size[0] - 1) / 2.0, (size[1] - 1) / 2.0])
        return np.asarray(points / np.array([along_u, -along_v]) + middle)


def ground_camera(session: Session, name: str) -> DownwardCamera:
    """Return the camera of a session; an empty name means its only one.

    Raises
    ------
    ConfigError
        If there is none of that name, or it has no scale, or does not look straight down.
    """
    cameras = {sensor.name: sensor for sensor in session.sensors.values() if sensor.kind == "image"}
    if name == UNNAMED and len(cameras) == 1:
        name = next(iter(cameras))
    if name not in cameras:
        known = ", ".join(cameras) or "none"
        raise SensorMismatchError(f"localizer {session.name!r}: no camera {name!r} of kind image; there are: {known}")
    return _camera(session.name, cameras[name])


def _camera(who: str, sensor: SensorInfo) -> DownwardCamera:
    plane, mounting = sensor.calibration, sensor.pose_base_sensor
    if not isinstance(plane, GroundPlane):
        raise SensorMismatchError(
            f"localizer {who!r}: sensor {sensor.name!r} needs the scale of a ground camera:"
            " `calibration: {metres_per_pixel: 3.9e-4}`"
        )
    if abs(mounting.roll) > 1e-9 or abs(mounting.pitch) > 1e-9:
        raise SensorMismatchError(
            f"localizer {who!r}: sensor {sensor.name!r} must be level; give x, y and yaw of its mounting"
        )
    return DownwardCamera(sensor.name, plane, mounting.planar())
