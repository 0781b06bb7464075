"""A lock on a folder that goes with the process that holds it."""

from __future__ import annotations

import os
import sys
from pathlib import Path

__all__ = ["LOCK_FILE", "FolderLock"]

LOCK_FILE = ".lock"


class FolderLock:
    """Held from its making until `release`, or the end of the process, whatever way.

    Parameters
    ----------
    folder : Path
        It must exist; the lock is a file in it.

    Raises
    ------
    BlockingIOError
        If somebody holds it.
    OSError
        If the file cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        follow = getattr(os, "O_NOFOLLOW", 0)  # not through a link; Windows does not know the flag
        self._file = os.fdopen(os.open(folder / LOCK_FILE, os.O_RDWR | os.O_CREAT | follow, 0o644), "w")
        try:
            _take(self._file.fileno())
        except OSError:
            self.release()
            raise

    def release(self) -> None:
        """Release the lock; again does nothing."""
        self._file.close()


if sys.platform == "win32":
    import msvcrt

    def _take(descriptor: int) -> None:
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except PermissionError as error:  # its word for: somebody holds it
            raise BlockingIOError(error.errno, error.strerror) from error

else:
    import fcntl

    def _take(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
