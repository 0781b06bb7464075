"""From a line of JSON to a frame."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import SourceError
from trailmark.frames import Frame, Image, Imu, Odometry, Payload, Record, Scalar, Scan
from trailmark.geometry import Pose2, Twist2
from trailmark.sources.pictures import as_payload_pixels, decode_raw, read_picture

__all__ = ["LineReader", "document_of"]

_LATEST_S = 1e11  # the year 5138


def document_of(line: bytes) -> dict[str, Any]:
    """Return the JSON object of a line.

    Raises
    ------
    SourceError
        If it is none.
    """
    try:
        found = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise SourceError(f"a line is no JSON: {error}") from error
    if not isinstance(found, dict):
        raise SourceError(f"a line is a JSON {type(found).__name__}, not an object")
    return found


class LineReader:
    """Makes frames.

    Parameters
    ----------
    kinds : mapping of str to str
        The sensors.
    pictures : Path or None
        Folder of pictures that are named as files.
    """

    def __init__(self, kinds: Mapping[str, str], pictures: Path | None) -> None:
        self._kinds, self._pictures = kinds, None if pictures is None else pictures.resolve()
        self._payloads: Mapping[str, Callable[[Mapping[str, Any]], Payload]] = {
            "image": self._image,
            "scan": _scan,
            "odometry": _odometry,
            "imu": _imu,
            "scalar": _scalar,
            "pose": _pose,
        }

    def frame(self, document: Mapping[str, Any], came_s: float) -> Frame:
        """Return the frame of a line; without ``stamp_s`` it is stamped with its arrival.

        Raises
        ------
        SourceError
            If the sensor is not known or the numbers do not fit.
        """
        sensor = document.get("sensor")
        if not isinstance(sensor, str) or sensor not in self._kinds:
            raise SourceError(f"a line of sensor {sensor!r}; the config names {', '.join(self._kinds)}")
        try:
            payload = self._payloads[self._kinds[sensor]](document)
            stamp_s = float(document.get("stamp_s", came_s))
            if _LATEST_S < abs(stamp_s) < math.inf:  # a frame itself refuses what is not finite
                raise ValueError(f"stamp_s is {stamp_s:g}, which are no seconds; milliseconds or nanoseconds?")
            return Frame(sensor, stamp_s, payload)
        except KeyError as error:
            raise SourceError(f"a line of {sensor!r} lacks {error}; it is of kind {self._kinds[sensor]}") from error
        except (TypeError, ValueError, OverflowError) as error:
            raise SourceError(f"a line of {sensor!r} cannot be used: {error}") from error

    def _image(self, document: Mapping[str, Any]) -> Image:
        if "jpeg" in document or "png" in document:
            data = base64.b64decode(document.get("jpeg") or document["png"], validate=True)
            return Image(as_payload_pixels(decode_raw(data, "picture in a line"), "picture in a line", None))
        if self._pictures is None:
            raise SourceError("a line names a file, and the config names no folder of them (pictures)")
        path = (self._pictures / str(document["path"])).resolve()
        if not path.is_relative_to(self._pictures):
            raise SourceError(f"{document['path']!r} lies outside of {self._pictures}")
        return Image(read_picture(path, str(document["path"])))


def _numbers(values: Any, length: int | None = None) -> Floats:
    array = np.array([math.nan if value is None else value for value in values], dtype=np.float64)
    if array.ndim != 1 or length not in (None, len(array)):
        raise ValueError(f"{len(array)} numbers where there should be {length}")
    return array


def _scan(document: Mapping[str, Any]) -> Scan:
    ranges_m = _numbers(document["ranges_m"]).astype(np.float32)
    limits = (float(document.get("range_min_m", 0.0)), float(document.get("range_max_m", math.inf)))
    return Scan(ranges_m, float(document["angle_min_rad"]), float(document["angle_step_rad"]), *limits)


def _odometry(document: Mapping[str, Any]) -> Odometry:
    twist = document.get("twist")
    pose = document.get("pose_start_base")
    distance_m = document.get("distance_m")
    return Odometry(
        None if pose is None else Pose2(*(float(value) for value in _numbers(pose, 3))),
        None if distance_m is None else float(distance_m),
        None if twist is None else Twist2(*(float(value) for value in _numbers(twist, 3))),
    )


def _imu(document: Mapping[str, Any]) -> Imu:
    force, quaternion = document.get("linear_acceleration_mps2"), document.get("quat_xyzw")
    return Imu(
        _numbers(document["angular_velocity_radps"], 3),
        None if force is None else _numbers(force, 3),
        None if quaternion is None else _numbers(quaternion, 4),
    )


def _scalar(document: Mapping[str, Any]) -> Scalar:
    return Scalar(float(document["value"]))


def _pose(document: Mapping[str, Any]) -> Record:
    covariance = document.get("covariance")
    spread = np.full((3, 3), np.nan) if covariance is None else np.array(covariance, dtype=np.float64).reshape(3, 3)
    return Record({"pose": _numbers(document["pose"], 3), "covariance": spread})
