"""The work behind a block of a page of results, which may be ended and gone on with: its folder, notes and minutes."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Mapping
from pathlib import Path

from results_code import Code, noted_paths

__all__ = ["Work"]


class Work:
    """The folder of a block under ``runs/results``, and beside it what was read and how long it took so far.

    Parameters
    ----------
    folder : Path
        Where the command works.
    command : str
        Of the block.
    before : mapping
        Digests of all code there is.
    """

    def __init__(self, folder: Path, command: str, before: Mapping[str, str]) -> None:
        self.folder, self.notes = folder, folder.with_name(folder.name + ".read")
        self._begun = folder.with_name(folder.name + ".begun.json")
        known = json.loads(self._begun.read_text(encoding="utf-8")) if self._begun.exists() else {}
        is_same, is_kept = known.get("command") == command, "{kept}" in command
        goes_on = is_same and self._is_of(known["code"], before)
        if not goes_on:
            shutil.rmtree(self.notes, ignore_errors=True)  # a kept one reads again what it still depends on
        if not goes_on and not is_kept:
            shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir(parents=True, exist_ok=True)
        self.notes.mkdir(exist_ok=True)
        self.notes.chmod(0o1777)  # tests of permissions go on as another user
        minutes = known["minutes"] if goes_on or (is_same and is_kept) else 0.0
        self._document = {"command": command, "minutes": minutes, "code": dict(before)}
        self._since_s = time.monotonic()
        self.pause()

    @property
    def minutes(self) -> float:
        """Time that was spent on it, with what came before it was ended."""
        return float(self._document["minutes"]) + (time.monotonic() - self._since_s) / 60.0

    def pause(self) -> None:
        """Note the time: the next one goes on from here."""
        self._begun.write_text(json.dumps(self._document | {"minutes": self.minutes}), encoding="utf-8")

    def end(self) -> None:
        """Forget that it was begun: who makes it again begins anew."""
        self._begun.unlink()

    def _is_of(self, code: Mapping[str, str], before: Mapping[str, str]) -> bool:
        """Return whether all that was read so far is as it was."""
        top = self.folder.parents[2]
        names = Code(top).names(noted_paths(self.notes)) if self.notes.is_dir() else []
        return all(code.get(name) == before.get(name) for name in names)
