"""How an isolated process begins: as a program of its own, or forked from one that has imported much already."""

from __future__ import annotations

import os
import subprocess
import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path

from trailmark.isolation.warm_parent import Usage, WarmParent

__all__ = ["ForkedProcess", "LaunchedProcess", "Program"]


class LaunchedProcess(ABC):
    """A process that runs: `pid`, and `stderr`, the descriptor that reads what it writes to standard error."""

    pid: int
    stderr: int

    @abstractmethod
    def reap(self) -> Usage:
        """Return how it ended; it has ended."""

    def close(self) -> None:
        """Read no more of what it says."""
        os.close(self.stderr)


class Program(LaunchedProcess):
    """A program of its own."""

    def __init__(self, command: list[str], environment: Mapping[str, str], scratch: Path | None) -> None:
        self.stderr, said = os.pipe()
        try:
            self._process = subprocess.Popen(
                command,
                env=environment,
                cwd=scratch,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=said,
                start_new_session=True,  # Ctrl-C is for this process; and what that one starts can be ended with it
            )
        except BaseException:
            os.close(self.stderr)
            raise
        finally:
            os.close(said)
        self.pid = self._process.pid

    def reap(self) -> Usage:
        _, status, usage = os.wait4(self.pid, 0)
        self._process.returncode = os.waitstatus_to_exitcode(status)
        peak_mb = usage.ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
        return Usage(status, usage.ru_utime + usage.ru_stime, peak_mb)


class ForkedProcess(LaunchedProcess):
    """A child of a `WarmParent`.

    Raises
    ------
    OSError
        If there is no such child: its parent has threads, or is lost.
    """

    def __init__(self, parent: WarmParent, folder: Path, scratch: Path, variables: Mapping[str, str]) -> None:
        self._parent = parent
        self.stderr, said = os.pipe()
        try:
            self.pid = parent.fork(folder, scratch, variables, said)
        except BaseException:
            os.close(self.stderr)
            raise
        finally:
            os.close(said)

    def reap(self) -> Usage:
        return self._parent.reap(self.pid)
