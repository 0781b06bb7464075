"""Frames and their payloads.

A payload says itself of what kind it is, and what those need to know who treat all payloads alike: checks, recorders,
viewers. A new kind is a subclass of `Payload`, and the sources and localizers that know it. Arrays are read-only views:
a localizer never edits what it is given.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from trailmark.arrays import AnyArray
from trailmark.errors import ShapeError
from trailmark.geometry import Pose2, Twist2

__all__ = [
    "PAYLOAD_KINDS",
    "RGBD",
    "Frame",
    "Image",
    "Imu",
    "Odometry",
    "Payload",
    "Record",
    "Scalar",
    "Scan",
    "read_only",
]


def read_only(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return a view of the array that cannot be written through."""
    view = array.view()
    view.flags.writeable = False
    return view


#: Arrays of more numbers are shown by shape and type.
_FEW = 4


def _brief(value: object) -> str:
    """Return a value as it is shown among others: one short line, whatever it holds."""
    if isinstance(value, np.ndarray):
        few = value.tolist() if value.size <= _FEW else f"<{' x '.join(map(str, value.shape))} {value.dtype}>"
        return str(few)
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{name}: {_brief(item)}' for name, item in value.items())}}}"
    return repr(value)


#: The kinds of sensor whose payload is fixed, as subclasses of `Payload` name them.
PAYLOAD_KINDS: dict[str, type[Payload]] = {}


class Payload:
    """What a frame carries: the base of every kind of reading, which are frozen dataclasses."""

    __slots__ = ()

    #: The kind of sensor that gives it; left out by a subclass that is no kind of its own.
    kind: ClassVar[str] = ""
    #: Whether a newer one makes it worthless, as pictures and scans.
    is_snapshot: ClassVar[bool] = False

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        if "kind" in vars(cls) and cls.kind != "record":
            PAYLOAD_KINDS[cls.kind] = cls
        if "__repr__" not in vars(cls):
            cls.__repr__ = cls.__repr__  # type: ignore[method-assign]  # else a dataclass makes one that prints arrays

    def __repr__(self) -> str:
        known: Any = self  # not to its type: subclasses are the dataclasses
        names = [field.name for field in fields(known)] if is_dataclass(known) else []
        return f"{type(self).__name__}({', '.join(f'{name}={_brief(getattr(self, name))}' for name in names)})"

    @property
    def picture(self) -> AnyArray | None:
        """The pixels that a person would look at, (H, W) or (H, W, 3) in BGR order; None: it is no picture."""
        return None

    @property
    def size(self) -> tuple[int, int] | None:
        """Width and height of the picture [px]."""
        picture = self.picture
        return None if picture is None else (picture.shape[1], picture.shape[0])

    @property
    def layout(self) -> tuple[Any, ...]:
        """What must not change from frame to frame of a sensor: shapes and types of pictures."""
        return ()

    @property
    def readings(self) -> tuple[AnyArray, ...]:
        """What noise makes another one each time: a sensor that repeats it has frozen. Of a picture the pixels."""
        return () if self.picture is None else (self.picture,)

    def numbers(self) -> Mapping[str, float]:
        """Return the reading as a row of a table, by column; empty where it is none.

        Unless a subclass says otherwise, its fields that are numbers.
        """
        values = {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]  # see above
        return {name: float(value) for name, value in values.items() if isinstance(value, int | float)}


