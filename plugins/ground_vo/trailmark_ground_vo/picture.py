"""From a camera's frame to the grey picture that the kernels work on."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Float32s, Grey8, Grey16
from trailmark.config import UNNAMED
from trailmark.errors import ConfigError, SensorMismatchError, ShapeError
from trailmark.frames import Frame, GroundPlane, Image, SensorInfo
from trailmark.interfaces import Session
from trailmark_ground_vo.filters import GAIN_ONE, flatten
from trailmark_ground_vo.interlace import FieldReader

__all__ = ["PictureReader", "camera_of", "ground_plane"]


def camera_of(session: Session, name: str) -> SensorInfo:
    """Return the camera of a session; an empty name means its only one.

    Raises
    ------
    ConfigError
        If there is no camera of that name, or several and no name.
    """
    cameras = {sensor.name: sensor for sensor in session.sensors.values() if sensor.kind == "image"}
    if name in cameras:
        return cameras[name]
    if name == UNNAMED and len(cameras) == 1:
        return next(iter(cameras.values()))
    known = ", ".join(cameras) or "none"
    raise SensorMismatchError(f"localizer {session.name!r}: no camera {name!r} of kind image; there are: {known}")


def ground_plane(sensor: SensorInfo) -> GroundPlane:
    """Return the calibration of a camera that looks straight down.

    Raises
    ------
    ConfigError
        If there is none, or if the mounting is not level.
    """
    calibration = sensor.calibration
    if not isinstance(calibration, GroundPlane):
        found = "no calibration" if calibration is None else f"the calibration of a {type(calibration).__name__}"
        raise SensorMismatchError(
            f"sensor {sensor.name!r} has {found}, but a ground camera needs its scale: add"
            " `calibration: {metres_per_pixel: 3.9e-4}` or measure it with `trailmark calibrate ground`"
        )
    mounting = sensor.pose_base_sensor
    if abs(mounting.roll) > 1e-9 or abs(mounting.pitch) > 1e-9:
        raise SensorMismatchError(
            f"sensor {sensor.name!r} is mounted with roll {mounting.roll:g} and pitch {mounting.pitch:g} rad, but a"
            " ground camera is level: its x axis lies along u of the picture, its y axis along -v; give x, y and yaw"
        )
    return calibration


class PictureReader:
    """Turns frames of one camera into grey pictures of 8 bits, of even brightness and without lens distortion.

    Parameters
    ----------
    sensor : SensorInfo
        The camera; its calibration is a `GroundPlane`.

    Raises
    ------
    ConfigError
        If the calibration is missing or its flat field has another size than the camera.
    """

    def __init__(self, sensor: SensorInfo) -> None:
        plane = ground_plane(sensor)
        self.has_flat_field = plane.flat_field is not None
        self._name = sensor.name
        self._fields = FieldReader()
        self._lens = plane.lens if plane.lens is not None and any(plane.lens.distortion) else None
        self._gain = None if plane.flat_field is None else _gain(plane.flat_field)
        self._learned_gain: Grey16 | None = None
        self.unevenness = 0.0  # of the light that was learned: standard deviation, as a share of it
        self._kind: tuple[tuple[int, ...], np.dtype[np.generic]] | None = None
        self._shift_bits = 0
        self._maps: tuple[npt.NDArray[np.int16], Grey16] | None = None
        if sensor.size is not None and self._gain is not None:
            self._check_flat_field((sensor.size[1], sensor.size[0]))

    def read(self, frame: Frame) -> Grey8:
        """Return the grey picture, (H, W) uint8, C-contiguous.

        Raises
        ------
        ShapeError
            If the frame is no image, or of another size or kind than the first one.
        """
        if not isinstance(frame.payload, Image):
            given = type(frame.payload).__name__
            raise ShapeError(f"sensor {self._name!r} gave {given}, but a ground camera gives Image")
        pixels = frame.payload.pixels
        if self._kind is None:
            self._begin(pixels)
        elif self._kind != (pixels.shape, pixels.dtype):
            now = _describe(pixels.shape, pixels.dtype)
            raise ShapeError(
                f"sensor {self._name!r} changed from {_describe(*self._kind)} to {now}"
                f" at {frame.stamp_s:.6f} s; start anew for another size"
            )
        grey = self._fields.read(self._grey(pixels))
        if self._gain is not None:
            grey = flatten(grey, self._gain)
        if self._maps is not None:
            grey = self._undistort(grey)
        return grey if self._learned_gain is None else flatten(grey, self._learned_gain)

    def warm_up(self) -> None:
        """Compile what the first pictures will need."""
        flatten(np.zeros((16, 16), np.uint8), np.full((16, 16), GAIN_ONE, np.uint16))

    def learn(self, flat_field: Float32s) -> None:
        """Correct with this flat field from now on, beside that of the calibration."""
        self._learned_gain = _gain(flat_field)
        self.unevenness = float(np.std(flat_field))

    def _begin(self, pixels: npt.NDArray[np.generic]) -> None:
        height, width = pixels.shape[:2]
        if self._gain is not None:
            self._check_flat_field((height, width))
        if pixels.dtype == np.uint16:  # cameras of 10 or 12 bits leave the upper ones empty
            self._shift_bits = max(0, int(np.max(pixels)).bit_length() - 8)
        if self._lens is not None:
            import cv2

            matrix, distortion = self._lens.matrix(), np.array(self._lens.distortion)
            maps = cv2.initUndistortRectifyMap(matrix, distortion, np.eye(3), matrix, (width, height), cv2.CV_16SC2)
            self._maps = (np.asarray(maps[0], np.int16), np.asarray(maps[1], np.uint16))
        self._kind = (pixels.shape, pixels.dtype)

    def _check_flat_field(self, shape: tuple[int, int]) -> None:
        if self._gain is not None and self._gain.shape != shape:
            raise ConfigError(
                f"the flat field of sensor {self._name!r} is {_describe(self._gain.shape)}, but its pictures are"
                f" {_describe(shape)}; take the reference image with the same camera"
            )

    def _grey(self, pixels: npt.NDArray[np.generic]) -> Grey8:
        if pixels.ndim == 3:
            import cv2

            return np.asarray(cv2.cvtColor(np.asarray(pixels, np.uint8), cv2.COLOR_BGR2GRAY), np.uint8)
        if pixels.dtype == np.uint16:
            shifted = np.asarray(pixels, np.uint16) >> np.uint16(self._shift_bits)
            return np.asarray(np.minimum(shifted, 255), np.uint8)
        return np.array(pixels, np.uint8, order="C")  # a copy: kernels are compiled for arrays that can be written

    def _undistort(self, grey: Grey8) -> Grey8:
        import cv2

        assert self._maps is not None
        return np.asarray(cv2.remap(grey, *self._maps, cv2.INTER_LINEAR), np.uint8)


def _gain(flat_field: Float32s) -> Grey16:
    return np.clip(np.rint(GAIN_ONE / flat_field), 1, 2**15 - 1).astype(np.uint16)


def _describe(shape: tuple[int, ...], dtype: np.dtype[np.generic] | None = None) -> str:
    size = f"{shape[1]} x {shape[0]}" + (" x 3" if len(shape) == 3 else "")
    return size if dtype is None else f"{size} {dtype}"
