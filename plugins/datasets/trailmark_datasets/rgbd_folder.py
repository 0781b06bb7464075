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
from trailmark.errors import SourceError
from trailmark.frames import RGBD, DepthCamera, SensorInfo
from trailmark.geometry import Trajectory
from trailmark.sources import Reading, Readings, RecordedSource
from trailmark.sources.pictures import PICTURE_SUFFIXES, read_picture, read_raw
from trailmark_datasets.config import RgbdFolderConfig
from trailmark_datasets.depth import depth_in_metres
from trailmark_datasets.first import first_readable
from trailmark_datasets.lenses import lens_of_size, read_camera, read_matrix
from trailmark_datasets.planar import mounting_pose, planar_trajectory
from trailmark_datasets.pose_matrices import matrix_of, pose_of
from trailmark_datasets.textfiles import lines_of, number

__all__ = ["RgbdFolder"]

logger = logging.getLogger(__name__)

#: Where colour, depth and poses are looked for, in this order.
_COLOUR, _DEPTH, _POSES = (
    ("*.color.*", "color/*", "rgb/*"),
    ("*.depth.*", "depth/*"),
    ("*.pose.[tT][xX][tT]", "pose/*.[tT][xX][tT]", "poses/*.[tT][xX][tT]"),
)
_MATRICES = ("camera-intrinsics.txt", "intrinsics.txt", "intrinsic/intrinsic_color.txt")
_DEPTH_MATRIX = "intrinsic/intrinsic_depth.txt"
#: Depth values per metre, where nobody says.
DEPTH_FACTOR = 1000.0
# Exports number a few pictures by their place in the whole; stamps in names leave out all but a few in millions.
_MOST_LEFT_OUT, _LARGEST_INDEX = 1000, 10**8
_NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity)", re.IGNORECASE)
_ROUNDED = 1e-4
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
    _factor = DEPTH_FACTOR
    _has_poses = False

    def open_recording(self, name: str) -> Iterable[SensorInfo]:
        """List the files, and look at the first picture and the lens."""
        self._name = name or "rgbd"
        self._files = self._list()
        first = first_readable(self._files, self._load, self.config)
        self.expect_form(self._name, first)
        height, width = first.bgr.shape[:2]
        calibration, factor = _lenses(self.config.path, first.bgr.shape[:2], first.depth_m.shape)
        self._factor = self.config.depth_factor or factor or DEPTH_FACTOR
        return (SensorInfo(self._name, "rgbd", (width, height), self.config.rate_hz, calibration=calibration),)

    def _list(self) -> tuple[_Files, ...]:
        folder, config = self.config.path, self.config
        colour = _numbered(folder, (config.colour,) if config.colour else _COLOUR, "colour", PICTURE_SUFFIXES)
        depth = _numbered(folder, (config.depth,) if config.depth else _DEPTH, "depth", PICTURE_SUFFIXES)
        poses = _numbered(folder, (config.poses,) if config.poses else _POSES, "poses" if config.poses else "", None)
        both = sorted(colour.keys() & depth.keys())
        if not both:
            raise SourceError(
                f"{folder}: no colour picture has the number of a depth picture: {next(iter(colour.values())).name} and"
                f" {next(iter(depth.values())).name} are the first; set the patterns colour and depth"
            )
        if both[0] > _LARGEST_INDEX or both[-1] - both[0] + 1 > _MOST_LEFT_OUT * len(both):
            raise SourceError(
                f"{folder}: {len(both)} pictures between the numbers {both[0]} and {both[-1]}: these are no indices."
                " Pictures with stamps in their names can be listed in rgb.txt and depth.txt for the source 'tum_rgbd'"
            )
        self.counted["unpaired_colour"] = len(colour) - len(both)
        self.counted["unpaired_depth"] = len(depth) - len(both)
        self._has_poses = bool(poses)
        rate_hz = config.rate_hz
        return tuple(_Files((n - both[0]) / rate_hz, colour[n], depth[n], poses.get(n)) for n in both)

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
        return RGBD(bgr, depth_in_metres(raw, self._factor, str(files.depth)))

    def ground_truth(self) -> Trajectory | None:
        """Return the true pose of base at every frame whose file of a pose has one; None without any."""
        told = [(files.stamp_s, self._pose_of(files.pose)) for files in self._files]
        known = [(stamp_s, pose) for stamp_s, pose in told if pose is not None]
        if len(known) < len(told) and self._has_poses:
            logger.warning("%s: %d of %d frames have no true pose", self.config.path, len(told) - len(known), len(told))
        if not known:
            return None
        stamps_s = np.array([stamp_s for stamp_s, _ in known])
        poses = np.array([pose for _, pose in known])
        return planar_trajectory(stamps_s, poses, mounting_pose(self.config.mounting), self.config.start_s or 0.0)

    def _pose_of(self, file: Path | None) -> Floats | None:
        """Return the pose that a file tells; None where there is none, or a bad one that may be skipped."""
        try:
            return None if file is None else _read_pose(file)
        except SourceError:
            if self.config.on_bad_frame == "error":
                raise
            return None


