"""Readings of all sensors as an ordinary data set on disk, in formats that any program reads."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from trailmark.config.yaml_text import dump_yaml
from trailmark.errors import ConfigError, SourceError
from trailmark.frames import RGBD, DepthCamera, Frame, Image, Record, Scan, SensorInfo
from trailmark.frames.array_documents import array_from_document
from trailmark.frames.documents import calibration_to_document
from trailmark.geometry import Trajectory, write_tum
from trailmark.recording.pictures import write_png
from trailmark.writing import write_whole

__all__ = ["DatasetWriter"]

#: Depth values per metre in 16-bit pictures, as in the TUM RGB-D benchmark.
_DEPTH_FACTOR = 5000.0
#: What is farther than a picture can hold was not measured: its largest value would be a wall that is not there.
_FARTHEST_M = 65535 / _DEPTH_FACTOR
#: Farther than any laser sees: no return is lost when the log is played, which says itself what the range is.
_BEYOND_M = 1e6


class DatasetWriter:
    """Writes frames as they come.

    ========  ====================================================================================
    kind      on disk
    ========  ====================================================================================
    image     ``NAME/000000.png`` ..., ``NAME/timestamps.txt`` (stamp and file)
    rgbd      ``NAME/rgb/``, ``NAME/depth/`` (16 bit, 5000 a metre), ``rgb.txt``, ``depth.txt``, ``camera.txt`` (TUM)
    scan      ``NAME.log`` (CARMEN, ``ROBOTLASER1``)
    odometry  ``NAME.csv``: t, x, y, theta since the start; or t, distance
    imu       ``NAME.csv``: t, rates, accelerations
    scalar    ``NAME.csv``: t, value
    others    ``NAME/000000.npz`` ..., ``NAME/timestamps.txt`` of a `Record`; else ``NAME.csv``: t, its numbers
    ========  ====================================================================================

    Beside them stand ``NAME.calib.yaml`` (arrays of it in ``.npy`` files), ``groundtruth.tum``, and ``config.yaml``
    with the mountings, which plays the data set again. Depth is rounded to 0.2 mm; what is farther than
    13.1 m is written as not measured, and counted (`n_too_far`). What no source reads (`playable`) is for other
    programs.

    Parameters
    ----------
    folder : Path
        Where to write to; must be empty, or not be there yet, unless `overwrite`.
    sensors : mapping of str to SensorInfo
        What will be written.
    overwrite : bool
        Write into a folder that is not empty.

    Raises
    ------
    ConfigError
        If the folder holds something already.
    """

    def __init__(self, folder: Path, sensors: Mapping[str, SensorInfo], overwrite: bool = False) -> None:
        if folder.is_dir() and any(folder.iterdir()) and not overwrite:
            raise ConfigError(f"{folder} is not empty; choose another folder, or --overwrite")
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self._sensors = folder, dict(sensors)
        self._texts: dict[str, TextIO] = {}
        self._headers: dict[str, str] = {}
        self.counts = dict.fromkeys(sensors, 0)
        self.n_too_far: dict[str, int] = {}

    @property
    def playable(self) -> tuple[str, ...]:
        """The sensors that were written and that ``config.yaml`` plays again."""
        return tuple(name for name, info in self._sensors.items() if info.kind in _SOURCES and self.counts[name])

    def write(self, frame: Frame) -> None:
        """Write one frame.

        Raises
        ------
        SourceError
            If odometry gives a pose and later only a distance, or the other way round.
        """
        name, payload = frame.sensor, frame.payload
        number = f"{self.counts[name]:06d}"
        self.counts[name] += 1
        match payload:
            case Image():
                write_png(self.folder / name / f"{number}.png", payload.pixels)
                self._line(f"{name}/timestamps.txt", f"{frame.stamp_s!r} {number}.png")
            case RGBD():
                self._write_rgbd(name, number, frame.stamp_s, payload)
            case Scan():
                self._line(f"{name}.log", _robotlaser(frame.stamp_s, payload))
            case Record():
                (self.folder / name).mkdir(exist_ok=True)
                np.savez(self.folder / name / f"{number}.npz", **dict(payload.arrays))  # type: ignore[arg-type]  # no array is called allow_pickle
                self._line(f"{name}/timestamps.txt", f"{frame.stamp_s!r} {number}.npz")
            case _:
                self._row(name, frame.stamp_s, payload.numbers())

    def close(self, truth: Trajectory | None) -> None:
        """Write calibrations, the ground truth, and the config that plays it all again."""
        for text in self._texts.values():
            text.close()
        self._texts.clear()
        if truth is not None:
            write_tum(self.folder / "groundtruth.tum", truth)
        for info in self._sensors.values():
            if info.calibration is not None:
                document = self._with_files(calibration_to_document(info.calibration), info.name)
                write_whole(self.folder / f"{info.name}.calib.yaml", dump_yaml(document))
        write_whole(self.folder / "config.yaml", dump_yaml(self._config(truth is not None)))

    def _write_rgbd(self, name: str, number: str, stamp_s: float, payload: RGBD) -> None:
        is_known = np.isfinite(payload.depth_m)
        is_too_far = is_known & (payload.depth_m > _FARTHEST_M)
        self.n_too_far[name] = self.n_too_far.get(name, 0) + int(is_too_far.sum())
        depth = np.where(is_known & ~is_too_far, payload.depth_m, 0.0) * _DEPTH_FACTOR
        write_png(self.folder / name / "rgb" / f"{number}.png", payload.bgr)
        write_png(self.folder / name / "depth" / f"{number}.png", np.rint(np.maximum(depth, 0.0)).astype(np.uint16))
        for kind in ("rgb", "depth"):
            self._line(f"{name}/{kind}.txt", f"{stamp_s!r} {kind}/{number}.png")
        calibration = self._sensors[name].calibration
        if number == "000000" and isinstance(calibration, DepthCamera):
            lens = calibration.colour
            numbers = (lens.fx, lens.fy, lens.cx, lens.cy, *lens.distortion)
            self._line(f"{name}/camera.txt", " ".join(repr(float(value)) for value in numbers))
            self._line(f"{name}/camera.txt", repr(_DEPTH_FACTOR))

    def _row(self, name: str, stamp_s: float, columns: Mapping[str, float]) -> None:
        header = ",".join(("t", *columns))
        if self._headers.setdefault(name, header) != header:
            raise SourceError(f"sensor {name!r} gives {header} at {stamp_s:.6f} s, and {self._headers[name]} before")
        if f"{name}.csv" not in self._texts:
            self._line(f"{name}.csv", header)
        self._line(f"{name}.csv", ",".join(repr(float(value)) for value in (stamp_s, *columns.values())))

    def _line(self, name: str, line: str) -> None:
        if name not in self._texts:
            (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
            self._texts[name] = (self.folder / name).open("w", encoding="utf-8")
        self._texts[name].write(line + "\n")

    def _with_files(self, value: Any, stem: str) -> Any:
        """Return a document whose arrays are files of their own."""
        if not isinstance(value, dict):
            return value
        if "base64" in value:
            np.save(self.folder / f"{stem}.npy", array_from_document(value, stem))
            return f"{stem}.npy"
        return {key: self._with_files(item, f"{stem}.{key}") for key, item in value.items()}

    def _config(self, has_truth: bool) -> dict[str, Any]:
        """Return the config that plays the data set; what no source reads is left out."""
        written = {name: self._sensors[name] for name in self.playable}
        sources = {name: _SOURCES[info.kind](name) for name, info in written.items()}
        if has_truth and sources:
            next(iter(sources.values()))["ground_truth"] = "groundtruth.tum"
        return {"sources": sources, "sensors": {name: _section(info) for name, info in written.items()}}


#: Kind of sensor to the source that plays it again.
_SOURCES: Mapping[str, Callable[[str], dict[str, Any]]] = {
    "image": lambda name: {"plugin": "image_folder", "path": name, "timestamps": f"{name}/timestamps.txt"},
    "rgbd": lambda name: {"plugin": "tum_rgbd", "path": name},
    "scan": lambda name: {
        "plugin": "carmen_log",
        "path": f"{name}.log",
        "range_max_m": _BEYOND_M,
        "rename": {"laser": name},
    },
    "odometry": lambda name: {"plugin": "csv_odometry", "path": f"{name}.csv"},
}


def _section(info: SensorInfo) -> dict[str, Any]:
    """Return what the config says of a sensor: its mounting, and where its calibration stands."""
    pose = info.pose_base_sensor
    angles = {f"{name}_deg": math.degrees(getattr(pose, name)) for name in ("roll", "pitch", "yaw")}
    section: dict[str, Any] = {"mounting": {"x": pose.x, "y": pose.y, "z": pose.z} | angles}
    if info.calibration is not None:
        section["calibration"] = f"{info.name}.calib.yaml"
    return section


def _robotlaser(stamp_s: float, scan: Scan) -> str:
    """Return a scan as a line of a CARMEN log; beams that nothing came back from have the largest range."""
    range_max_m = min(scan.range_max_m, _BEYOND_M)
    ranges = np.where(np.isfinite(scan.ranges_m), scan.ranges_m, range_max_m).astype(np.float64)
    field = (len(ranges) - 1) * scan.angle_step_rad
    head = (0, scan.angle_min_rad, field, scan.angle_step_rad, range_max_m, 0.0, 0, len(ranges))
    tail = (0, *(0.0,) * 11, stamp_s, "trailmark", stamp_s)  # no remissions, poses, velocities or safety distances
    return " ".join(str(value) for value in ("ROBOTLASER1", *head, *ranges.tolist(), *tail))
