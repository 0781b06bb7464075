"""All processes that stem from one, whatever group or session they have put themselves in."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

__all__ = ["MARK_VARIABLE", "ProcessTree", "resident_mb"]

#: Variable of the environment that every process of a tree inherits, and by which it is found.
MARK_VARIABLE = "TRAILMARK_ISOLATED"

_PROC = Path("/proc")
_ROUNDS = 20
_PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 1e6 if hasattr(os, "sysconf") else 0.0


class ProcessTree:
    """The processes that stem from one.

    They are found by a mark in their environment, and by who started whom; a process that hides from both (it empties
    its environment, and its parent has ended) is not found. Without ``/proc`` there is the group of the first alone.

    Parameters
    ----------
    pid : int
        The first of them, which leads a group of its own.
    mark : str
        What `MARK_VARIABLE` holds in their environment, and in no other's.
    """

    def __init__(self, pid: int, mark: str) -> None:
        self._pid = pid
        self._mark = f"{MARK_VARIABLE}={mark}".encode()

    def pids(self) -> list[int]:
        """Return the processes that live."""
        found: set[int] = set()
        parents: dict[int, int] = {}
        for pid, parent in _living():
            parents[pid] = parent
            if pid == self._pid or self._mark in _environment(pid):
                found.add(pid)
        grown = True
        while grown:
            more = {pid for pid, parent in parents.items() if parent in found and pid not in found}
            found |= more
            grown = bool(more)
        return sorted(found)

    def signal_first(self, number: int) -> None:
        """Send a signal to the first process and its group."""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._pid, number)

    def kill(self) -> None:
        """End all of them; what is started meanwhile is found when they are looked for again."""
        self.signal_first(signal.SIGKILL)
        for _ in range(_ROUNDS):
            pids = self.pids()
            if not pids:
                return
            for pid in pids:
                with suppress(ProcessLookupError, PermissionError):
                    os.kill(pid, signal.SIGKILL)
            time.sleep(0.005)


def resident_mb(pids: list[int]) -> float:
    """Return the memory that some processes hold together, shared pages counted once for each [MB]."""
    pages = 0
    for pid in pids:
        with suppress(OSError, ValueError, IndexError):
            pages += int((_PROC / str(pid) / "statm").read_text().split()[1])
    return pages * _PAGE_MB


def _living() -> Iterator[tuple[int, int]]:
    """Yield process and parent of all that run; those that have ended and wait for their parent do not."""
    for folder in _PROC.glob("[0-9]*"):
        with suppress(OSError, ValueError, IndexError):
            state, parent = (folder / "stat").read_text().rpartition(")")[2].split()[:2]
            if state not in "ZX":
                yield int(folder.name), int(parent)


def _environment(pid: int) -> bytes:
    try:
        return (_PROC / str(pid) / "environ").read_bytes()
    except OSError:  # somebody else's, or gone
        return b""
