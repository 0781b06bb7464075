"""A run while it goes on, as far as it is known: from the estimates that it writes, and from its notes."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from trailmark.arrays import Floats
from trailmark.errors import DataError, TrailmarkError
from trailmark.estimates import Applied, Estimate, EstimateRecord, Fix, Lost, Motion, PathOffset
from trailmark.evaluation.belief_table import BELIEFS_FILE, OUTLINES_FILE, BeliefTable, read_beliefs, read_outlines
from trailmark.evaluation.estimates_table import table_of_rows
from trailmark.evaluation.path_file import PATH_FILE, read_path
from trailmark.evaluation.run_folder import FUSED, RunFolder, localizer_names, read_run
from trailmark.geometry import Pose2, Trajectory, read_tum
from trailmark.interfaces import Session
from trailmark.pipeline.outputs.tracks import Tracks
from trailmark.report.growing_rows import GrowingRows
from trailmark.report.live import RunWatch
from trailmark.report.write import explorer_of_run
from trailmark.watching.notes import TRUTH_FILE
from trailmark.watching.thinning import Thinned, every_nth

__all__ = ["GrowingRun"]

T = TypeVar("T")

#: Read at one look; of a long run that is looked at late there is much to catch up with [bytes].
_READ_AT_ONCE = 1 << 20
#: Of each localizer, kept for drawing.
_MAX_ESTIMATES, _MAX_POSES = 3000, 2000


class GrowingRun:
    """A run that is being written.

    Every localizer's own way is reckoned from its estimates, as the run itself does it; belief, truth and what stands
    around come from the notes of a run that is watched, and of another one are not known before its end.

    Parameters
    ----------
    folder : Path
        Of the run.
    notes : Path or None
        Where `LiveNotes` writes.

    Raises
    ------
    DataError
        If it is not the folder of a run.
    """

    def __init__(self, folder: Path, notes: Path | None = None) -> None:
        self.watch = RunWatch(folder)
        self._folder, self._notes = folder, notes
        self._rows = GrowingRows(folder / "estimates.csv", _READ_AT_ONCE)
        self._tracks: Tracks | None = None
        self._names: set[str] = set()
        self._kept: dict[str, Thinned[tuple[int, Mapping[str, str]]]] = {}
        self._n_rows = 0

    @property
    def n_left(self) -> int:
        """How much of the estimates has not been read yet [bytes]."""
        return self._rows.n_left

    def look(self) -> bool:
        """Read what is new, up to a limit; return whether the run still goes on.

        Raises
        ------
        DataError
            If what it writes is no table of estimates.
        """
        status = self.watch.read_status()
        if status != "running" or self._has_begun():
            tracks = self._tracks = self._tracks or self._new_tracks()
            try:
                for row in self._rows.rows():
                    self._take(row, tracks)
            except (ValueError, KeyError) as error:
                raise self._rows.wrong(error) from error
        self.watch.status = status
        return status == "running"

    def document(self) -> dict[str, Any] | None:
        """Return what the map and the time axis show, of a run that has ended as in its report; None: nothing yet."""
        has_ended = self.watch.status != "running"
        try:
            shown = explorer_of_run(read_run(self._folder) if has_ended else self._as_far_as_known())
        except (DataError, np.linalg.LinAlgError):  # too little yet, or it was written just now
            return None
        if shown is not None:
            shown["isGoingOn"] = not has_ended
            for lane in shown["lanes"]:  # those that are drawn are fewer
                if not has_ended and lane["name"] in self.watch.localizers:
                    lane["counts"] = dict(self.watch.localizers[lane["name"]].outcomes)
        return shown

    def _has_begun(self) -> bool:
        """Return whether the notes are there that the estimates are to be read with."""
        return self._notes is None or (self._notes / OUTLINES_FILE).is_file()

    def _new_tracks(self) -> Tracks:
        names = localizer_names(self._config_text())
        self._names = set(names)
        return Tracks(names, Session(path=self._read_note(PATH_FILE, read_path)))

    def _config_text(self) -> str:
        with suppress(OSError):
            return (self._folder / "config.yaml").read_text(encoding="utf-8", errors="replace")
        return ""

    def _take(self, row: dict[str, str], tracks: Tracks) -> None:
        self.watch.take(row)
        source = row["source"]
        self._kept.setdefault(source, Thinned(_MAX_ESTIMATES)).add((self._n_rows, row | {"details": ""}))
        self._n_rows += 1
        if source in self._names:
            with suppress(TrailmarkError):  # what the run's own reckoning refused is refused here
                tracks.on_estimate_record(_record_of(row))

    def _as_far_as_known(self) -> RunFolder:
        rows = sorted((item for kept in self._kept.values() for item in kept.kept), key=lambda item: item[0])
        beliefs = self._read_note(BELIEFS_FILE, read_beliefs)
        own = {} if self._tracks is None else dict(self._tracks.trajectories())
        own[FUSED] = _trajectory_of(beliefs)
        return RunFolder(
            path=self._folder,
            trajectories={name: every_nth(way, _MAX_POSES) for name, way in own.items()},
            truth=self._read_note(TRUTH_FILE, read_tum),
            estimates=table_of_rows((f"row {n}", row) for n, row in rows),
            run={"status": self.watch.status},
            timing={},
            config_text=self._config_text(),
            problems=(),
            path_taught=self._read_note(PATH_FILE, read_path),
            beliefs=beliefs,
            outlines=self._read_note(OUTLINES_FILE, read_outlines),
        )

    def _read_note(self, name: str, read: Any) -> Any:
        """Return what a file of the notes holds; None where there is none."""
        path = None if self._notes is None else self._notes / name
        if path is None or not path.is_file():
            return None
        with suppress(DataError):
            return read(path)
        return None


def _trajectory_of(beliefs: BeliefTable | None) -> Trajectory:
    if beliefs is None or not len(beliefs):
        return Trajectory(np.zeros(0), np.zeros((0, 3)))
    stamps_s = np.maximum.accumulate(beliefs.stamps_s)
    last = np.diff(stamps_s, append=np.inf) > 0.0  # of one stamp the last counts
    return Trajectory(stamps_s[last], beliefs.poses[last])


def _record_of(row: Mapping[str, str]) -> EstimateRecord:
    """Return a row of ``estimates.csv`` as what it was; a motion says no more what kind it is of."""
    status: Any = row["status"]
    return EstimateRecord(float(row["arrived_s"]), row["source"], _estimate_of(row), Applied(status, row["reason"]))


def _estimate_of(row: Mapping[str, str]) -> Estimate:
    stamp_s, kind = float(row["stamp_s"]), row["kind"]
    if kind == "lost":
        return Lost(stamp_s, row["reason"])
    x, y, theta = (float(row[name]) for name in ("x", "y", "theta"))
    information = _information_of(row)
    if kind == "motion":
        return Motion(float(row["since_s"]), stamp_s, Pose2(x, y, theta), information)
    if kind == "fix":
        return Fix(stamp_s, Pose2(x, y, theta), information)
    return PathOffset(stamp_s, x, y, theta, information)


def _information_of(row: Mapping[str, str]) -> Floats:
    xx, xy, xt, yy, yt, tt = (float(row[f"info_{name}"]) for name in ("xx", "xy", "xt", "yy", "yt", "tt"))
    return np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
