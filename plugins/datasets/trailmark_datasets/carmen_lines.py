"""The lines of CARMEN logs.

Understood: ``ODOM``, ``FLASER``, ``ROBOTLASER1``, ``TRUEPOS`` and ``PARAM``; others are passed over.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trailmark.errors import SourceError
from trailmark.frames import Scan
from trailmark.geometry import Pose2
from trailmark_datasets.textfiles import is_number, number

__all__ = ["CarmenLine", "OdomLine", "ScanLine", "TruePoseLine", "parse_line"]

#: Angle between the beams of a FLASER line, which does not tell it, by their number [deg].
STEPS_DEG = {180: 1.0, 181: 1.0, 360: 0.5, 361: 0.5, 401: 0.25, 541: 0.5, 1081: 0.25}


@dataclass(frozen=True, slots=True)
class OdomLine:
    """``ODOM x y theta tv rv accel ipc_timestamp host logger_timestamp``.

    Attributes
    ----------
    where : str
        File and line, for messages.
    stamp_s : float
        Time of the computer that took the reading [s].
    pose : Pose2
        Of base, by the wheels.
    """

    where: str
    stamp_s: float
    pose: Pose2


@dataclass(frozen=True, slots=True)
class ScanLine:
    """A laser line; the ranges are parsed when the frame is read.

    ``FLASER n r1 .. rn x y theta odom_x odom_y odom_theta ipc_timestamp host logger_timestamp``;
    ``ROBOTLASER1 type start fov step max accuracy remission_mode n r1 .. rn m e1 .. em laser_pose robot_pose
    tv rv forward_safety side_safety turn_axis ipc_timestamp host logger_timestamp``.

    Attributes
    ----------
    where : str
        File and line, for messages.
    stamp_s : float
        Time of the computer that took the reading [s].
    laser_pose, robot_pose : Pose2
        Of the laser and of base, as the line has them.
    ranges : tuple of str
        Ranges as they are written [m].
    angle_min_rad, angle_step_rad : float
        Direction of the first beam and angle between two [rad].
    range_max_m : float
        Ranges from here on mean that nothing came back [m].
    """

    where: str
    stamp_s: float
    laser_pose: Pose2
    robot_pose: Pose2
    ranges: tuple[str, ...]
    angle_min_rad: float
    angle_step_rad: float
    range_max_m: float

    def scan(self) -> Scan:
        """Return the scan; ranges of zero or at least `range_max_m` are NaN: nothing came back."""
        try:
            ranges_m: npt.NDArray[np.float64] = np.array(self.ranges, dtype=np.float64)
        except ValueError:
            bad = next(text for text in self.ranges if not is_number(text))
            raise SourceError(f"{self.where}: a range is {bad[:40]!r}, not a number") from None
        ranges_m[~((ranges_m > 0) & (ranges_m < self.range_max_m))] = np.nan
        return Scan(ranges_m, self.angle_min_rad, self.angle_step_rad, range_max_m=self.range_max_m)


@dataclass(frozen=True, slots=True)
class TruePoseLine:
    """``TRUEPOS true_x true_y true_theta odom_x odom_y odom_theta ipc_timestamp host logger_timestamp``.

    Attributes
    ----------
    where : str
        File and line, for messages.
    stamp_s : float
        Time of the computer that took the reading [s].
    pose : Pose2
        True pose of base.
    """

    where: str
    stamp_s: float
    pose: Pose2


CarmenLine = OdomLine | ScanLine | TruePoseLine


def parse_line(text: str, where: str, range_max_m: float, angle_step_deg: float | None) -> CarmenLine | None:
    """Parse one line; None for lines of other kinds.

    Parameters
    ----------
    text, where : str
        The line, and its file and number for messages.
    range_max_m : float
        Ranges from here on mean that nothing came back [m].
    angle_step_deg : float or None
        Angle between beams of FLASER lines; None: by their number [deg].

    Raises
    ------
    SourceError
        If a line of a known kind is malformed.
    """
    fields = text.split()
    kind = fields[0]
    if kind == "ODOM":
        _check_length(fields, 10, where)
        return OdomLine(where, _stamp(fields, where), _pose(fields[1:4], where))
    if kind == "TRUEPOS":
        _check_length(fields, 10, where)
        return TruePoseLine(where, _stamp(fields, where), _pose(fields[1:4], where))
    if kind == "FLASER":
        return _parse_flaser(fields, where, range_max_m, angle_step_deg)
    if kind == "ROBOTLASER1":
        return _parse_robotlaser(fields, where, range_max_m)
    return None


def _parse_flaser(fields: list[str], where: str, range_max_m: float, angle_step_deg: float | None) -> ScanLine:
    count = _count(fields, 1, where)
    _check_length(fields, count + 11, where)
    step_deg = angle_step_deg or STEPS_DEG.get(count)
    if step_deg is None:
        raise SourceError(f"{where}: FLASER does not tell the angle between its {count} beams; set angle_step_deg")
    step_rad = math.radians(step_deg)
    poses = fields[2 + count :]
    return ScanLine(
        where,
        _stamp(fields, where),
        _pose(poses[:3], where),
        _pose(poses[3:6], where),
        tuple(fields[2 : 2 + count]),
        -(count // 2) * step_rad,  # 180 beams look from -90 to 89 deg, 181 from -90 to 90
        step_rad,
        range_max_m,
    )


def _parse_robotlaser(fields: list[str], where: str, range_max_m: float) -> ScanLine:
    count = _count(fields, 8, where)
    remissions = _count(fields, 9 + count, where)
    poses = fields[10 + count + remissions :]
    _check_length(fields, 10 + count + remissions + 14, where)
    start_rad, step_rad, told_max_m = (number(fields[i], "a laser parameter", where) for i in (2, 4, 5))
    return ScanLine(
        where,
        _stamp(fields, where),
        _pose(poses[:3], where),
        _pose(poses[3:6], where),
        tuple(fields[9 : 9 + count]),
        start_rad,
        step_rad,
        min(range_max_m, told_max_m) if told_max_m > 0 else range_max_m,
    )


def _count(fields: list[str], index: int, where: str) -> int:
    if len(fields) <= index or not fields[index].isdecimal():
        raise SourceError(f"{where}: {fields[0]} does not say how many readings follow")
    return int(fields[index])


def _check_length(fields: list[str], expected: int, where: str) -> None:
    if len(fields) != expected:
        raise SourceError(f"{where}: {fields[0]} has {len(fields)} fields, expected {expected}: cut off or damaged")


def _stamp(fields: list[str], where: str) -> float:
    return number(fields[-3], "the stamp", where)


def _pose(fields: list[str], where: str) -> Pose2:
    x, y, theta = (number(field, "a pose", where) for field in fields)
    return Pose2(x, y, theta)
