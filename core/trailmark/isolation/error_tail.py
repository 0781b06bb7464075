"""The end of what a process writes to standard error."""

from __future__ import annotations

import os
from collections import deque

__all__ = ["ErrorTail"]

_TAIL_BYTES = 16384


class ErrorTail:
    """Reads the pipe of a process' standard error, so that the process never waits, and keeps the end.

    Parameters
    ----------
    pipe : int
        Descriptor of the pipe's end for reading.
    """

    def __init__(self, pipe: int) -> None:
        self.pipe = pipe
        self._chunks: deque[bytes] = deque()
        self._n_bytes = 0
        os.set_blocking(pipe, False)

    def read(self) -> bool:
        """Take what is there; return whether there was something."""
        try:
            chunk = os.read(self.pipe, 65536)
        except (BlockingIOError, OSError):
            return False
        self._chunks.append(chunk)
        self._n_bytes += len(chunk)
        while len(self._chunks) > 1 and self._n_bytes - len(self._chunks[0]) >= _TAIL_BYTES:
            self._n_bytes -= len(self._chunks.popleft())
        return bool(chunk)

    def text(self) -> str:
        """Take what is left, and return the end of all."""
        while self.read():
            pass
        return b"".join(self._chunks)[-_TAIL_BYTES:].decode("utf-8", "replace")
