"""What cells leave: moved to its place at once, so that a kill at any instant loses at most what was in work."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from trailmark.errors import ConfigError, DataError
from trailmark.isolation.executor import Finished
from trailmark.isolation.outcome import Outcome
from trailmark_bench.cell import Cell
from trailmark_bench.index import Index
from trailmark_bench.process import DETAIL_FILE, OUTCOME_FILE, RESULT_FILE
from trailmark_bench.remote import unpacked_answer

__all__ = ["CELLS", "FRAMES", "CellFolders", "frame_folder"]

#: Folder of the cells' folders, in that of the bench.
CELLS = "cells"

#: Folder of the frames that were rendered once, in that of the bench.
FRAMES = "frames"


class CellFolders:
    """The folders of a bench's cells.

    Parameters
    ----------
    folder : Path
        Of the bench.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder / CELLS
        self.workspace = self._folder / ".work"

    def make_workspace(self) -> None:
        """Make the folder of what is in work.

        Raises
        ------
        ConfigError
            If it cannot be written to.
        """
        try:
            self.workspace.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"cannot write to {self.workspace}: {error.strerror or error}") from error

    def clear_workspace(self) -> None:
        """Remove what was in work."""
        shutil.rmtree(self.workspace, ignore_errors=True)

    def keep(self, finished: Finished) -> tuple[Any, bytes | None]:
        """Move what a cell left to its place, at once; return its result and detail.

        Raises
        ------
        DataError
            If it cannot be written.
        """
        place = self._folder / finished.id
        try:
            folder = finished.folder or unpacked_answer(finished, self.workspace)
            (folder / OUTCOME_FILE).write_text(json.dumps(asdict(finished.outcome)), encoding="utf-8")
            if place.exists():
                shutil.rmtree(place)
            folder.rename(place)
        except OSError as error:
            raise DataError(
                f"cannot write {place}: {error.strerror or error}; finished cells are kept: run the bench again"
            ) from error
        return _json(place / RESULT_FILE), _bytes(place / DETAIL_FILE)

    def forget_outcomes(self, cells: Sequence[Cell]) -> None:
        """Remove what became of cells that are to run again, or a kill in the middle would bring it back."""
        for cell in cells:
            (self._folder / cell.id / OUTCOME_FILE).unlink(missing_ok=True)

    def recover(self, cells: Sequence[Cell], index: Index) -> None:
        """Put back what a killed bench left as running; take what had been finished and is not in the index."""
        self.clear_workspace()
        states = index.states()
        index.mark_pending(cell.id for cell in cells if states.get(cell.id) == "running")
        with index.transaction():
            for cell in cells:
                folder = self._folder / cell.id
                outcome = _json(folder / OUTCOME_FILE) if states.get(cell.id) in ("pending", "running") else None
                if outcome is not None:
                    result, detail = _json(folder / RESULT_FILE), _bytes(folder / DETAIL_FILE)
                    index.mark_finished(cell.id, Outcome(**outcome), result, detail)


def frame_folder(workspace: Path) -> Path:
    """Return where frames are kept of the bench whose cells are in work in a workspace."""
    return workspace.parent.parent / FRAMES


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _bytes(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None
