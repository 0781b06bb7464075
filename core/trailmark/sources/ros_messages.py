"""From ROS messages to payloads. Messages are read by their attributes, so ROS 1 and ROS 2 look alike."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.arrays import Floats
from trailmark.errors import SourceError
from trailmark.frames import RGBD, Image, Imu, Odometry, Pinhole, Scan
from trailmark.geometry import Pose2, Twist2
from trailmark.sources.depth import depth_in_metres
from trailmark.sources.pictures import as_payload_pixels, decode_raw
from trailmark.sources.rgbd_pairs import StampedMessage

__all__ = [
    "COMPRESSED",
    "IMAGE_TYPES",
    "KINDS",
    "image",
    "imu",
    "info_topic",
    "is_depth",
    "lens",
    "odometry",
    "pixels",
    "planar_pose",
    "planar_twist",
    "rgbd",
    "scan",
    "stamp_of",
]

COMPRESSED = "sensor_msgs/msg/CompressedImage"
IMAGE_TYPES = ("sensor_msgs/msg/Image", COMPRESSED)

#: Kind of sensor of every message type that is understood.
KINDS = {
    "sensor_msgs/msg/Image": "image",
    COMPRESSED: "image",
    "nav_msgs/msg/Odometry": "odometry",
    "sensor_msgs/msg/LaserScan": "scan",
    "sensor_msgs/msg/Imu": "imu",
}

# dtype, channels, and the order of the channels that makes them BGR
_ENCODINGS: dict[str, tuple[str, int, tuple[int, ...]]] = {
    "mono8": ("u1", 1, ()),
    "8UC1": ("u1", 1, ()),
    "mono16": ("u2", 1, ()),
    "16UC1": ("u2", 1, ()),
    "32FC1": ("f4", 1, ()),
    "bgr8": ("u1", 3, (0, 1, 2)),
    "8UC3": ("u1", 3, (0, 1, 2)),
    "rgb8": ("u1", 3, (2, 1, 0)),
    "bgra8": ("u1", 4, (0, 1, 2)),
    "rgba8": ("u1", 4, (2, 1, 0)),
}
# Colours of the first pixels of the first two rows; OpenCV names a pattern by those of the second row and column.
_BAYER = {"bayer_rggb8": "BG", "bayer_bggr8": "RG", "bayer_gbrg8": "GR", "bayer_grbg8": "GB"}
_LEAST_NORM = 1e-6  # of a quaternion; the squares of a smaller one vanish
_MOST_RAD = 4 * math.pi  # angles of a scan; two turns, since some count theirs from where they like
_COMPRESSED_DEPTH_HEADER = 12  # bytes of quantisation before the PNG


def stamp_of(message: Any, where: str) -> float:
    """Return the stamp of the message's header [s].

    Raises
    ------
    SourceError
        If the sender left it empty.
    """
    stamp = message.header.stamp
    if stamp.sec == 0 and stamp.nanosec == 0:
        raise SourceError(f"{where}: the header's stamp is empty; set stamps: receive")
    return float(stamp.sec) + float(stamp.nanosec) / 1e9


def pixels(message: Any, where: str) -> npt.NDArray[Any]:
    """Return the picture of an Image or CompressedImage message: grey, BGR, or depth.

    Returns
    -------
    (H, W) or (H, W, 3)
        uint8, uint16, or float32 for 32FC1.

    Raises
    ------
    SourceError
        If the encoding is not understood or the data do not fit.
    """
    if not hasattr(message, "encoding"):
        return _decode_image(message, where)
    bayer = _BAYER.get(message.encoding)
    if message.encoding not in _ENCODINGS and bayer is None:
        known = ", ".join((*_ENCODINGS, *_BAYER))
        raise SourceError(f"{where}: encoding {message.encoding!r} is not understood; understood: {known}")
    code, channels, order = _ENCODINGS["mono8" if bayer else message.encoding]
    dtype = np.dtype(code).newbyteorder(">" if message.is_bigendian else "<")
    height, width, step = int(message.height), int(message.width), int(message.step)
    data = np.ascontiguousarray(message.data).view(np.uint8).ravel()
    row_bytes = width * channels * dtype.itemsize
    if height <= 0 or width <= 0 or step < row_bytes or len(data) < height * step:
        raise SourceError(
            f"{where}: {len(data)} bytes are no {width}x{height} picture of {message.encoding} with {step} bytes a row"
        )
    rows = data[: height * step].reshape(height, step)[:, :row_bytes]
    picture = np.ascontiguousarray(rows).view(dtype).astype(dtype.newbyteorder("="), copy=False)
    if bayer:
        import cv2

        return cv2.cvtColor(picture, getattr(cv2, f"COLOR_Bayer{bayer}2BGR"))
    if channels == 1:
        return picture
    return np.ascontiguousarray(picture.reshape(height, width, channels)[:, :, list(order)])


def _decode_image(message: Any, where: str) -> npt.NDArray[Any]:
    data = bytes(message.data)
    if "compressedDepth" in message.format:
        if "32FC1" in message.format:
            raise SourceError(f"{where}: compressed depth of 32FC1 is not understood; record 16UC1 or raw depth")
        data = data[_COMPRESSED_DEPTH_HEADER:]
    return decode_raw(data, where)


def is_depth(message: Any) -> bool:
    """Return whether the encoding of a picture is one of depth."""
    return getattr(message, "encoding", "") == "32FC1" or "compressedDepth" in getattr(message, "format", "")


def image(message: Any, where: str) -> Image:
    """Return the picture of a message."""
    if is_depth(message):
        raise SourceError(f"{where} is depth; pair it with its colour: rgbd: {{name: {{colour: /..., depth: /...}}}}")
    return Image(as_payload_pixels(pixels(message, where), where, None))


def rgbd(colour: StampedMessage, depth: StampedMessage) -> RGBD:
    """Return a colour picture and a depth picture as one reading; depth is 32FC1 in metres or 16UC1 in millimetres."""
    bgr = as_payload_pixels(pixels(colour.message, colour.where), colour.where, grey=False)
    raw = pixels(depth.message, depth.where)
    values_per_metre = 1.0 if raw.dtype.kind == "f" else 1000.0  # REP-118
    return RGBD(bgr, depth_in_metres(raw, values_per_metre, depth.where))


def planar_pose(pose: Any) -> Pose2:
    """Return what a Pose message says of the plane.

    Raises
    ------
    ValueError
        If its quaternion is (nearly) zero, which is no orientation: its sender left it empty.
    """
    position, q = pose.position, pose.orientation
    if math.hypot(q.x, q.y, q.z, q.w) < _LEAST_NORM:
        raise ValueError("the orientation is the quaternion (0, 0, 0, 0), or nearly so: its sender does not know it")
    yaw = math.atan2(2 * (q.w * q.z + q.x * q.y), q.w * q.w + q.x * q.x - q.y * q.y - q.z * q.z)
    return Pose2(float(position.x), float(position.y), yaw)


def odometry(message: Any, pose_odom_start: Pose2) -> Odometry:
    """Return the odometry of a message, as seen from where the sensor started."""
    return Odometry(pose_odom_start.inverse() @ planar_pose(message.pose.pose), twist=planar_twist(message.twist.twist))


def planar_twist(twist: Any) -> Twist2 | None:
    """Return what a Twist message says of the plane; None where its sender does not know it: it is not finite."""
    speeds = float(twist.linear.x), float(twist.linear.y), float(twist.angular.z)
    return Twist2(*speeds) if all(map(math.isfinite, speeds)) else None


def scan(message: Any) -> Scan:
    """Return a scan; ranges outside of what the sensor can measure are NaN.

    Raises
    ------
    ValueError
        If its angles are no directions.
    """
    ranges_m = np.array(message.ranges, dtype=np.float32)
    first_rad, step_rad = float(message.angle_min), float(message.angle_increment)
    if not (abs(first_rad) <= _MOST_RAD and abs(step_rad) * len(ranges_m) <= _MOST_RAD):  # NaN is neither
        raise ValueError(f"{len(ranges_m)} beams from {first_rad:g} rad in steps of {step_rad:g} rad are no scan")
    last_rad = float(message.angle_max)  # some leave it at 0
    is_backward = last_rad != 0.0 and (last_rad - first_rad) * step_rad < 0.0
    if is_backward and math.isfinite(last_rad):  # unless it was wrapped to +-pi: the last beam is there then
        beyond_rad = math.remainder(first_rad + step_rad * (len(ranges_m) - 1) - last_rad, math.tau)
        is_backward = abs(beyond_rad) > 2 * abs(step_rad)
    if len(ranges_m) > 1 and (step_rad == 0.0 or is_backward):
        raise ValueError(
            f"steps of {step_rad:g} rad do not lead from {first_rad:g} to {last_rad:g} rad: nobody knows which side is"
            " left"
        )
    range_min_m, range_max_m = float(message.range_min), float(message.range_max)
    ranges_m[~((ranges_m >= range_min_m) & (ranges_m <= range_max_m))] = np.nan
    return Scan(ranges_m, float(message.angle_min), float(message.angle_increment), range_min_m, range_max_m)


def imu(message: Any) -> Imu:
    """Return an inertial reading; a covariance that begins with -1 says that the number is not measured."""
    rates, force, q = message.angular_velocity, message.linear_acceleration, message.orientation
    has_force = message.linear_acceleration_covariance[0] != -1
    has_orientation = message.orientation_covariance[0] != -1 and any((q.x, q.y, q.z, q.w))
    return Imu(
        np.array([rates.x, rates.y, rates.z]),
        np.array([force.x, force.y, force.z]) if has_force else None,
        np.array([q.x, q.y, q.z, q.w]) if has_orientation else None,
    )


def info_topic(topic: str) -> str:
    """Return the topic beside an image topic on which its CameraInfo is sent."""
    return topic.removesuffix("/compressed").removesuffix("/compressedDepth").rpartition("/")[0] + "/camera_info"


def lens(info: Any, is_rectified: bool) -> Pinhole | None:
    """Return the lens of a CameraInfo message; None where it is not calibrated, of another model, or no numbers."""
    if is_rectified:
        return _pinhole(np.asarray(info.P if hasattr(info, "P") else info.p).reshape(3, 4), ())
    distortion = tuple(float(value) for value in (info.D if hasattr(info, "D") else info.d))
    if len(distortion) not in (0, 4, 5, 8) or info.distortion_model not in ("plumb_bob", "rational_polynomial", ""):
        return None
    return _pinhole(np.asarray(info.K if hasattr(info, "K") else info.k).reshape(3, 3), distortion)


def _pinhole(matrix: Floats, distortion: tuple[float, ...]) -> Pinhole | None:
    """Return the lens of a camera matrix (3, 3) or (3, 4); None where a number that is used is none."""
    fx, fy, cx, cy = (float(matrix[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
    if not (fx > 0 and fy > 0 and all(map(math.isfinite, (fx, fy, cx, cy, *distortion)))):
        return None
    return Pinhole(fx, fy, cx, cy, distortion if any(distortion) else ())
