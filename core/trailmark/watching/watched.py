"""What a page shows, made by a thread of its own: of a run that goes on, here."""

from __future__ import annotations

import json
import logging
import math
import os
import signal
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from trailmark.errors import DataError
from trailmark.failures import words_of
from trailmark.report.glimpses import PICTURE_NAME
from trailmark.watching.page import watch_page
from trailmark.watching.run_state import NOTHING, RunState

__all__ = ["WatchedPage", "WatchedRun"]

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


class WatchedPage(ABC):
    """Base of the live pages: a thread makes the newest state as long as the page is open.

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
        self._title = title
        self._buttons = tuple(buttons)
        self._state: tuple[int, bytes] = (-1, b"")
        self._asked_at_s = -math.inf
        self._is_final = self._is_told = self._has_failed = False
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
        """Stop the thread."""
        self._is_closed.set()

    @property
    def is_open(self) -> bool:
        """Whether a browser has the page open."""
        return time.monotonic() - self._asked_at_s < _IS_OPEN_S

    def has_told(self) -> bool:
        """Return whether the open page has received the end and asks no more; True when no page is open."""
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
            except Exception as error:  # whatever it is, who has the page open is to know
                why = str(error) if isinstance(error, (DataError, OSError)) else words_of(error)
                logger.warning("the page stands still: %s", why)
                self._stand_still(why)
                return

    def _stand_still(self, why: str) -> None:
        """Say on the page why nothing more comes; of a page that does not end with this, the buttons go on working."""
        self._has_failed = True
        number, text = self._state
        last = json.loads(text) if text else {**NOTHING, "name": self._title, "run": str(self._folder() or "")}
        is_over = self.has_ended()
        last |= {"number": number + 1, "note": f"the page stands still: {why}", "isLive": False, "isOver": is_over}
        last |= {"can": [] if is_over else list(self._buttons)}
        self._state = (number + 1, json.dumps(last, ensure_ascii=False, separators=(",", ":")).encode())
        self._is_final = is_over

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
    earlier : tuple of int, optional
        `writing_of` the folder by a run before this one, which is not shown.
    """

    def __init__(
        self,
        folder: Path,
        secret: str,
        *,
        notes: Path | None = None,
        is_there: Callable[[], bool] = lambda: True,
        process: int | None = None,
        earlier: tuple[int, int] | None = None,
    ) -> None:
        super().__init__(folder.resolve().name, secret, () if process is None else ("stop",))
        self._run = RunState(folder, notes, earlier)
        self._is_there, self._process = is_there, process

    def has_ended(self) -> bool:
        """Return whether the run has ended, and its program with it; or nothing more can be shown of it."""
        return self._has_failed or not self._is_there() or (self._process is None and self._run.is_complete())

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


def _content(path: Path) -> bytes | None:
    try:
        return None if path.is_symlink() else path.read_bytes()
    except OSError:
        return None
