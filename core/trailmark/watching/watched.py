"""What a page shows: a run that goes on, or a robot and the runs that its buttons begin."""

from __future__ import annotations

import json
import logging
import math
import os
import shutil
import signal
import tempfile
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from trailmark.errors import DataError
from trailmark.isolation.tasks import Task, TaskRunner
from trailmark.report.glimpses import FOLDER, PICTURE_NAME
from trailmark.report.live import RunWatch
from trailmark.watching.growing import GrowingRun
from trailmark.watching.page import watch_page

__all__ = ["WatchedPage", "WatchedRobot", "WatchedRun"]

logger = logging.getLogger(__name__)

_LOOK_EVERY_S = 0.2
_SHOW_EVERY_S = 1.0
#: What is drawn takes at most so much of a processor, however long a run is.
_SHARE = 0.25
#: Nobody has the page open who has not asked for so long [s].
_IS_OPEN_S = 3.0
#: The page that knows the end asks for the last pictures and the report at once [s].
_QUIET_S = 1.0
#: Of a long run there is much to catch up with; it is shown meanwhile [s].
_CATCH_UP_S = 0.5
#: A report that is to come comes within this time [s].
_REPORT_S = 20.0


class WatchedPage(ABC):
    """What is common: the newest state, made by a thread of its own as long as somebody has the page open.

    Parameters
    ----------
    title : str
        Of the page.
    secret : str
        Of its buttons.
    buttons : sequence of str
        Those that there are.
    """

    def __init__(self, title: str, secret: str, buttons: Sequence[str] = ()) -> None:
        self._page = watch_page(title, secret, buttons)
        self._buttons = tuple(buttons)
        self._state: tuple[int, bytes] = (-1, b"")
        self._asked_at_s = -math.inf
        self._is_final = self._is_told = False
        self._is_closed = threading.Event()
        self._thread = threading.Thread(target=self._look_again_and_again, name="page's run", daemon=True)

    # --- asked by the server ---------------------------------------------------------------------------------------

    def page(self) -> tuple[str, str]:
        """Return the page and its policy."""
        self._asked_at_s = time.monotonic()
        return self._page

    def state(self, after: int) -> bytes | None:
        """Return the newest state, if it is newer than that number."""
        self._asked_at_s = time.monotonic()
        number, text = self._state
        if number <= after:
            return None
        self._is_told = self._is_final
        return text

    def picture(self, name: str) -> bytes | None:
        """Return a picture of the run; one that is just being let go is not there."""
        self._asked_at_s = time.monotonic()
        folder = self._pictures()
        if folder is None or PICTURE_NAME.fullmatch(name) is None:
            return None
        return _content(folder / name)

    def report(self) -> bytes | None:
        """Return the report of the run."""
        folder = self._folder()
        return None if folder is None else _content(folder / "report.html")

    def press(self, button: str) -> str:
        """Do what a button says; return why not."""
        return f"there is no button {button!r}" if button not in self._buttons else self._do(button)

    # --- its thread ------------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Begin to look."""
        self._thread.start()

    def close(self) -> None:
        """Look no more."""
        self._is_closed.set()

    @property
    def is_open(self) -> bool:
        """Whether somebody has the page open."""
        return time.monotonic() - self._asked_at_s < _IS_OPEN_S

    def has_told(self) -> bool:
        """Return whether who has the page open knows the end, and asks no more; nobody has: there is nobody to tell."""
        quiet_s = time.monotonic() - self._asked_at_s
        return quiet_s > (_QUIET_S if self._is_told else _IS_OPEN_S)

    def _look_again_and_again(self) -> None:
        next_s = 0.0
        while not self._is_closed.wait(_LOOK_EVERY_S):
            try:
                is_over, began_s = self.has_ended(), time.monotonic()
                while self._look() and not self._is_closed.is_set() and time.monotonic() - began_s < _CATCH_UP_S:
                    pass
                now_s = time.monotonic()
                if not self._is_final and (self.is_open or self._state[0] < 0) and (now_s >= next_s or is_over):
                    self.show()
                    took_s = time.monotonic() - now_s
                    next_s = now_s + took_s + max(_SHOW_EVERY_S - took_s, took_s * (1.0 / _SHARE - 1.0))
            except (DataError, OSError) as error:
                logger.warning("the page stands still: %s", error)
                return

    def show(self) -> None:
        """Make the newest state, if anything has changed."""
        number = self._state[0] + 1
        found = self._found()
        if found is not None:
            text = json.dumps(found | {"number": number}, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
            self._state = (number, text.encode())
            self._is_final = bool(found["isOver"])

    def has_ended(self) -> bool:
        """Return whether there is nothing more to come."""
        return False

    @abstractmethod
    def _look(self) -> bool:
        """Read what is new; return whether there is more to read at once."""

    @abstractmethod
    def _found(self) -> dict[str, Any] | None:
        """Return what is to be shown; None: nothing has changed."""

    @abstractmethod
    def _folder(self) -> Path | None:
        """Return the folder of the run."""

    @abstractmethod
    def _pictures(self) -> Path | None:
        """Return where its pictures are."""

    @abstractmethod
    def _do(self, button: str) -> str:
        """Do what a button of this page says; return why not."""


class WatchedRun(WatchedPage):
    """A run that goes on; its page ends with it.

    Parameters
    ----------
    folder : Path
        Of the run; it may not be there yet.
    secret : str
        Of the buttons.
    notes : Path or None
        Where the run leaves notes.
    is_there : callable
        Whether the program of the run still is.
    process : int or None
        The program that Stop ends; None: there is no such button.
    """

    def __init__(
        self,
        folder: Path,
        secret: str,
        *,
        notes: Path | None = None,
        is_there: Callable[[], bool] = lambda: True,
        process: int | None = None,
    ) -> None:
        super().__init__(folder.resolve().name, secret, () if process is None else ("stop",))
        self._run = _RunState(folder, notes)
        self._is_there, self._process = is_there, process

    def has_ended(self) -> bool:
        """Return whether the run has ended, and its program with it."""
        return not self._is_there() or (self._process is None and self._run.is_complete())

    def _look(self) -> bool:
        return self._run.look()

    def _found(self) -> dict[str, Any] | None:
        is_over = self.has_ended()
        can = [] if self._run.has_ended or is_over else list(self._buttons)
        return self._run.state(is_over=is_over, can=can)

    def _folder(self) -> Path | None:
        return self._run.folder

    def _pictures(self) -> Path | None:
        return self._run.pictures()

    def _do(self, button: str) -> str:
        assert self._process is not None
        if not self._is_there():
            return "the run has ended"
        os.kill(self._process, signal.SIGINT)  # the same as Ctrl-C
        return ""


class WatchedRobot(WatchedPage):
    """A robot: its buttons teach, replay and stop; the page shows the run that goes on, or the last one.

    Parameters
    ----------
    title : str
        Of the page.
    secret : str
        Of the buttons.
    command_of : callable
        Returns the command line of a task, whose run is written to a folder and leaves notes in another.
    new_folder : callable
        Returns the folder for the run of a task.
    """

    def __init__(
        self,
        title: str,
        secret: str,
        command_of: Callable[[Task, Path, Path], list[str]],
        new_folder: Callable[[Task], Path],
    ) -> None:
        super().__init__(title, secret, ("teach", "replay", "stop"))
        self._title, self._command_of, self._new_folder = title, command_of, new_folder
        self._all_notes = Path(tempfile.mkdtemp(prefix="trailmark-watch-"))
        self._run: _RunState | None = None
        self._shown: tuple[str, bool] | None = None
        self._runner = TaskRunner(self._begin, lambda state: None)
        self._runner.begin()

    def close(self) -> None:
        """End what goes on, as Ctrl-C does."""
        self._runner.stop()
        super().close()
        shutil.rmtree(self._all_notes, ignore_errors=True)

    def _begin(self, task: Task) -> list[str]:
        folder = self._new_folder(task)
        notes = Path(tempfile.mkdtemp(dir=self._all_notes))
        before, self._run = self._run, _RunState(folder, notes)
        if before is not None and before.notes is not None:
            shutil.rmtree(before.notes, ignore_errors=True)
        return self._command_of(task, folder, notes)

    def _look(self) -> bool:
        self._runner.look()
        return self._run is not None and self._run.look()

    def _found(self) -> dict[str, Any] | None:
        state, is_running = self._runner.state, self._runner.is_running
        can = ["stop"] if is_running else ["teach", "replay"]
        if self._run is None:
            found = {**_NOTHING, "name": self._title, "run": "", "can": can}
            return found if self._is_new((state, False)) else None
        is_new = self._is_new((state, self._run.has_ended))
        found_now = self._run.state(is_over=False, can=can, is_new=is_new)
        if found_now is None:
            return None
        return found_now | {"status": state, "isLive": is_running}

    def _is_new(self, shown: tuple[str, bool]) -> bool:
        before, self._shown = self._shown, shown
        return before != shown

    def _folder(self) -> Path | None:
        return None if self._run is None else self._run.folder

    def _pictures(self) -> Path | None:
        return None if self._run is None else self._run.pictures()

    def _do(self, button: str) -> str:
        return self._runner.take(button)


_NOTHING: dict[str, Any] = {
    "status": "idle",
    "isLive": False,
    "isOver": False,
    "note": "",
    "explorer": None,
    "health": {"columns": [], "rows": []},
    "pictures": [],
    "hasReport": False,
}


class _RunState:
    """One run, as it was found at the last look."""

    def __init__(self, folder: Path, notes: Path | None) -> None:
        self.folder, self.notes = folder, notes
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
            if not (self.folder / "run.json").is_file():
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
            return {**_NOTHING, "name": self._name, "run": str(self.folder), "can": can, "isOver": is_over} | {
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


def _content(path: Path) -> bytes | None:
    try:
        return None if path.is_symlink() else path.read_bytes()
    except OSError:
        return None
