"""Writes the folder of a run: everything but metrics, plots and report."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from pathlib import Path
from time import perf_counter
from typing import Any, TextIO

from trailmark.errors import RunError
from trailmark.estimates import EstimateRecord, Fix, Lost, Motion, PathOffset
from trailmark.frames import SensorInfo
from trailmark.frames.documents import sensor_to_document
from trailmark.geometry import write_tum
from trailmark.interfaces import Sink
from trailmark.pipeline.outputs.provenance import provenance
from trailmark.pipeline.outputs.result import RunResult
from trailmark.pipeline.outputs.run_folder import files_in

__all__ = ["ESTIMATE_COLUMNS", "Recorder"]

#: Columns of ``estimates.csv``; of a path offset x, y, theta are station, lateral, heading.
ESTIMATE_COLUMNS = (
    *("arrived_s", "source", "kind", "since_s", "stamp_s", "x", "y", "theta"),
    *("info_xx", "info_xy", "info_xt", "info_yy", "info_yt", "info_tt"),
    *("status", "nis", "dof", "reason", "details"),
)

_NO_POSE = ("",) * 9


class Recorder(Sink):
    """Streams estimates while the run goes on, and writes the rest when it ends.

    Parameters
    ----------
    folder : Path
        An empty folder.
    facts : mapping
        What ``run.json`` says besides: mode, pace, seed, plugins.
    config_dir : Path or None
        Folder of the config.
    """

    def __init__(self, folder: Path, facts: Mapping[str, Any], config_dir: Path | None) -> None:
        super().__init__(None)
        self.folder = folder
        self._facts = dict(facts)
        self._config_dir = config_dir
        self._estimates: TextIO | None = None
        self._about: dict[str, Any] = {}
        self._measured: dict[str, Any] = {}
        self._began_s = 0.0

    def open(self, document: Mapping[str, Any], sensors: Mapping[str, SensorInfo]) -> None:
        """Write config and provenance, and begin with the estimates."""
        from trailmark.config.yaml_text import dump_yaml

        self._began_s = perf_counter()
        documents = {name: sensor_to_document(info) for name, info in sensors.items()}
        self._about = provenance(self._config_dir) | self._facts | {"sensors": documents}
        try:
            (self.folder / "config.yaml").write_text(dump_yaml(dict(document)), encoding="utf-8")
            self._estimates = (self.folder / "estimates.csv").open("w", encoding="utf-8", newline="")
            self._rows = csv.writer(self._estimates, lineterminator="\n")
            self._rows.writerow(ESTIMATE_COLUMNS)
            self._write_json("run.json", self._about | {"status": "running"})
        except OSError as error:
            raise RunError(f"cannot write to {self.folder}: {error.strerror or error}", "recorder") from error

    def on_estimate_record(self, record: EstimateRecord) -> None:
        """Write a row."""
        self._rows.writerow(_row(record))

    def write(self, result: RunResult) -> None:
        """Write everything that is known at the end."""
        self.close()
        try:
            self._write_trajectories(result)
            self._write_json("timing.json", result.timing)
            self._measured = {
                "duration_s": round(perf_counter() - self._began_s, 3),
                "counters": dict(result.counters),
            }
        except OSError as error:
            raise RunError(f"cannot write to {self.folder}: {error.strerror or error}", "recorder") from error
        self.write_status(result)

    def write_status(self, result: RunResult) -> None:
        """Write how the run ended."""
        try:
            about = self._about | {"status": result.status, "reason": result.reason} | self._measured
            self._write_json("run.json", about | {"files": files_in(self.folder)})
        except OSError as error:
            raise RunError(f"cannot write to {self.folder}: {error.strerror or error}", "recorder") from error

    def close(self) -> None:
        """Close the table of estimates."""
        if self._estimates is not None:
            self._estimates.close()

    def _write_trajectories(self, result: RunResult) -> None:
        folder = self.folder / "trajectories"
        folder.mkdir(exist_ok=True)
        for name, trajectory in result.trajectories.items():
            write_tum(folder / f"{name}.tum", trajectory)
        if result.ground_truth is not None:
            write_tum(folder / "groundtruth.tum", result.ground_truth)

    def _write_json(self, name: str, content: Any) -> None:
        (self.folder / name).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def _row(record: EstimateRecord) -> tuple[str, ...]:
    estimate, outcome = record.estimate, record.outcome
    details = {name: float(value) for name, value in estimate.details.items()}
    return (
        repr(record.arrived_s),
        record.source,
        _kind(record),
        repr(float(estimate.since_s)) if isinstance(estimate, Motion) else "",
        repr(float(estimate.stamp_s)),
        *_numbers(record),
        outcome.status,
        "" if outcome.nis is None else repr(float(outcome.nis)),
        "" if outcome.dof is None else str(outcome.dof),
        estimate.reason if isinstance(estimate, Lost) else outcome.reason,
        json.dumps(details, separators=(",", ":")) if details else "",
    )


def _kind(record: EstimateRecord) -> str:
    match record.estimate:
        case Motion():
            return "motion"
        case Fix():
            return "fix"
        case PathOffset():
            return "path_offset"
    return "lost"


def _numbers(record: EstimateRecord) -> tuple[str, ...]:
    """Return the three numbers and the six of their information."""
    match record.estimate:
        case Lost():
            return _NO_POSE
        case PathOffset(station_m=x, lateral_m=y, heading_rad=theta, information=information):
            pass
        case Motion(pose_since_now=pose, information=information) | Fix(pose_map_base=pose, information=information):
            x, y, theta = pose.x, pose.y, pose.theta
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = information.tolist()
    return tuple(repr(float(value)) for value in (x, y, theta, xx, xy, xt, yy, yt, tt))
