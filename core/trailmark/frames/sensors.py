"""What a source knows of each of its sensors: kind, size, rate, calibration and mounting."""

from __future__ import annotations

import re
from dataclasses import dataclass

import trailmark.frames
from trailmark.errors import ShapeError
from trailmark.frames.payloads import PAYLOAD_KINDS, Payload
from trailmark.geometry import Pose3

__all__ = ["PAYLOAD_KINDS", "SensorInfo", "SensorOrigin", "payload_kind"]

_NAME = re.compile(r"[a-z][a-z0-9_]*")


def payload_kind(payload: Payload) -> str:
    """Return the kind of a payload; ``"record"`` for named arrays.

    Parameters
    ----------
    payload : Payload
        What a frame carries.

    Returns
    -------
    str
        The word that `SensorInfo.kind` has for it: ``image``, ``scan``, ...
    """
    return payload.kind


@dataclass(frozen=True, slots=True)
class SensorInfo:
    """What is known about a sensor before its first frame.

    Attributes
    ----------
    name : str
        Lower-case letters, digits and underscores, starting with a letter.
    kind : str
        One of `PAYLOAD_KINDS`, or a word of the source's own for a `Record`.
    size : (int, int) or None
        Width and height of the picture [px].
    rate_hz : float or None
        Nominal rate [Hz].
    pose_base_sensor : Pose3
        Mounting: ``point_base = pose_base_sensor @ point_sensor``. For a camera the sensor axes are
        x forward, y left, z up as for every sensor; the optical axes follow from them by REP-103.
    calibration : Calibration or None
        None while unknown.
    """

    name: str
    kind: str
    size: tuple[int, int] | None = None
    rate_hz: float | None = None
    pose_base_sensor: Pose3 = Pose3()
    calibration: trailmark.frames.Calibration | None = None

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise ShapeError(
                f"sensor name {self.name!r}: use lower-case letters, digits and underscores, starting with a letter"
            )


@dataclass(frozen=True, slots=True)
class SensorOrigin:
    """Where a recording says a sensor's mounting and calibration, in words; empty where it says nothing.

    Attributes
    ----------
    mounting : str
        For example ``"/tf_static, base_link <- front_optical"``; or why it could not be taken from there.
    calibration : str
        For example ``"/front/camera_info"``.
    """

    mounting: str = ""
    calibration: str = ""
