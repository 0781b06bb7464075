"""Numbered files of colour, depth and poses: 7-Scenes (Shotton et al. 2013), exports of ScanNet and others."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import ShapeError, SourceError
from trailmark.frames import RGBD, DepthCamera, Pinhole, SensorInfo
from trailmark.geometry import Trajectory
from trailmark.sources import Reading, Readings, RecordedSource
from trailmark.sources.pictures import PICTURE_SUFFIXES, read_picture, read_raw
from trailmark_datasets.config import RgbdFolderConfig
from trailmark_datasets.depth import depth_in_metres
from trailmark_datasets.planar import mounting_pose, planar_trajectory
from trailmark_datasets.pose_matrices import matrix_of, pose_of
from trailmark_datasets.textfiles import lines_of, number

__all__ = ["RgbdFolder"]

logger = logging.getLogger(__name__)

#: Where colour, depth and poses are looked for, in this order.
_COLOUR, _DEPTH, _POSES = (
    ("*.color.*", "color/*", "rgb/*"),
    ("*.depth.*", "depth/*"),
    ("*.pose.txt", "pose/*.txt", "poses/*.txt"),
)
_LENSES = ("camera.txt", "camera-intrinsics.txt", "intrinsics.txt", "intrinsic/intrinsic_color.txt")
_LAST_NUMBER = re.compile(r"(\d+)\D*$")
# What a depth camera says of what it did not measure, besides 0.
_UNKNOWN = 65535


@dataclass(frozen=True, slots=True)
class _Files:
    """What there is of one number."""

    stamp_s: float
    colour: Path
    depth: Path
    pose: Path | None


class RgbdFolder(RecordedSource):
    """Colour and depth of one number are a frame; stamps count from the first number, at a rate.

    The true poses are those of the camera, projected to the plane of the first that is delivered: x along its optical
    axis, y to its left. Where the camera was lost there is none.
    """

    config: RgbdFolderConfig
    loads_ahead = True
    _name = ""
    _files: tuple[_Files, ...] = ()

    def open_recording(self, name: str) -> Iterable[SensorInfo]:
        """List the files, and look at the first picture and the lens."""
        self._name = name or "rgbd"
        self._files = self._list()
        first = self._first()
        self.expect_form(self._name, first)
        height, width = first.bgr.shape[:2]
        lens = _read_lens(self.config.path)
        depth = None if lens is None else _lens_of_size(lens, first.bgr.shape[:2], first.depth_m.shape)
        calibration = None if lens is None else DepthCamera(lens, depth)
        return (SensorInfo(self._name, "rgbd", (width, height), self.config.rate_hz, calibration=calibration),)

    def _list(self) -> tuple[_Files, ...]:
        folder, config = self.config.path, self.config
        colour = _numbered(folder, (config.colour,) if config.colour else _COLOUR, "colour", PICTURE_SUFFIXES)
        depth = _numbered(folder, (config.depth,) if config.depth else _DEPTH, "depth", PICTURE_SUFFIXES)
        poses = _numbered(folder, (config.poses,) if config.poses else _POSES, "", None)
        both = sorted(colour.keys() & depth.keys())
        if not both:
            raise SourceError(
                f"{folder}: no colour picture has the number of a depth picture: {next(iter(colour.values())).name} and"
                f" {next(iter(depth.values())).name} are the first; set the patterns colour and depth"
            )
        self.counted["unpaired_colour"] = len(colour) - len(both)
        self.counted["unpaired_depth"] = len(depth) - len(both)
        rate_hz = config.rate_hz
        return tuple(_Files((n - both[0]) / rate_hz, colour[n], depth[n], poses.get(n)) for n in both)

    def _first(self) -> RGBD:
        errors: list[SourceError] = []
        for files in self._files:
            try:
                return self._load(files)
            except SourceError as error:
                errors.append(error)
                if self.config.on_bad_frame == "error":
                    break
        raise errors[0]

    def lasts_s(self) -> float | None:
        """Return the time from the first picture to the last."""
        return self._files[-1].stamp_s if self._files else None

    def readings(self) -> Readings:
        """Yield the frames in the order of their numbers."""
        for files in self._files:
            yield Reading(self._name, files.stamp_s, str(files.colour), partial(self._load, files))

    def _load(self, files: _Files) -> RGBD:
        bgr = read_picture(files.colour, str(files.colour), grey=False)
        raw = read_raw(files.depth, str(files.depth))
        if raw.dtype == np.uint16:
            raw = np.where(raw == _UNKNOWN, np.uint16(0), raw)
        return RGBD(bgr, depth_in_metres(raw, self.config.depth_factor, str(files.depth)))

    def ground_truth(self) -> Trajectory | None:
        """Return the true pose of base at every frame whose file of a pose has one; None without any."""
        told = [(files.stamp_s, None if files.pose is None else _read_pose(files.pose)) for files in self._files]
        known = [(stamp_s, pose) for stamp_s, pose in told if pose is not None]
        if not known:
            return None
        if len(known) < len(told):
            logger.warning("%s: %d of %d frames have no true pose", self.config.path, len(told) - len(known), len(told))
        stamps_s = np.array([stamp_s for stamp_s, _ in known])
        poses = np.array([pose for _, pose in known])
        return planar_trajectory(stamps_s, poses, mounting_pose(self.config.mounting), self.config.start_s or 0.0)


def _numbered(folder: Path, patterns: Sequence[str], what: str, suffixes: Iterable[str] | None) -> dict[int, Path]:
    """Return the files of the first pattern that matches any, by their number, in its order."""
    for pattern in patterns:
        try:
            found = [path for path in folder.glob(pattern) if path.is_file()]
        except (ValueError, NotImplementedError, OSError) as error:
            raise SourceError(f"{folder}: cannot list pattern {pattern!r}: {error}") from error
        found = [path for path in found if suffixes is None or path.suffix.lower() in suffixes]
        if found:
            return _by_number(found)
    if what:
        raise SourceError(f"{folder}: no {what} picture: nothing matches {', '.join(patterns)}; set the pattern {what}")
    return {}


def _by_number(paths: Iterable[Path]) -> dict[int, Path]:
    numbered: dict[int, Path] = {}
    for path in sorted(paths):
        match = _LAST_NUMBER.search(path.name.partition(".")[0])
        if match is None:
            raise SourceError(f"{path}: its name has no number before the first dot")
        other = numbered.setdefault(int(match[1]), path)
        if other is not path:
            raise SourceError(f"{path} and {other.name} have the same number; set a pattern that matches one of them")
    return dict(sorted(numbered.items()))


def _read_pose(path: Path) -> Floats | None:
    """Return the matrix (4, 4) from the camera's optical axes to the world; None where it is not finite."""
    rows = [field for _, text in lines_of(path) for field in text.replace(",", " ").split()]
    if len(rows) not in (12, 16):
        raise SourceError(f"{path}: expected the 12 or 16 numbers of a matrix, found {len(rows)}")
    if any(word in field.lower() for field in rows[:12] for word in ("nan", "inf")):
        return None
    pose = np.eye(4)
    pose[:3] = pose_of(matrix_of(rows[:12], str(path)), str(path))
    return pose


