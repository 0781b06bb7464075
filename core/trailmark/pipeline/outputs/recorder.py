"""Writes the folder of a run: everything but metrics, plots and report."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

from trailmark.errors import RunError
from trailmark.estimates import Belief, EstimateRecord, Fix, Lost, Motion, PathOffset
from trailmark.frames import SensorInfo
from trailmark.frames.documents import sensor_to_document
from trailmark.frames.outlines import Outlines
from trailmark.geometry import Trajectory
from trailmark.geometry.tum import tum_text
from trailmark.interfaces import Sink
from trailmark.pipeline.outputs.beliefs import BeliefLog
from trailmark.pipeline.outputs.provenance import provenance
from trailmark.pipeline.outputs.result import RunResult, Status
from trailmark.pipeline.outputs.run_folder import files_in
from trailmark.pipeline.outputs.whole_files import cut_after_last_line, overwrite_in_place
from trailmark.writing import WholeLines, write_whole

__all__ = ["ESTIMATE_COLUMNS", "Recorder", "outlines_document"]

#: Columns of ``estimates.csv``; of a path offset x, y, theta are station, lateral, heading.
#: ``Motion.is_matched`` and ``Motion.is_guess`` have none.
ESTIMATE_COLUMNS = (
    *("arrived_s", "source", "kind", "since_s", "stamp_s", "x", "y", "theta"),
    *("info_xx", "info_xy", "info_xt", "info_yy", "info_yt", "info_tt"),
    *("status", "nis", "dof", "reason", "details"),
)

#: ``run.json`` takes so much space from the beginning, so that a full disk has room for how the run ended.
_RESERVED_BYTES = 1 << 15

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
        self._estimates: WholeLines | None = None
        self._beliefs = BeliefLog()
        self._about: dict[str, Any] = {}
        self._measured: dict[str, Any] = {}
        self._began_s = 0.0
        #: Whether the end of the run stands in its folder.
        self.is_written = False

    def open(self, document: Mapping[str, Any], sensors: Mapping[str, SensorInfo]) -> None:
        """Write config and provenance, and begin with the estimates."""
        from trailmark.config.yaml_text import dump_yaml

        self._began_s = perf_counter()
        documents = {name: sensor_to_document(info) for name, info in sensors.items()}
        self._about = provenance(self._config_dir) | self._facts | {"sensors": documents}
        try:
            write_whole(self.folder / "config.yaml", dump_yaml(dict(document)))
            self._estimates = WholeLines(self.folder / "estimates.csv")
            self._rows = csv.writer(self._estimates, lineterminator="\n")
            self._rows.writerow(ESTIMATE_COLUMNS)
            about = _json(self._about | {"status": "running"})
            write_whole(self.folder / "run.json", about.ljust(_RESERVED_BYTES))
        except OSError as error:
            self._remove_all()
            raise _failure(self.folder, error) from error

    def on_estimate_record(self, record: EstimateRecord) -> None:
        """Write a row."""
        self._rows.writerow(_row(record))

    def on_belief(self, belief: Belief) -> None:
        """Keep it, if it is among those that are written."""
        self._beliefs.add(belief)

    def write(self, result: RunResult) -> None:
        """Write everything that is known at the end; what cannot be written keeps nothing else from being written.

        Raises
        ------
        RunError
            If something cannot be written.
        """
        self._measured = {
            "duration_s": round(perf_counter() - self._began_s, 3),
            "counters": dict(result.counters),
        }
        failures = []
        for step in self._steps_of(result):
            try:
                step()
            except OSError as error:
                failures.append(error)
        self.write_status(result)
        if failures:
            raise _failure(self.folder, failures[0]) from failures[0]

    def write_status(self, result: RunResult) -> None:
        """Write how the run ended; on a full disk, into the space that was kept for it."""
        ended = {"status": result.status, "reason": result.reason}
        about = self._about | ended | self._measured | {"files": files_in(self.folder)}
        try:
            self._write_about(about, ended)
        except OSError as error:
            raise _failure(self.folder, error) from error
        self.is_written = True

    def mark(self, status: Status, reason: str) -> None:
        """Write into ``run.json`` how the run ended, for when there is no time for anything else."""
        if self._estimates is not None:
            with suppress(OSError, ValueError):  # the disk is full, or the run's thread has closed it just now
                self._estimates.flush()
        ended = {"status": status, "reason": reason}
        self._write_about(self._about | ended | self._measured, ended)

    def _write_about(self, about: Mapping[str, Any], ended: Mapping[str, Any]) -> None:
        """Write ``run.json``; on a full disk into the space that was kept for it, if need be the end alone."""
        path = self.folder / "run.json"
        try:
            write_whole(path, _json(about))
        except OSError:
            if not overwrite_in_place(path, _json(about)) and not overwrite_in_place(path, _json(ended)):
                raise

    def close(self) -> None:
        """Close the table of estimates; where the last row could not be written whole, it ends with the one before."""
        table, self._estimates = self._estimates, None
        if table is None:
            return
        try:
            table.close()
        except OSError:
            cut_after_last_line(self.folder / "estimates.csv")
            raise

    def _steps_of(self, result: RunResult) -> Iterator[Callable[[], None]]:
        """Yield what writes each file."""
        yield self.close
        folder = self.folder / "trajectories"
        yield partial(folder.mkdir, exist_ok=True)
        for name, trajectory in result.trajectories.items():
            yield partial(_write_trajectory, folder / f"{name}.tum", trajectory)
        if result.ground_truth is not None:
            yield partial(_write_trajectory, folder / "groundtruth.tum", result.ground_truth)
        yield partial(self._write_json, "timing.json", result.timing)
        if beliefs := self._beliefs.text():
            yield partial(write_whole, self.folder / "beliefs.csv", beliefs)
        if result.outlines is not None:
            yield partial(self._write_json, "outlines.json", outlines_document(result.outlines))

    def _write_json(self, name: str, content: Any) -> None:
        write_whole(self.folder / name, _json(content))

    def _remove_all(self) -> None:
        """Leave nothing of a run that cannot begin."""
        with suppress(OSError):
            self.close()
        for name in ("config.yaml", "estimates.csv", "run.json"):
            with suppress(OSError):
                (self.folder / name).unlink(missing_ok=True)


def _json(content: Any) -> str:
    return json.dumps(content, indent=2) + "\n"


def _write_trajectory(path: Path, trajectory: Trajectory) -> None:
    write_whole(path, tum_text(trajectory))


def outlines_document(outlines: Outlines) -> dict[str, Any]:
    """Return the lines as lists, to a tenth of a millimetre."""
    around = [line.round(4).tolist() for line in outlines.around]
    return {"around": around, "robot": None if outlines.robot is None else outlines.robot.round(4).tolist()}


def _failure(folder: Path, error: OSError) -> RunError:
    return RunError(f"cannot write to {folder}: {error.strerror or error}", "recorder")


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
