"""Files that are there as a whole or not at all, whenever the program ends."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

__all__ = ["DRAFTS", "WholeLines", "whole_file", "write_whole"]

#: Pattern of the names of what was not written to its end.
DRAFTS = ".*.part"

_HELD_BYTES = 8192


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give the name of a draft to write to; it takes the place of the file when it is complete.

    Raises
    ------
    OSError
        If the file cannot be replaced.
    """
    draft = path.with_name(f".{os.getpid()}-{threading.get_ident()}.part")  # two threads may write the same file
    try:
        yield draft
        os.replace(draft, path)
    except BaseException:
        with suppress(OSError):
            draft.unlink()
        raise


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file, text as UTF-8 with the line ends that it has.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    with whole_file(path) as draft:
        draft.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)


class WholeLines:
    """A growing text file that ends with a whole line, whenever the program ends.

    Parameters
    ----------
    path : Path
        Is overwritten.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb", buffering=0)
        self._held: list[bytes] = []
        self._n_held = 0

    def write(self, lines: str) -> None:
        """Add one or more whole lines; the last ones wait in memory."""
        self._held.append(lines.encode("utf-8"))
        self._n_held += len(lines)
        if self._n_held >= _HELD_BYTES:
            self.flush()

    def flush(self) -> None:
        """Hand what waits to the system, in one piece; what a full disk does not take waits on.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        held, self._held, self._n_held = self._held, [], 0
        data = memoryview(b"".join(held))
        try:
            while data:
                data = data[self._file.write(data) :]
        except BaseException:  # a signal, too, must not tear a hole
            self._held.insert(0, bytes(data))
            raise

    def close(self) -> None:
        """Write what waits, and close.

        Raises
        ------
        OSError
            If it cannot be written; it is closed then.
        """
        try:
            if not self._file.closed:
                self.flush()
        finally:
            self._file.close()
