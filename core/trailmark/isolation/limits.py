"""What isolated work may use beside time: looked at now and then while it goes on."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from trailmark.isolation.process_tree import ProcessTree, resident_mb

__all__ = ["LimitWatch", "folder_mb"]

_LOOK_S = 0.5
# A look takes at most this share of the time: walking a folder with very many files takes long.
_SHARE = 0.02


class LimitWatch:
    """Looks whether work has used too much.

    Parameters
    ----------
    limits : mapping
        ``disk_mb``: of the folder; ``processes``: at a time; ``memory_mb``: of all processes together, where there are
        several (of each, the process itself sees to it). What is not there, or None, has no limit.
    folder : Path
        Where the work writes.
    tree : ProcessTree
        Its processes.

    Attributes
    ----------
    next_look_s : float
        When to look next, by the monotonic clock [s].
    """

    def __init__(self, limits: Mapping[str, Any], folder: Path, tree: ProcessTree) -> None:
        self._disk_mb = limits.get("disk_mb")
        self._processes = limits.get("processes")
        self._memory_mb = limits.get("memory_mb")
        self._folder = folder
        self._tree = tree
        is_limited = (self._disk_mb, self._processes, self._memory_mb) != (None, None, None)
        self.next_look_s = time.monotonic() + _LOOK_S if is_limited else float("inf")

    def verdict(self) -> tuple[str, str] | None:
        """Check the limits, if it is time to; return state and reason if one is exceeded."""
        began_s = time.monotonic()
        if began_s < self.next_look_s:
            return None
        reason = self._disk_reason() or self._process_reason()
        now_s = time.monotonic()
        self.next_look_s = now_s + max(_LOOK_S, (now_s - began_s) / _SHARE)
        return ("failed", reason) if reason else None

    def final_verdict(self) -> tuple[str, str] | None:
        """Return state and reason if what the finished work has left exceeds a limit."""
        reason = self._disk_reason()
        return ("failed", reason) if reason else None

    def _disk_reason(self) -> str:
        is_over = self._disk_mb is not None and folder_mb(self._folder) > self._disk_mb
        return f"left more than {self._disk_mb:g} MB on disk" if is_over else ""

    def _process_reason(self) -> str:
        if self._processes is None and self._memory_mb is None:
            return ""
        pids = self._tree.pids()
        if self._processes is not None and len(pids) > self._processes:
            return f"had more than {self._processes} processes"
        if self._memory_mb is not None and len(pids) > 1 and resident_mb(pids) > self._memory_mb:
            return f"out of memory (limit {self._memory_mb:g} MB for {len(pids)} processes)"
        return ""


def folder_mb(folder: Path) -> float:
    """Return what the files of a folder take on the disk [MB]."""
    size = 0
    for where, _, names in os.walk(folder):
        for name in names:
            try:
                size += os.lstat(os.path.join(where, name)).st_blocks * 512
            except OSError:  # it has gone meanwhile
                continue
    return size / 1e6