@dataclass(frozen=True, slots=True, eq=False)
class Image(Payload):
    """A picture.

    Attributes
    ----------
    pixels : (H, W) uint8, (H, W, 3) uint8 or (H, W) uint16
        Grey, BGR, or grey with more than 8 bits.

    Raises
    ------
    ShapeError
        For any other shape or dtype, and for an empty picture.
    """

    kind: ClassVar[str] = "image"
    is_snapshot: ClassVar[bool] = True

    pixels: npt.NDArray[Any]

    def __post_init__(self) -> None:
        pixels = self.pixels
        is_grey = pixels.ndim == 2 and pixels.dtype in (np.uint8, np.uint16)
        is_bgr = pixels.ndim == 3 and pixels.shape[2] == 3 and pixels.dtype == np.uint8
        if not (is_grey or is_bgr) or pixels.size == 0:
            raise ShapeError(
                "an image is (H, W) uint8 or uint16, or (H, W, 3) uint8 in BGR order,"
                f" not {pixels.shape} {pixels.dtype}"
            )
        object.__setattr__(self, "pixels", read_only(pixels))

    @property
    def picture(self) -> AnyArray:
        """The pixels."""
        return self.pixels

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [px]."""
        return self.pixels.shape[1], self.pixels.shape[0]

    @property
    def layout(self) -> tuple[Any, ...]:
        """Shape and type."""
        return self.pixels.shape, self.pixels.dtype


@dataclass(frozen=True, slots=True, eq=False)
class RGBD(Payload):
    """A colour picture and its depth; the two may differ in size when depth is not registered to colour.

    Attributes
    ----------
    bgr : (H, W, 3) uint8
        Colour picture in BGR order.
    depth_m : (h, w) float32
        Depth, NaN where unknown; along the optical axis or along the ray, as `DepthCamera.depth_kind` says [m].

    Raises
    ------
    ShapeError
        For any other shape or dtype.
    """

    kind: ClassVar[str] = "rgbd"
    is_snapshot: ClassVar[bool] = True

    bgr: npt.NDArray[np.uint8]
    depth_m: npt.NDArray[np.float32]

    def __post_init__(self) -> None:
        bgr, depth = self.bgr, self.depth_m
        if bgr.ndim != 3 or bgr.shape[2] != 3 or bgr.dtype != np.uint8 or bgr.size == 0:
            raise ShapeError(f"bgr must be (H, W, 3) uint8, not {bgr.shape} {bgr.dtype}")
        if depth.ndim != 2 or depth.dtype != np.float32 or depth.size == 0:
            raise ShapeError(f"depth_m must be (h, w) float32, not {depth.shape} {depth.dtype}")
        object.__setattr__(self, "bgr", read_only(bgr))
        object.__setattr__(self, "depth_m", read_only(depth))

    @property
    def picture(self) -> AnyArray:
        """The colour picture."""
        return self.bgr

    @property
    def layout(self) -> tuple[Any, ...]:
        """Shapes of both pictures."""
        return self.bgr.shape, self.depth_m.shape

    @property
    def readings(self) -> tuple[AnyArray, ...]:
        """Both pictures: each is a camera of its own."""
        return self.bgr, self.depth_m


@dataclass(frozen=True, slots=True, eq=False)
class Scan(Payload):
    """One sweep of a planar laser; beam i looks along ``angle_min_rad + i * angle_step_rad``.

    Attributes
    ----------
    ranges_m : (N,) float
        Ranges, NaN where nothing came back [m].
    angle_min_rad, angle_step_rad : float
        Direction of the first beam and step to the next, in sensor axes, counter-clockwise [rad].
    range_min_m, range_max_m : float
        What the sensor can measure at all [m].
    """

    kind: ClassVar[str] = "scan"
    is_snapshot: ClassVar[bool] = True

    ranges_m: npt.NDArray[np.floating[Any]]
    angle_min_rad: float
    angle_step_rad: float
    range_min_m: float = 0.0
    range_max_m: float = math.inf

    def __post_init__(self) -> None:
        ranges = self.ranges_m
        if ranges.ndim != 1 or not np.issubdtype(ranges.dtype, np.floating):
            raise ShapeError(f"ranges_m must be (N,) of floats, not {ranges.shape} {ranges.dtype}")
        object.__setattr__(self, "ranges_m", read_only(ranges))

    @property
    def readings(self) -> tuple[AnyArray, ...]:
        """The ranges."""
        return (self.ranges_m,)

    def angles(self) -> npt.NDArray[np.float64]:
        """Return the direction of every beam, (N,) [rad]."""
        return np.asarray(self.angle_min_rad + self.angle_step_rad * np.arange(len(self.ranges_m)), dtype=np.float64)

    def points(self) -> npt.NDArray[np.float64]:
        """Return the returns as points in sensor axes, (M, 2), without the NaNs [m]."""
        seen = np.isfinite(self.ranges_m)
        angles, ranges = self.angles()[seen], np.asarray(self.ranges_m[seen], dtype=np.float64)
        return np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=1)

    def points_within(self, max_range_m: float) -> npt.NDArray[np.float64]:
        """Return the returns that are neither too near for the sensor nor too far, as points in sensor axes.

        Parameters
        ----------
        max_range_m : float
            Farther returns are left out, also where the sensor measures farther [m].

        Returns
        -------
        (M, 2) float64
            In the order of the rays [m].
        """
        points = self.points()
        ranges = np.hypot(points[:, 0], points[:, 1])
        return points[(ranges > self.range_min_m) & (ranges < min(max_range_m, self.range_max_m))]


@dataclass(frozen=True, slots=True)
class Odometry(Payload):
    """Wheel odometry since the sensor started, so that a frame that gets lost loses nothing.

    At least one of `pose_start_base` and `distance_m` is given.

    Attributes
    ----------
    pose_start_base : Pose2 or None
        Pose now, as seen from where the sensor started.
    distance_m : float or None
        Distance driven since the sensor started; backwards counts negative [m].
    twist : Twist2 or None
        Velocity now, where the sensor gives it.
    """

    kind: ClassVar[str] = "odometry"

    pose_start_base: Pose2 | None = None
    distance_m: float | None = None
    twist: Twist2 | None = None

    def __post_init__(self) -> None:
        if self.pose_start_base is None and self.distance_m is None:
            raise ShapeError("odometry needs a pose or a distance since the start")

    def numbers(self) -> Mapping[str, float]:
        """Return ``x, y, theta`` since the start, or else ``distance``."""
        if (pose := self.pose_start_base) is not None:
            return {"x": pose.x, "y": pose.y, "theta": pose.theta}
        assert self.distance_m is not None  # one or the other is given
        return {"distance": self.distance_m}


@dataclass(frozen=True, slots=True, eq=False)
class Imu(Payload):
    """An inertial reading in sensor axes.

    Attributes
    ----------
    angular_velocity_radps : (3,) float64
        Rates about x, y, z [rad/s].
    linear_acceleration_mps2 : (3,) float64 or None
        Specific force along x, y, z, gravity included [m/s^2].
    quat_xyzw : (4,) float64 or None
        Orientation, where the sensor estimates one.
    """

    kind: ClassVar[str] = "imu"

    angular_velocity_radps: npt.NDArray[np.float64]
    linear_acceleration_mps2: npt.NDArray[np.float64] | None = None
    quat_xyzw: npt.NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        for name, length in (("angular_velocity_radps", 3), ("linear_acceleration_mps2", 3), ("quat_xyzw", 4)):
            value = getattr(self, name)
            if value is None and name != "angular_velocity_radps":
                continue
            array = np.asarray(value, dtype=np.float64)
            if array.shape != (length,):
                raise ShapeError(f"{name} must have shape ({length},), not {array.shape}")
            object.__setattr__(self, name, read_only(array))

    def numbers(self) -> Mapping[str, float]:
        """Return rates ``wx, wy, wz`` and accelerations ``ax, ay, az``, NaN where unknown."""
        force = self.linear_acceleration_mps2
        values = (*self.angular_velocity_radps, *(np.full(3, np.nan) if force is None else force))
        return dict(zip(("wx", "wy", "wz", "ax", "ay", "az"), values, strict=True))


@dataclass(frozen=True, slots=True)
class Scalar(Payload):
    """A single number, for example ambient light; the sensor's kind says of what.

    Attributes
    ----------
    value : float
        The reading, in SI units.
    """

    kind: ClassVar[str] = "scalar"

    value: float


@dataclass(frozen=True, slots=True, eq=False)
class Record(Payload):
    """Named arrays, for sensors that fit no other payload; `SensorInfo.kind` says what they mean.

    Attributes
    ----------
    arrays : mapping of str to ndarray
        For example ids, ranges and bearings of landmarks.
    """

    kind: ClassVar[str] = "record"

    arrays: Mapping[str, npt.NDArray[Any]]

    def __post_init__(self) -> None:
        views = {name: read_only(np.asarray(array)) for name, array in self.arrays.items()}
        object.__setattr__(self, "arrays", MappingProxyType(views))


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One reading of one sensor.

    Attributes
    ----------
    sensor : str
        Name of the sensor.
    stamp_s : float
        When it was taken, in the clock of the run [s].
    payload : Payload
        What was read.
    """

    sensor: str
    stamp_s: float
    payload: Payload

    def __post_init__(self) -> None:
        if not math.isfinite(self.stamp_s):
            raise ShapeError(f"the stamp of a frame of {self.sensor!r} is not finite: {self.stamp_s}")
