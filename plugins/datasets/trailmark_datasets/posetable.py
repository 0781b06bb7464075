"""True poses from a table beside a recording."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

from trailmark.errors import SourceError
from trailmark.geometry import Pose2, Trajectory
from trailmark_datasets.config import POSE_COLUMNS, PosesConfig
from trailmark_datasets.tables import TableRow, open_table
from trailmark_datasets.textfiles import stamp

__all__ = ["FrameStamp", "poses_from_table"]


@dataclass(frozen=True, slots=True)
class FrameStamp:
    """A frame that a row of the table may be about.

    Attributes
    ----------
    stamp_s : float
        Its stamp [s].
    name : str
        Its file name.
    """

    stamp_s: float
    name: str


def poses_from_table(config: PosesConfig, frames: list[FrameStamp]) -> Trajectory | None:
    """Read ``config.poses``: rows by stamp, by file name, or one for each frame.

    Parameters
    ----------
    config : PosesConfig
        Names the table and its units.
    frames : list of FrameStamp
        The recording's frames in order; empty where only stamps can tell.

    Raises
    ------
    SourceError
        If a column is missing, a row is malformed or its stamp goes back, or rows and frames do not match.
    """
    if config.poses is None:
        return None
    table = open_table(config.poses, POSE_COLUMNS, config.poses_header, config.poses_columns)
    missing = [name for name in ("x", "y", "theta") if name not in table.columns]
    if missing:
        raise SourceError(f"{table.path}: no column for {', '.join(missing)}; name it in poses_columns: {{theta: ...}}")
    rows = [_sound(row) for row in table.rows()]
    if "t" in table.columns:
        stamps: list[float | None] = [stamp(row.fields["t"], config.time_unit, row.where) for row in rows]
    elif "file" in table.columns and frames:
        stamps = _stamps_by_name(rows, frames, config)
    else:
        stamps = _stamps_by_order(rows, frames, config)
    told = [(stamp_s, row) for stamp_s, row in zip(stamps, rows, strict=True) if stamp_s is not None]
    if "t" not in table.columns:  # rows about files may come in any order
        told.sort(key=lambda item: item[0])
    for (before_s, _), (stamp_s, row) in pairwise(told):
        if stamp_s <= before_s:
            raise SourceError(
                f"{row.where}: the true pose at {stamp_s:.6f} s does not come after that at {before_s:.6f} s"
            )
    return Trajectory.from_poses((stamp_s, _pose(row, config)) for stamp_s, row in told)


def _sound(row: TableRow | SourceError) -> TableRow:
    if isinstance(row, SourceError):
        raise row
    return row


def _stamps_by_name(rows: list[TableRow], frames: list[FrameStamp], config: PosesConfig) -> list[float | None]:
    """Return the stamp of the frame that each row names; None where it is no frame."""
    by_name = {frame.name: frame.stamp_s for frame in frames}
    names = [row.fields["file"].replace("\\", "/").rsplit("/", 1)[-1] for row in rows]
    stamps = [by_name.get(name) for name in names]
    if all(stamp_s is None for stamp_s in stamps):
        raise SourceError(f"{config.poses}: none of the {len(rows)} rows names a frame, such as {frames[0].name!r}")
    return stamps


def _stamps_by_order(rows: list[TableRow], frames: list[FrameStamp], config: PosesConfig) -> list[float | None]:
    if not frames:
        raise SourceError(f"{config.poses}: no column t; name it in poses_columns: {{t: ...}}")
    if len(rows) != len(frames):
        raise SourceError(
            f"{config.poses} has {len(rows)} rows for {len(frames)} frames; add a column t (stamp) or file (name)"
        )
    return [frame.stamp_s for frame in frames]


def _pose(row: TableRow, config: PosesConfig) -> Pose2:
    theta = row.number("theta")
    scale = config.poses_metres_per_unit
    return Pose2(
        row.number("x") * scale,
        row.number("y") * scale,
        math.radians(theta) if config.poses_angle_unit == "deg" else theta,
    )
