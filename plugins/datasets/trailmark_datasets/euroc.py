"""Sequences in the ASL layout: EuRoC MAV (Burri et al. 2016), TUM VI and others.

Every sensor has a folder with ``data.csv`` and ``sensor.yaml``; ``T_BS`` there takes points of the sensor into the
body, whose axes are those of the inertial unit.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from trailmark.errors import ShapeError, SourceError
from trailmark.frames import Imu, Pinhole, SensorInfo
from trailmark.geometry import Pose3, Trajectory
from trailmark.sources import Reading, Readings
from trailmark.sources.frame_tree import R_SENSOR_OPTICAL
from trailmark_datasets.config import EurocConfig
from trailmark_datasets.picture_source import Entry, PictureSource
from trailmark_datasets.planar import covered_stamps, interpolated_poses, mounting_pose, planar_trajectory
from trailmark_datasets.textfiles import lines_of, number, stamp

__all__ = ["Euroc"]

logger = logging.getLogger(__name__)

_TRUTHS = ("state_groundtruth_estimate0", "mocap0", "leica0")
_NOT_A_ROTATION = 1e-2
#: Columns of ``imu0/data.csv``, and so many of its lines tell the rate.
_N_IMU, _N_OF_RATE = 7, 100
_LENSES = ("radial-tangential", "radtan", "plumb_bob")


@dataclass(frozen=True, slots=True)
class _Line:
    """A line of a ``data.csv``."""

    stamp_s: float
    fields: list[str]
    where: str


class Euroc(PictureSource):
    """A camera and, beside it, the inertial unit. The stamps of the files are kept.

    The true poses are those of the body (``state_groundtruth_estimate0``, or ``mocap0`` of TUM VI), interpolated to
    the pictures and projected to the plane of the first that is delivered: x along the camera's optical axis, y to
    its left. The position of a prism alone (``leica0``) has no heading and is no pose.
    """

    config: EurocConfig
    _imu_table: Path | None = None
    _imu_name = ""
    _T_body_camera: npt.NDArray[np.float64] = np.eye(4)

    @property
    def _folder(self) -> Path:
        inside = self.config.path / "mav0"
        return inside if inside.is_dir() else self.config.path

    def open_recording(self, name: str) -> Iterable[SensorInfo]:
        about = _read_about(self._folder / self.config.camera / "sensor.yaml")
        self._T_body_camera = _body_pose(about, self._folder / self.config.camera / "sensor.yaml")
        (camera,) = super().open_recording(name or self.config.camera)
        yield replace(camera, calibration=_lens(about, self._folder / self.config.camera / "sensor.yaml"))
        table = self._folder / "imu0" / "data.csv"
        self._imu_table = table if self.config.imu and table.is_file() else None
        if self._imu_table is not None:
            self._imu_name = "imu0" if camera.name != "imu0" else "imu"
            T_body_imu = _body_pose(_read_about(table.with_name("sensor.yaml")), table.with_name("sensor.yaml"))
            T_base_imu = np.linalg.inv(self._T_body_base()) @ T_body_imu
            first = tuple(islice(_rows(table, _N_IMU), _N_OF_RATE))
            yield SensorInfo(self._imu_name, "imu", rate_hz=_rate(first), pose_base_sensor=_pose(T_base_imu))

    def _list(self) -> Iterator[Entry]:
        folder = self._folder / self.config.camera
        for row in _rows(folder / "data.csv", 2):
            path = folder / "data" / row.fields[1].strip()
            yield Entry(row.stamp_s, path, f"{row.where} ({path})")

    def readings(self) -> Readings:
        pictures = (Reading(self._name, e.stamp_s, e.where, partial(self._load, e)) for e in self._entries)
        rows = () if self._imu_table is None else _rows(self._imu_table, _N_IMU)
        inertial = (Reading(self._imu_name, row.stamp_s, row.where, partial(_imu, row)) for row in rows)
        yield from _by_stamp(pictures, inertial)

    def _T_body_base(self) -> npt.NDArray[np.float64]:
        """Return the pose of base in the body: base stands where the camera's mounting says, or is the camera."""
        T_base_camera = mounting_pose(self.config.mounting).matrix()
        T_base_camera[:3, :3] = T_base_camera[:3, :3] @ R_SENSOR_OPTICAL
        return np.asarray(self._T_body_camera @ np.linalg.inv(T_base_camera))

    def ground_truth(self) -> Trajectory | None:
        """Return the true pose of base at every picture that the true poses cover; None without any."""
        path = next((self._folder / name / "data.csv" for name in _TRUTHS if (self._folder / name).is_dir()), None)
        if path is None or not self._entries:
            return None
        if path.parent.name == "leica0":
            logger.warning("%s has positions of a prism without a heading: they are no poses, and not used", path)
            return None
        truth_s, poses = _read_truth(path)
        wanted_s = np.unique([entry.stamp_s for entry in self._entries])
        covered_s = wanted_s[covered_stamps(wanted_s, truth_s, self.config.max_truth_gap_s)]
        if 2 * len(covered_s) < len(wanted_s):
            logger.warning("%s covers %d of %d pictures", path, len(covered_s), len(wanted_s))
        begin_s = self._entries[0].stamp_s + (self.config.start_s or 0.0)
        T_world_camera = interpolated_poses(covered_s, truth_s, poses) @ self._T_body_camera
        return planar_trajectory(covered_s, T_world_camera, mounting_pose(self.config.mounting), begin_s)


