"""Sequences of the TUM RGB-D benchmark (Sturm et al. 2012)."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from trailmark.errors import SourceError
from trailmark.frames import RGBD, DepthCamera, SensorInfo
from trailmark.geometry import Trajectory
from trailmark.sources import Reading, Readings, RecordedSource
from trailmark.sources.pictures import read_picture, read_raw
from trailmark_datasets.config import TumRgbdConfig
from trailmark_datasets.depth import depth_in_metres, pair_nearest
from trailmark_datasets.first import first_readable
from trailmark_datasets.lenses import read_camera
from trailmark_datasets.planar import covered_stamps, interpolated_poses, mounting_pose, planar_trajectory
from trailmark_datasets.stamps import Stamp, read_stamps
from trailmark_datasets.textfiles import lines_of, number

__all__ = ["TumRgbd"]

logger = logging.getLogger(__name__)

#: Depth values per metre of the benchmark.
DEPTH_FACTOR = 5000.0


@dataclass(frozen=True, slots=True)
class _Pair:
    colour: Stamp
    depth: Stamp


class TumRgbd(RecordedSource):
    """Colour and depth, paired by stamp; the frame's stamp is the colour picture's.

    The true poses are those of the camera, interpolated to the frames' stamps and projected to the plane of the
    first that is delivered, which `start_s` chooses: x along its optical axis, y to its left.
    """

    config: TumRgbdConfig
    loads_ahead = True
    _name = ""
    _pairs: tuple[_Pair, ...] = ()
    _factor = DEPTH_FACTOR

    def open_recording(self, name: str) -> Iterable[SensorInfo]:
        self._name = name or "rgbd"
        colour, depth = self._read_list("rgb.txt"), self._read_list("depth.txt")
        self._pairs = self._pair_by_stamp(colour, depth)
        self.counted["unpaired_colour"] = len(colour) - len(self._pairs)
        self.counted["unpaired_depth"] = len(depth) - len(self._pairs)
        lens, factor = read_camera(self.config.path / "camera.txt")
        self._factor = self.config.depth_factor or factor or DEPTH_FACTOR
        first = first_readable(self._pairs, self._load, self.config)
        self.expect_form(self._name, first)
        height, width = first.bgr.shape[:2]
        return (
            SensorInfo(
                self._name,
                "rgbd",
                size=(width, height),
                rate_hz=_rate(self._pairs),
                calibration=DepthCamera(lens) if lens else None,
            ),
        )

    def _read_list(self, name: str) -> list[Stamp]:
        stamps = read_stamps(self.config.path / name)
        for stamp in stamps:
            if stamp.name is None:
                raise SourceError(f"{self.config.path / name}: {stamp.where} names no file beside the stamp")
        return stamps

    def _pair_by_stamp(self, colour: list[Stamp], depth: list[Stamp]) -> tuple[_Pair, ...]:
        """Pair by stamp; a stamp that goes back stays where it stands, for `frames` to find."""
        order = np.argsort([stamp.stamp_s for stamp in depth], kind="stable")
        colour_order = np.argsort([stamp.stamp_s for stamp in colour], kind="stable")
        indices = pair_nearest(
            np.array([colour[i].stamp_s for i in colour_order]),
            np.array([depth[j].stamp_s for j in order]),
            self.config.max_difference_s,
        )
        found = {int(colour_order[i]): int(order[j]) for i, j in indices}
        if not found:
            raise SourceError(
                f"{self.config.path}: no colour picture has a depth picture within {self.config.max_difference_s} s;"
                f" rgb.txt begins at {colour[0].stamp_s:.6f} s, depth.txt at {depth[0].stamp_s:.6f} s."
                " Set max_difference_s"
            )
        return tuple(_Pair(colour[i], depth[found[i]]) for i in sorted(found))

    def lasts_s(self) -> float | None:
        """Return the time from the first pair of pictures to the last."""
        return self._pairs[-1].colour.stamp_s - self._pairs[0].colour.stamp_s if self._pairs else None

    def readings(self) -> Readings:
        for pair in self._pairs:
            yield Reading(self._name, pair.colour.stamp_s, pair.colour.where, partial(self._load, pair))

    def _load(self, pair: _Pair) -> RGBD:
        colour, depth = (self.config.path / str(stamp.name) for stamp in (pair.colour, pair.depth))
        bgr = read_picture(colour, f"{pair.colour.where} ({colour})", grey=False)
        where = f"{pair.depth.where} ({depth})"
        return RGBD(bgr, depth_in_metres(read_raw(depth, where), self._factor, where))

    def ground_truth(self) -> Trajectory | None:
        """Return the true pose of base at every frame that `groundtruth.txt` covers; None without one."""
        path = self.config.path / "groundtruth.txt"
        if not path.exists() or not self._pairs:
            return None
        truth_s, poses = _read_poses(path)
        wanted_s = np.unique([pair.colour.stamp_s for pair in self._pairs])
        covered_s = wanted_s[covered_stamps(wanted_s, truth_s, self.config.max_truth_gap_s)]
        if 2 * len(covered_s) < len(wanted_s):
            logger.warning(
                "%s covers %d of %d frames: between true poses more than %g s apart none is interpolated,"
                " set max_truth_gap_s",
                path,
                len(covered_s),
                len(wanted_s),
                self.config.max_truth_gap_s,
            )
        begin_s = self._pairs[0].colour.stamp_s + (self.config.start_s or 0.0)
        return planar_trajectory(
            covered_s, interpolated_poses(covered_s, truth_s, poses), mounting_pose(self.config.mounting), begin_s
        )


def _rate(pairs: tuple[_Pair, ...]) -> float | None:
    gaps = [after.colour.stamp_s - before.colour.stamp_s for before, after in pairwise(pairs)]
    middle = float(np.median(gaps)) if gaps else 0.0
    return 1.0 / middle if middle > 0 else None


def _read_poses(path: Path) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Read ``t x y z qx qy qz qw`` lines: stamps (N,) and rows x y z qx qy qz qw (N, 7)."""
    rows: list[list[float]] = []
    for line, text in lines_of(path):
        where = f"{path}:{line}"
        fields = text.replace(",", " ").split()
        if len(fields) != 8:
            raise SourceError(f"{where}: expected 8 numbers (t x y z qx qy qz qw), found {len(fields)}")
        row = [number(field, "a number of the pose", where) for field in fields]
        if rows and row[0] <= rows[-1][0]:
            raise SourceError(f"{where}: the stamp of a true pose goes back: {row[0]:.6f} s after {rows[-1][0]:.6f} s")
        if not 0.9 < float(np.linalg.norm(row[4:])) < 1.1:
            raise SourceError(f"{where}: qx qy qz qw is no unit quaternion")
        rows.append(row)
    table = np.array(rows, dtype=np.float64).reshape(-1, 8)
    return table[:, 0], table[:, 1:]
