"""A process for work that may fail: started, watched, ended, accounted for."""

from __future__ import annotations

import json
import logging
import os
import secrets
import select
import signal
import socket
import sys
import time
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

from trailmark.errors import ConfigError
from trailmark.isolation.child import EXIT_FAILED, EXIT_SKIPPED
from trailmark.isolation.environment import pinned_environment
from trailmark.isolation.error_tail import ErrorTail
from trailmark.isolation.launching import ForkedProcess, LaunchedProcess, Program
from trailmark.isolation.limits import LimitWatch
from trailmark.isolation.outcome import Outcome
from trailmark.isolation.process_tree import MARK_VARIABLE, ProcessTree
from trailmark.isolation.warm_parent import WarmParent

__all__ = ["REQUEST_FILE", "RESULT_FILE", "IsolatedProcess"]

logger = logging.getLogger(__name__)

REQUEST_FILE = "cell.json"
RESULT_FILE = "result.json"

_POLL_S = 0.5
# What a process that is told to show where it hangs gets for doing so.
_LAST_WORDS_S = 0.3


class IsolatedProcess:
    """A process with a request, a folder and limits; `kill` ends it from another thread.

    It leads a session of its own. When it ends, whatever way, everything that it has started is ended too.

    Parameters
    ----------
    request : mapping
        Plain data, written into the folder; ``limits`` in it holds ``timeout_s`` and ``threads``, and what `LimitWatch`
        looks at.
    folder : Path
        An empty folder: what the process leaves is in it afterwards, ``result.json`` among it.
    module : str
        What runs in it, as ``python -m MODULE FOLDER PARENT``.
    scratch : Path, optional
        Working folder, and place of temporary files; default: those of this process.
    parent : WarmParent, optional
        Has imported what the process needs, and forks it, where there is a `scratch`; if it cannot, the process is a
        program of its own.

    Attributes
    ----------
    was_warm : bool
        It was forked.

    Raises
    ------
    ConfigError
        Where processes cannot be accounted for: ``os.wait4`` is of Linux and macOS.
    """

    def __init__(
        self,
        request: Mapping[str, Any],
        folder: Path,
        *,
        module: str,
        scratch: Path | None = None,
        parent: WarmParent | None = None,
    ) -> None:
        if os.name != "posix":
            raise ConfigError("cells and calls run on Linux and macOS; tables and reports open everywhere")
        self._request = request
        self._module = module
        self._folder = folder
        self._scratch = scratch
        self._parent = parent
        self.was_warm = False
        self._tree: ProcessTree | None = None
        self._is_killed = False

    def run(self) -> Outcome:
        """Start the process, and return when it has ended, whatever way."""
        (self._folder / REQUEST_FILE).write_text(json.dumps(self._request), encoding="utf-8")
        load, began_s = os.getloadavg()[0], time.monotonic()
        mark = secrets.token_hex(8)
        process = self._launch(mark)
        tree = self._tree = ProcessTree(process.pid, mark)
        if self._is_killed:
            tree.kill()
        tail = ErrorTail(process.stderr)
        limits = LimitWatch(self._request["limits"], self._folder, tree)
        with closing(_ExitWaiter(process.pid, tail)) as waiter:
            verdict = self._watch(waiter, limits, tree)
        usage = process.reap()
        tree.kill()  # what it has started and left behind
        wall_s, stderr = time.monotonic() - began_s, tail.text()
        process.close()
        code = os.waitstatus_to_exitcode(usage.status)
        state, reason = verdict or limits.final_verdict() or _verdict(self._folder, code, stderr)
        return Outcome(
            state=state,
            reason=reason,
            stderr=stderr,
            wall_s=round(wall_s, 4),
            cpu_s=round(usage.cpu_s, 4),
            peak_rss_mb=round(usage.peak_rss_mb, 1),
            load=round(load, 2),
            host=socket.gethostname(),
        )

    def kill(self) -> None:
        """End the process, and all that it has started, now."""
        self._is_killed = True
        if self._tree is not None:
            self._tree.kill()

    def _launch(self, mark: str) -> LaunchedProcess:
        """Start the process: warm if it has a parent that can fork it, else as a program of its own."""
        variables = {MARK_VARIABLE: mark}
        if self._scratch is not None:
            self._scratch.mkdir(exist_ok=True)
            variables["TMPDIR"] = str(self._scratch.absolute())
            if self._parent is not None:
                try:
                    process = ForkedProcess(self._parent, self._folder, self._scratch, variables)
                except OSError as error:
                    logger.debug("no warm process: %s", error)
                else:
                    self.was_warm = True
                    return process
        command = [
            sys.executable,
            "-P",  # not a numpy.py of the folder where all was started
            "-X",
            "faulthandler",
            "-m",
            self._module,
            str(self._folder.absolute()),
            str(os.getpid()),
        ]
        environment = pinned_environment(self._request["limits"]["threads"]) | variables
        return Program(command, environment, self._scratch)

    def _watch(self, waiter: _ExitWaiter, limits: LimitWatch, tree: ProcessTree) -> tuple[str, str] | None:
        """Wait until the process has ended; return state and reason if it had to be ended."""
        limit_s = float(self._request["limits"]["timeout_s"])
        until_s = time.monotonic() + limit_s
        while not waiter.wait(min(until_s, limits.next_look_s)):
            verdict = limits.verdict()
            if verdict is None and time.monotonic() >= until_s:
                verdict = "timeout", f"not done after {limit_s:g} s"
                tree.signal_first(signal.SIGUSR1)  # faulthandler: where does it hang
                waiter.wait(time.monotonic() + _LAST_WORDS_S)
            if verdict is not None:
                tree.kill()
                while not waiter.wait(time.monotonic() + _POLL_S):
                    tree.kill()
                return verdict
        return None