def _by_stamp(first: Iterator[Reading], second: Iterator[Reading]) -> Readings:
    """Yield two series by stamp; each keeps its order, also where its stamps go back."""
    left, right = next(first, None), next(second, None)
    while left is not None or right is not None:
        if right is None or (left is not None and left.stamp_s <= right.stamp_s):
            assert left is not None
            yield left
            left = next(first, None)
        else:
            yield right
            right = next(second, None)


def _rows(path: Path, n_fields: int) -> Iterator[_Line]:
    """Yield the lines of a table whose first column is nanoseconds."""
    if not path.is_file():
        raise SourceError(
            f"{path} is missing: a sequence has mav0/cam0/data.csv and, beside it, a table of each sensor"
        )
    n_rows = 0
    for line, text in lines_of(path):
        where = f"{path}:{line}"
        fields = text.split(",")
        if len(fields) < n_fields:
            raise SourceError(f"{where}: expected {n_fields} columns, found {len(fields)}")
        n_rows += 1
        yield _Line(stamp(fields[0], "ns", where), fields, where)
    if not n_rows:
        raise SourceError(f"{path} is empty")


def _imu(row: _Line) -> Imu:
    values = [number(field, "an inertial reading", row.where) for field in row.fields[1:7]]
    return Imu(np.array(values[:3]), np.array(values[3:]))


def _rate(rows: tuple[_Line, ...]) -> float | None:
    gaps = np.diff([row.stamp_s for row in rows])
    middle = float(np.median(gaps)) if len(gaps) else 0.0
    return 1.0 / middle if middle > 0.0 else None


def _read_truth(path: Path) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Read ``t x y z qw qx qy qz`` and more: stamps (N,) and rows x y z qx qy qz qw (N, 7)."""
    rows: list[list[float]] = []
    for row in _rows(path, 8):
        x, y, z, qw, qx, qy, qz = (number(field, "a number of the pose", row.where) for field in row.fields[1:8])
        if rows and row.stamp_s <= rows[-1][0]:
            raise SourceError(f"{row.where}: the stamp of a true pose goes back")
        if not 0.9 < float(np.linalg.norm([qw, qx, qy, qz])) < 1.1:
            raise SourceError(f"{row.where}: qw qx qy qz is no unit quaternion")
        rows.append([row.stamp_s, x, y, z, qx, qy, qz, qw])
    table = np.array(rows, dtype=np.float64).reshape(-1, 8)
    return table[:, 0], table[:, 1:]


def _read_about(path: Path) -> Mapping[str, Any]:
    """Read a ``sensor.yaml``; nothing where there is none."""
    from trailmark.config.document import TextError
    from trailmark.config.yaml_text import read_yaml

    if not path.is_file():
        logger.warning("%s is missing: mounting and lens of the sensor are not known", path)
        return {}
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    text = "\n".join("" if line.startswith("%") else line for line in lines)  # OpenCV's %YAML:1.0 is no directive
    try:
        about, _ = read_yaml(text)
    except TextError as error:
        raise SourceError(f"{path}: {error}") from error
    if not isinstance(about, Mapping):
        raise SourceError(f"{path}: expected keys such as T_BS and intrinsics")
    return about


def _numbers(about: Mapping[str, Any], key: str, path: Path) -> list[float] | None:
    values = about.get(key)
    values = values.get("data") if isinstance(values, Mapping) else values
    if values is None:
        return None
    try:
        return [float(value) for value in values]
    except (TypeError, ValueError) as error:
        raise SourceError(f"{path}: {key} is no list of numbers") from error


def _body_pose(about: Mapping[str, Any], path: Path) -> npt.NDArray[np.float64]:
    """Return ``T_BS`` (4, 4); the identity where the file has none."""
    values = _numbers(about, "T_BS", path)
    if values is None:
        return np.eye(4)
    if len(values) != 16:
        raise SourceError(f"{path}: T_BS has {len(values)} numbers, not 16")
    matrix = np.array(values).reshape(4, 4)
    rotation = matrix[:3, :3]
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > _NOT_A_ROTATION or np.linalg.det(rotation) < 0.0:
        raise SourceError(f"{path}: T_BS turns and stretches: it is no pose")
    return matrix


def _lens(about: Mapping[str, Any], path: Path) -> Pinhole | None:
    """Return the lens of a pinhole camera with radial and tangential distortion; None for others, which is said."""
    intrinsics = _numbers(about, "intrinsics", path)
    if intrinsics is None:
        return None
    model = str(about.get("distortion_model", _LENSES[0]))
    if about.get("camera_model", "pinhole") != "pinhole" or model not in _LENSES:
        logger.warning("%s: lens %s, %s is not understood; name a calibration", path, about.get("camera_model"), model)
        return None
    if len(intrinsics) != 4:
        raise SourceError(f"{path}: intrinsics are fu, fv, cu, cv, not {len(intrinsics)} numbers")
    fx, fy, cx, cy = intrinsics
    try:
        return Pinhole(fx, fy, cx, cy, tuple(_numbers(about, "distortion_coefficients", path) or ()))
    except ShapeError as error:
        raise SourceError(f"{path}: intrinsics and distortion_coefficients: {error}") from error


def _pose(matrix: npt.NDArray[np.float64]) -> Pose3:
    return Pose3.from_matrix(matrix)
