"""Sequences of the KITTI odometry benchmark (Geiger et al. 2012)."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from trailmark.errors import ShapeError, SourceError
from trailmark.frames import Pinhole, SensorInfo
from trailmark.geometry import Trajectory
from trailmark_datasets.config import KittiOdometryConfig
from trailmark_datasets.picture_source import Entry, PictureSource, list_pictures
from trailmark_datasets.planar import mounting_pose, planar_trajectory
from trailmark_datasets.pose_matrices import matrix_of, pose_of
from trailmark_datasets.stamps import Stamp, read_stamps
from trailmark_datasets.textfiles import lines_of

__all__ = ["KittiOdometry"]

logger = logging.getLogger(__name__)


class KittiOdometry(PictureSource):
    """One camera of a sequence. The number in a picture's name is its line in ``times.txt`` and in the poses.

    A folder that starts late or ends early is a part of the sequence; a number left out inside is a missing
    picture. The true poses are projected to the plane of the first: x forward (z of the camera), y left (-x).
    """

    config: KittiOdometryConfig
    _first = 0

    def open_recording(self, name: str) -> Iterable[SensorInfo]:
        self.grey = self.config.grey
        (info,) = super().open_recording(name)
        return (replace(info, calibration=_read_calibration(self.config.path / "calib.txt", self.config.camera)),)

    def _list(self) -> Iterator[Entry]:
        folder = self.config.path / self.config.camera
        paths = list_pictures(folder if folder.is_dir() else self.config.path)
        by_number = {_number_of(path): path for path in paths}
        self._first, last = min(by_number), max(by_number)
        if last - self._first + 1 > 2 * len(by_number):
            raise SourceError(
                f"{paths[0].parent}: {len(by_number)} pictures between number {self._first} and {last}: the numbers are"
                " no indices; use the source 'image_folder'"
            )
        stamps = self._stamps(last)
        for index in range(self._first, last + 1):
            path = by_number.get(index, paths[0].with_name(f"{index:0{len(paths[0].stem)}d}{paths[0].suffix}"))
            if stamps is None:
                yield Entry((index - self._first) / self.config.rate_hz, path, str(path))
            else:
                yield Entry(stamps[index].stamp_s, path, f"{stamps[index].where} ({path})")

    def _stamps(self, last: int) -> list[Stamp] | None:
        """Read ``times.txt``; None where there is none."""
        path = self.config.path / "times.txt"
        if not path.exists():
            _say_missing_ends(f"{path.parent} has no times.txt", last + 1, self._first, last)
            return None
        stamps = read_stamps(path)
        if last >= len(stamps):
            raise SourceError(f"{path} has {len(stamps)} stamps, but there is a picture number {last}")
        _say_missing_ends(f"{path} has {len(stamps)} stamps", len(stamps), self._first, last)
        return stamps

    def ground_truth(self) -> Trajectory | None:
        """Return the true pose of base at every picture; None where there are no poses."""
        path = self.config.poses or _poses_beside(self.config.path)
        if path is None or not self._entries:
            return None
        poses = _read_poses(path)
        last = self._first + len(self._entries)
        if len(poses) < last:
            raise SourceError(f"{path} has {len(poses)} poses, but there is a picture number {last - 1}")
        if len(poses) > last and not (self.config.path / "times.txt").exists():  # else the stamps have said it
            _say_missing_ends(f"{path} has {len(poses)} poses", len(poses), self._first, last - 1)
        stamps_s = np.array([entry.stamp_s for entry in self._entries])
        kept = np.concatenate([[True], stamps_s[1:] > np.maximum.accumulate(stamps_s)[:-1]])  # as `frames` keeps them
        begin_s = float(stamps_s[0]) + (self.config.start_s or 0.0)
        return planar_trajectory(
            stamps_s[kept], poses[self._first : last][kept], mounting_pose(self.config.mounting), begin_s
        )


def _say_missing_ends(what: str, n_expected: int, first: int, last: int) -> None:
    """Warn of pictures that are missing before the first and behind the last."""
    n_behind = n_expected - last - 1
    if first or n_behind:
        logger.warning(
            "%s, and the pictures are numbers %d to %d: %d at the beginning and %d at the end are missing,"
            " or this is a part of the sequence",
            what,
            first,
            last,
            first,
            n_behind,
        )


def _number_of(path: Path) -> int:
    if not path.stem.isdecimal():
        raise SourceError(
            f"{path}: pictures of KITTI are named by number (000000.png); for other names use the source 'image_folder'"
        )
    return int(path.stem)


def _poses_beside(sequence: Path) -> Path | None:
    """Find ``dataset/poses/00.txt`` of ``dataset/sequences/00``, or ``poses.txt`` in the sequence."""
    candidates = (sequence.parent.parent / "poses" / f"{sequence.name}.txt", sequence / "poses.txt")
    return next((path for path in candidates if path.is_file()), None)


def _read_poses(path: Path) -> npt.NDArray[np.float64]:
    """Read rows of a (3, 4) matrix; (N, 4, 4)."""
    matrices = [pose_of(matrix_of(text.split(), f"{path}:{line}"), f"{path}:{line}") for line, text in lines_of(path)]
    poses = np.tile(np.eye(4), (len(matrices), 1, 1))
    if matrices:
        poses[:, :3] = matrices
    return poses


def _read_calibration(path: Path, camera: str) -> Pinhole | None:
    """Read the projection ``P0: ...`` of a rectified camera; None where there is no file."""
    if not path.exists():
        return None
    wanted = f"P{camera[-1]}"
    for line, text in lines_of(path):
        fields = re.split(r"[:\s]+", text)
        if fields[0] == wanted:
            matrix = matrix_of(fields[1:], f"{path}:{line}")
            try:
                return Pinhole(float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 2]), float(matrix[1, 2]))
            except ShapeError as error:
                raise SourceError(f"{path}:{line}: {error}") from error
    raise SourceError(f"{path}: no line {wanted}: for {camera}")