class _ExitWaiter:
    """Waits for the end of a process, and reads meanwhile what it says."""

    def __init__(self, pid: int, tail: ErrorTail) -> None:
        self._pid = pid
        self._tail = tail
        try:
            self._ended = os.pidfd_open(pid)
        except (AttributeError, OSError):  # not on this system: look now and then
            self._ended = -1
        self._watched = [tail.pipe] if self._ended < 0 else [tail.pipe, self._ended]

    def wait(self, until_s: float) -> bool:
        """Wait until then at most, by the monotonic clock [s]; return whether the process has ended."""
        while True:
            patience_s = max(0.0, min(until_s - time.monotonic(), 60.0 if self._ended >= 0 else 0.02))
            ready, _, _ = select.select(self._watched, [], [], patience_s)
            if self._tail.pipe in ready and not self._tail.read():
                self._watched.remove(self._tail.pipe)
            if self._ended in ready or (self._ended < 0 and _has_ended(self._pid)):
                return True
            if time.monotonic() >= until_s:
                return False

    def close(self) -> None:
        """Stop waiting."""
        if self._ended >= 0:
            os.close(self._ended)


def _verdict(folder: Path, code: int, stderr: str) -> tuple[str, str]:
    """Return state and reason by the exit code, the result and the last line of standard error."""
    result = _result(folder)
    if code == 0 and result is not None:
        return str(result["state"]), str(result["reason"])
    if code < 0:
        return "crashed", _signal_words(-code)
    last = next((line for line in reversed(stderr.splitlines()) if line.strip()), "")
    if code in (EXIT_FAILED, EXIT_SKIPPED) and last:
        return "failed" if code == EXIT_FAILED else "skipped", last
    return "crashed", f"left with code {code} without a result" + (f": {last}" if last else "")


def _has_ended(pid: int) -> bool:
    return os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


def _result(folder: Path) -> dict[str, Any] | None:
    try:
        document = json.loads((folder / RESULT_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return document if isinstance(document, dict) and {"state", "reason"} <= document.keys() else None


def _signal_words(number: int) -> str:
    try:
        name = signal.Signals(number).name
    except ValueError:
        name = f"signal {number}"
    words = (signal.strsignal(number) or "").lower()
    hint = "; perhaps the machine ran out of memory" if number == signal.SIGKILL else ""
    return f"ended by {name}" + (f" ({words})" if words else "") + hint