def _numbered(folder: Path, patterns: Sequence[str], what: str, suffixes: Iterable[str] | None) -> dict[int, Path]:
    """Return the files of the first pattern that matches any, by their number, in its order."""
    for pattern in patterns:
        try:
            found = [path for path in folder.glob(pattern) if path.is_file()]
        except (ValueError, NotImplementedError, OSError, IndexError, AttributeError) as error:  # of pathlib, for "."
            raise SourceError(f"{folder}: cannot list pattern {pattern!r}: {error}") from error
        found = [path for path in found if suffixes is None or path.suffix.lower() in suffixes]
        if found:
            return _by_number(found)
    if what:
        raise SourceError(f"{folder}: nothing matches {' or '.join(patterns)}; set {what}: a pattern of files below it")
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
    where, words = str(path), [word for _, text in lines_of(path) for word in text.replace(",", " ").split()]
    if len(words) not in (12, 16):
        raise SourceError(f"{where}: expected the 12 or 16 numbers of a matrix, found {len(words)}")
    if any(_NOT_FINITE.fullmatch(word) for word in words):
        return None
    last = [number(word, "a number of the matrix", where) for word in words[12:]]
    if last and np.abs(np.array(last) - [0.0, 0.0, 0.0, 1.0]).max() > _ROUNDED:
        raise SourceError(f"{where}: the last row is not 0 0 0 1; is the matrix written column by column?")
    pose = np.eye(4)
    pose[:3] = pose_of(matrix_of(words[:12], where), where)
    return pose


def _lenses(folder: Path, colour: tuple[int, ...], depth: tuple[int, ...]) -> tuple[DepthCamera | None, float | None]:
    """Return what files in the folder or above say of the lenses, and of depth values per metre; None: nothing.

    Depth is registered to colour. Where its picture is of another size it has a lens of its own: what a file says, else
    that of colour in other pixels.
    """
    for place in (folder, folder.resolve().parent):
        lens, factor = read_camera(place / "camera.txt")
        matrix = next((place / name for name in _MATRICES if (place / name).is_file()), None)
        if lens is None and matrix is not None:
            lens = read_matrix(matrix)
        if lens is not None:
            if not (0.0 < lens.cx < colour[1] and 0.0 < lens.cy < colour[0]):
                raise SourceError(
                    f"{matrix or place / 'camera.txt'}: the principal point {lens.cx:g}, {lens.cy:g} lies outside of"
                    f" the colour picture of {colour[1]} x {colour[0]} pixels; is it the lens of another size?"
                )
            own = place / _DEPTH_MATRIX
            of_depth = None
            if colour != depth:
                of_depth = read_matrix(own) if own.is_file() else lens_of_size(lens, colour, depth)
            return DepthCamera(lens, of_depth), factor
    return None, None