def _read_lens(folder: Path) -> Pinhole | None:
    """Read ``fx fy cx cy``, or a matrix, from a file in the folder or above; None without one."""
    candidates = [place / name for place in (folder, folder.resolve().parent) for name in _LENSES]
    path = next((one for one in candidates if one.is_file()), None)
    if path is None:
        return None
    fields = [
        number(field, "a lens parameter", str(path))
        for _, text in lines_of(path)
        for field in text.replace(",", " ").split()
    ]
    if len(fields) in (9, 16):
        width = 3 if len(fields) == 9 else 4
        fields = [fields[0], fields[width + 1], fields[2], fields[width + 2]]
    if len(fields) != 4:
        raise SourceError(f"{path}: expected fx fy cx cy or a matrix of 9 or 16 numbers, found {len(fields)} numbers")
    fx, fy, cx, cy = fields
    try:
        return Pinhole(fx, fy, cx, cy)
    except ShapeError as error:
        raise SourceError(f"{path}: {error}") from error


def _lens_of_size(lens: Pinhole, size: tuple[int, ...], other: tuple[int, ...]) -> Pinhole | None:
    """Return the lens of a depth picture that shows what the colour picture does in other pixels; None: in the same."""
    if size == other:
        return None
    down, across = other[0] / size[0], other[1] / size[1]
    return Pinhole(
        lens.fx * across, lens.fy * down, (lens.cx + 0.5) * across - 0.5, (lens.cy + 0.5) * down - 0.5, lens.distortion
    )
