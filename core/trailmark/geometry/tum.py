"""Trajectory files of the TUM format: ``t x y z qx qy qz qw`` on each line, ``#`` starts a comment."""

from __future__ import annotations

import logging
import math
from pathlib import Path

import numpy as np

from trailmark.errors import DataError
from trailmark.geometry.trajectory import FARTHEST_M, Trajectory

__all__ = ["read_tum", "tum_text", "write_tum"]

logger = logging.getLogger(__name__)

_COLUMNS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
_LATEST_S = 1e20  # nanoseconds for seconds are 1e18
_MAX_LINE = 2_000  # a longer line is not a trajectory, and need not be echoed


def read_tum(path: str | Path) -> Trajectory:
    """Read a trajectory; poses in space are projected to the plane (x, y, yaw).

    Of several poses at one stamp, as other programs write them, the first is kept, and a warning says how many there
    were.

    Parameters
    ----------
    path : str or Path
        Text file; a line holds stamp, position and quaternion: ``t x y z qx qy qz qw`` [s, m].

    Returns
    -------
    Trajectory
        Poses in the order of their stamps.

    Raises
    ------
    DataError
        If the file cannot be read or a line is malformed; the message names file and line.
    """
    rows: list[tuple[float, float, float, float]] = []
    n_repeated = 0
    if Path(path).exists() and not (Path(path).is_file() or Path(path).is_dir()):  # read, or waited for, for ever
        raise DataError(f"cannot read trajectory {path}: it is a device or a pipe; write its text into a file")
    try:
        with open(path, encoding="utf-8", errors="strict") as file:
            for number, line in enumerate(file, start=1):
                text = line.strip()
                if not text or text.startswith("#"):
                    continue
                row = _parse_line(text, rows[-1][0] if rows else -math.inf, f"{path}:{number}")
                if rows and row[0] == rows[-1][0]:
                    n_repeated += 1
                else:
                    rows.append(row)
    except OSError as error:
        raise DataError(f"cannot read trajectory {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise DataError(f"{path} is not a text file, so not a TUM trajectory") from error
    if n_repeated:
        what = "1 pose repeats the stamp before it" if n_repeated == 1 else f"{n_repeated} poses repeat a stamp"
        logger.warning("%s: %s; the first one of each is kept", path, what)
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    return Trajectory(table[:, 0], table[:, 1:])


def write_tum(path: str | Path, trajectory: Trajectory) -> None:
    """Write a trajectory with z = 0; stamps with 9 decimals, quaternions as x y z w.

    Parameters
    ----------
    path : str or Path
        The file; one that is there is replaced as a whole.
    trajectory : Trajectory
        Poses to write.
    """
    Path(path).write_text(tum_text(trajectory), encoding="utf-8")


def tum_text(trajectory: Trajectory) -> str:
    """Return a trajectory as `write_tum` writes it.

    Of stamps that are one when written (0.3 and 0.30000000000000004 s, of two sensors) the last pose is kept, as
    readers of the format take equal stamps for a fault.
    """
    lines = {
        f"{stamp_s:.9f}": f" {x:.9f} {y:.9f} 0 0 0 {math.sin(theta / 2):.12f} {math.cos(theta / 2):.12f}\n"
        for stamp_s, (x, y, theta) in zip(trajectory.stamps_s, trajectory.poses, strict=True)
    }
    return "".join(stamp + pose for stamp, pose in lines.items())


def _parse_line(text: str, previous_s: float, where: str) -> tuple[float, float, float, float]:
    fields = text[:_MAX_LINE].replace(",", " ").split()
    if len(fields) != len(_COLUMNS):
        raise DataError(f"{where}: expected 8 numbers (t x y z qx qy qz qw), found {len(fields)}")
    try:
        t, x, y, _, qx, qy, qz, qw = values = [float(field) for field in fields]
    except ValueError:
        bad = next(field for field in fields if not _is_number(field))
        raise DataError(f"{where}: {bad[:40]!r} is not a number") from None
    if not all(math.isfinite(value) for value in values):
        raise DataError(f"{where}: a number is not finite")
    if max(abs(x), abs(y)) > FARTHEST_M or abs(t) > _LATEST_S:
        raise DataError(f"{where}: {t:g} s at ({x:g}, {y:g}) m is beyond all that can be computed with")
    norm = math.hypot(qx, qy, qz, qw)
    if not 0.9 < norm < 1.1:
        raise DataError(f"{where}: the quaternion has norm {norm:.3g}; qx qy qz qw must be a unit quaternion")
    if t < previous_s:
        raise DataError(f"{where}: stamps must increase, but {t:.9f} follows {previous_s:.9f}")
    return t, x, y, math.atan2(2 * (qw * qz + qx * qy), qw * qw + qx * qx - qy * qy - qz * qz)


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True
