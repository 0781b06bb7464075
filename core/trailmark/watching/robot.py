"""The page of a robot: buttons that teach, replay and stop."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from trailmark.isolation.tasks import Task, TaskRunner
from trailmark.watching.run_state import NOTHING, RunState
from trailmark.watching.watched import WatchedPage

__all__ = ["WatchedRobot"]


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
        self._command_of, self._new_folder = command_of, new_folder
        self._all_notes = Path(tempfile.mkdtemp(prefix="trailmark-watch-"))
        self._run: RunState | None = None
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
        before, self._run = self._run, RunState(folder, notes)
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
            found = {**NOTHING, "name": self._title, "run": "", "can": can}
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
