"""One run, as it was found at the last look: what a page is to show of it."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

from trailmark.report.glimpses import FOLDER, PICTURE_NAME
from trailmark.report.live import RunWatch
from trailmark.watching.growing import GrowingRun

__all__ = ["NOTHING", "RunState", "writing_of"]

#: A report that is to come comes within this time [s].
_REPORT_S = 20.0

#: What a page shows before there is a run.
NOTHING: dict[str, Any] = {
    "status": "idle",
    "isLive": False,
    "isOver": False,
    "note": "",
    "explorer": None,
    "health": {"columns": [], "rows": []},
    "pictures": [],
    "hasReport": False,
}


def writing_of(folder: Path) -> tuple[int, int] | None:
    """Return a key of the version of a folder's ``run.json``, which changes when it is written; None: there is none."""
    try:
        found = (folder / "run.json").stat()
    except OSError:
        return None
    return found.st_ino, found.st_mtime_ns


class RunState:
    """One run, as it was found at the last look.

    Parameters
    ----------
    folder : Path
        Of the run; it may not be there yet.
    notes : Path or None
        Where the run leaves notes.
    earlier : tuple of int, optional
        `writing_of` the folder by a run before this one, which this one will replace; that run is not shown.
    """

    def __init__(self, folder: Path, notes: Path | None, earlier: tuple[int, int] | None = None) -> None:
        self.folder, self.notes = folder, notes
        self._earlier = earlier
        self._growing: GrowingRun | None = None
        self._shown: tuple[Any, ...] = ()
        self._last: dict[str, Any] | None = None
        self._ended_at_s = math.inf
        self._is_end_said = False
        self.has_ended = False

    def look(self) -> bool:
        """Read what is new; return whether there is more to read at once."""
        if self.has_ended:
            return False
        if self._growing is None:
            if writing_of(self.folder) in (None, self._earlier):
                return False
            self._growing = GrowingRun(self.folder, self.notes)
        before = self._growing.n_left
        goes_on = self._growing.look()
        left = self._growing.n_left
        self.has_ended = not goes_on and (left == 0 or left == before)
        self._ended_at_s = time.monotonic()
        return 0 < left < before

    def is_complete(self) -> bool:
        """Return whether it has ended and its report is there, or has not come for a while."""
        waited_s = time.monotonic() - self._ended_at_s
        return self.has_ended and ((self.folder / "report.html").is_file() or waited_s > _REPORT_S)

    def state(self, *, is_over: bool, can: list[str], is_new: bool = False) -> dict[str, Any] | None:
        """Return what is to be shown; None: nothing has changed."""
        if self._growing is None:
            if not is_over and not is_new and self._shown == (can,):
                return None
            self._shown = (can,)
            return {**NOTHING, "name": self._name, "run": str(self.folder), "can": can, "isOver": is_over} | {
                "status": "ended before its first frame" if is_over else "beginning"
            }
        watch, has_report = self._growing.watch, (self.folder / "report.html").is_file()
        pictures = self._named_pictures()
        n = sum(seen.n for seen in watch.localizers.values())
        shown = (n, watch.status, has_report, is_over, can, len(pictures), pictures[-1:])
        if shown == self._shown and not is_new and not self._growing.n_left:
            return None
        self._shown = shown
        if self.has_ended and not is_over and not self._is_end_said:
            self._is_end_said, self._shown = True, ()  # at once, and what the report shows at the next look
        else:
            self._last = self._growing.document() or self._last
        ended = self.has_ended or is_over
        return {
            "name": self._name,
            "run": str(self.folder),
            "status": _status(watch.status, is_over),
            "isLive": not ended,
            "isOver": is_over,
            "note": self._note(is_over, has_report),
            "can": can,
            "explorer": self._last,
            "health": _table_document(watch),
            "pictures": pictures,
            "hasReport": self.has_ended and has_report,
        }

    def pictures(self) -> Path | None:
        """Return where the pictures are: the run's own when it has ended, and its notes as long as it goes on."""
        own = self.folder / FOLDER
        if self.notes is not None and (self.notes / FOLDER).is_dir():
            return self.notes / FOLDER
        return own if own.is_dir() else None

    @property
    def _name(self) -> str:
        return self.folder.resolve().name

    def _named_pictures(self) -> list[dict[str, Any]]:
        folder = self.pictures()
        found = [] if folder is None else [PICTURE_NAME.fullmatch(path.name) for path in folder.iterdir()]
        named = [{"sensor": match[1], "t": float(match[2]), "name": match[0]} for match in found if match]
        return sorted(named, key=lambda item: item["t"])

    def _note(self, is_over: bool, has_report: bool) -> str:
        if is_over:
            return str(self.folder / "report.html") if has_report else f"{self.folder}"
        if self._growing is not None and self._growing.n_left > 1 << 16:
            return f"{self._growing.n_left / 1e6:.1f} MB of its estimates are still to be read"
        if self.notes is None and not self.has_ended:
            return "belief, truth and pictures are known at its end: it was not started with --watch"
        return ""


def _status(status: str, is_over: bool) -> str:
    if status == "running":
        return "ended without a word" if is_over else "running"
    return f"ended: {status}" if is_over else f"{status}: metrics and report are being made"


def _table_document(watch: RunWatch) -> dict[str, Any]:
    table = watch.table()
    columns = [{"title": item.title, "unit": item.unit, "number": item.is_number} for item in table.columns]
    return {"columns": columns, "rows": [list(row) for row in table.rows]}
